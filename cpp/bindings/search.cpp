#include "search/search.h"
#include "bindings/arrays.h"
#include "bindings/module.h"
#include "geometry/projection.h"

#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include <stdexcept>

namespace nb = nanobind;
using namespace nb::literals;
using namespace qsdolfinx;

void qsdolfinx::bind_search(nb::module_& m)
{
  m.def(
      "closest_facets",
      [](const Surface& nodes, const Surface& surface, double radius)
      {
        const ClosestFacets c = closest_facets(nodes, surface, radius);
        const std::size_t n = c.found.size();
        return std::pair(copy(c.found, {n}), copy(c.x, {n, 3}));
      },
      "nodes"_a, "surface"_a, "radius"_a,
      "Which owned nodes find a facet, [node], and the closest points, [node][3]; collective.");
  m.def(
      "closest_points",
      [](In<double> x, In<double> normal, const Surface& own, const Surface& surface, double radius)
      {
        if (x.array.size() != normal.array.size())
          throw std::invalid_argument("closest_points: one normal for each point");
        const ClosestFacets c = closest_facets({x.view(), normal.view()}, own, surface, radius);
        const std::size_t n = c.found.size();
        return std::tuple(copy(c.found, {n}), copy(c.x, {n, 3}), copy(c.mean_normal, {n, 3}));
      },
      "x"_a, "normal"_a, "own"_a, "surface"_a, "radius"_a,
      "Which points x [point][3] of a surface find a facet of another, [point], the closest "
      "points, "
      "[point][3], and means of the normals of the facets there; collective.");
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
