#include "search/search.h"
#include "bindings/arrays.h"
#include "bindings/module.h"
#include "geometry/projection.h"
#include "search/kept_pairs.h"
#include "search/local_search.h"
#include "search/passing.h"
#include "search/winding.h"

#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include <stdexcept>

namespace nb = nanobind;
using namespace nb::literals;
using namespace qsdolfinx;

namespace
{
Vec3 vector_at(const In<double>& values, std::size_t i)
{
  return {values.view()[i], values.view()[i + 1], values.view()[i + 2]};
}
} // namespace

void qsdolfinx::bind_search(nb::module_& m)
{
  m.def(
      "within_body",
      [](const Surface& surface, In<double> x, In<double> normal, In<std::int64_t> facet)
      {
        std::vector<Vec3> points, normals;
        for (std::size_t i = 0; i < x.array.size(); i += 3)
        {
          points.push_back(vector_at(x, i));
          normals.push_back(vector_at(normal, i));
        }
        const std::vector<std::size_t> facets(facet.view().begin(), facet.view().end());
        const auto out = within_body(surface, points, normals, facets);
        return copy(out, {out.size()});
      },
      "surface"_a, "x"_a, "normal"_a, "facet"_a,
      "Whether places just outside of points of a body's boundary are within the body, [point]; "
      "collective.");
  m.attr("alike_cosine") = alike_cosine;
  m.attr("facing_cosine") = facing_cosine;
  m.def(
      "passed_depths",
      [](const Surface& surface, std::size_t num_pieces, In<double> facet_x, In<double> x,
         In<double> normal)
      {
        const auto out
            = passed_depths(surface, {num_pieces, facet_x.view(), x.view(), normal.view()});
        return copy(out, {out.size()});
      },
      "surface"_a, "num_pieces"_a, "facet_x"_a, "x"_a, "normal"_a,
      "Depths of paths within bodies that points have passed through, [point], 0 for all others; "
      "facet_x "
      "are the facets' vertices, [time][facet][vertex][3], x and normal the points and their "
      "normals, [time][point][3], at the ends of the pieces of the motion; collective.");
  nb::class_<SearchRadius>(m, "SearchRadius",
                           "Search distance, up to which points are paired: one value, or the size "
                           "of the larger facet there, if this is less.")
      .def(nb::init<double, bool>(), "largest"_a, "by_size"_a = false)
      .def_ro("largest", &SearchRadius::largest, "Largest search distance anywhere.");
  nb::implicitly_convertible<double, SearchRadius>();
  nb::class_<KeptPairs>(
      m, "KeptPairs",
      "Pairs of facets of two surfaces that move, searched for again when one may "
      "be missing; see search/kept_pairs.h.")
      .def(nb::init<const SearchRadius&, double>(), "radius"_a, "skin"_a = 0.0)
      .def_prop_ro("num_evaluations", &KeptPairs::num_evaluations, "Number of uses so far.")
      .def_prop_ro("num_searches", &KeptPairs::num_searches, "Number of searches among them.");

  m.def(
      "closest_facets",
      [](const Surface& nodes, const Surface& surface, const SearchRadius& radius)
      {
        const ClosestFacets c = closest_facets(nodes, surface, radius);
        const std::size_t n = c.found.size();
        return std::pair(copy(c.found, {n}), copy(c.x, {n, 3}));
      },
      "nodes"_a, "surface"_a, "radius"_a,
      "Whether a facet was found for each owned node, [node], and the closest points, [node][3]; "
      "collective.");
  m.def(
      "closest_points",
      [](In<double> x, In<double> normal, const Surface& own, const Surface& surface, double radius)
      {
        if (x.array.size() != normal.array.size())
          throw std::invalid_argument("closest_points: one normal for each point");
        const ClosestFacets c
            = closest_facets({x.view(), normal.view()}, own, surface, SearchRadius{radius});
        const std::size_t n = c.found.size(), nodes = surface.num_trace(), block = surface.block();
        nb::typed<nb::dict, nb::str, nb::any> out;
        out["found"] = copy(c.found, {n});
        out["x"] = copy(c.x, {n, 3});
        out["normal"] = copy(c.normal, {n, 3});
        out["mean_normal"] = copy(c.mean_normal, {n, 3});
        out["dofs"] = copy(c.dofs, {n, nodes, block});
        out["owner"] = copy(c.owner, {n, nodes});
        out["shape_values"] = copy(c.shape_values, {n, nodes});
        return out;
      },
      "x"_a, "normal"_a, "own"_a, "surface"_a, "radius"_a,
      "Closest points of a surface to the points x [point][3] of another: found [point], x, normal "
      "and mean_normal of all facets there [point][3], dofs [point][node][block], owner and "
      "shape_values [point][node] of the facet; collective.");
  m.def(
      "closest_point",
      [](int num_vertices, In<double> vertices, std::array<double, 3> p)
      {
        const auto c = closest_point(facet_type(num_vertices), vertices.view(), p);
        return std::tuple(c.distance, c.xi, c.x);
      },
      "num_vertices"_a, "vertices"_a, "p"_a,
      "Closest point of one facet to p: distance, reference coordinates, position.");
}
