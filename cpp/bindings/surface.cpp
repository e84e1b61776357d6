#include "surface/surface.h"
#include "bindings/arrays.h"
#include "bindings/module.h"
#include "surface/curvature.h"
#include "surface/heights.h"

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>

namespace nb = nanobind;
using namespace nb::literals;
using namespace qsdolfinx;

void qsdolfinx::bind_surface(nb::module_& m)
{
  nb::class_<Surface>(m, "Surface", "Distributed contact surface; see surface/surface.h.")
      .def(
          "__init__",
          [](Surface* self, int comm, int gdim, int block, int num_vertices, In<double> x,
             int degree, In<std::int64_t> dofs, In<int> owner, In<double> inside,
             std::int64_t local_size, bool axisymmetric, const std::optional<In<double>>& key)
          {
            new (self)
                Surface(MPI_Comm_f2c(comm), gdim, block, facet_type(num_vertices), x.view(), degree,
                        dofs.view(), owner.view(), inside.view(), local_size, axisymmetric,
                        key.has_value(), key ? key->view() : std::span<const double>{});
          },
          "comm"_a, "gdim"_a, "block"_a, "num_vertices"_a, "x"_a, "degree"_a, "dofs"_a, "owner"_a,
          "inside"_a, "local_size"_a, "axisymmetric"_a, "key"_a = nb::none(), "Collective.")
      .def(
          "move",
          [](Surface& s, In<double> x, In<double> inside) { s.move(x.view(), inside.view()); },
          "x"_a, "inside"_a, "Set new coordinates of the facets; collective.")
      .def(
          "follow", [](Surface& s, In<double> trace_x) { s.follow(trace_x.view()); }, "trace_x"_a,
          "Set new coordinates of the nodes of the trace, [facet][node][3]; local.")
      .def("measure_nodes", &Surface::measure_nodes,
           "Compute areas and normals of the nodes after `follow`; collective.")
      .def_prop_ro("facet_size_range", &Surface::facet_size_range,
                   "Smallest and largest facet size; collective.")
      .def_prop_ro(
          "facet_x",
          [](const Surface& s)
          {
            return copy(s.facets().x,
                        {s.num_facets(), static_cast<std::size_t>(s.num_vertices()), 3});
          },
          "Coordinates of the vertices, [facet][vertex][3].")
      .def_prop_ro(
          "facet_dofs",
          [](const Surface& s)
          {
            return copy(s.facets().dofs, {s.num_facets(), static_cast<std::size_t>(s.num_trace()),
                                          static_cast<std::size_t>(s.block())});
          },
          "Global unknowns of the trace, [facet][node][block].")
      .def(
          "sides_of_facets",
          [](const Surface& s, In<std::uint8_t> chosen)
          {
            return copy(s.sides_of_facets(chosen.view()),
                        {s.num_facets(), static_cast<std::size_t>(s.num_vertices())});
          },
          "chosen"_a,
          "Smooth side of chosen nodes that a facet belongs to, 0 at others, [facet][vertex]; "
          "collective.")
      .def_prop_ro(
          "vertex_side",
          [](const Surface& s)
          {
            return copy(s.facets().vertex_side,
                        {s.num_facets(), static_cast<std::size_t>(s.num_vertices())});
          },
          "Number of the smooth side to which a facet belongs at its vertices, [facet][vertex].")
      .def_prop_ro(
          "node_dofs", [](const Surface& s)
          { return copy(s.nodes().dofs, {s.nodes().size(), static_cast<std::size_t>(s.block())}); },
          "Global unknowns of the owned nodes, [node][block].")
      .def_prop_ro(
          "node_x", [](const Surface& s) { return copy(s.nodes().x, {s.nodes().size(), 3}); },
          "Coordinates of the owned nodes, [node][3].")
      .def_prop_ro(
          "node_area", [](const Surface& s) { return copy(s.nodes().area, {s.nodes().size()}); },
          "Areas S_k of the owned nodes, [node].")
      .def_prop_ro(
          "node_facet_size",
          [](const Surface& s) { return copy(s.nodes().facet_size, {s.nodes().size()}); },
          "Sizes of the largest facets at the owned nodes, [node].")
      .def_prop_ro(
          "node_normal",
          [](const Surface& s) { return copy(s.nodes().normal, {s.nodes().size(), 3}); },
          "Averaged outward unit normals at the owned nodes, [node][3].");

  const auto at_nodes = [](const Surface& s, std::vector<double> values)
  {
    const auto nodes = static_cast<std::size_t>(trace_size(s.type(), 2));
    return copy(std::move(values), {s.num_facets(), nodes, 3});
  };
  m.def(
      "flat_nodes", [at_nodes](const Surface& s) { return at_nodes(s, flat_nodes(s)); },
      "surface"_a, "Nodes of degree 2 on the flat facets, [facet][node][3].");
  m.def(
      "flat_normals", [at_nodes](const Surface& s) { return at_nodes(s, flat_normals(s)); },
      "surface"_a,
      "Outward unit normals of the flat facets at their nodes of degree 2, [facet][node][3].");
  m.def(
      "facet_curvature",
      [](const Surface& s)
      {
        std::vector<double> out;
        for (const Curvature& K : facet_curvature(s))
          out.insert(out.end(), K.begin(), K.end());
        return copy(std::move(out), {s.num_facets(), 6});
      },
      "surface"_a, "Curvature of the facets, [facet][xx, yy, zz, xy, xz, yz]; collective.");
  m.def(
      "edge_heights",
      [](const Surface& s)
      {
        const std::size_t edges = facet_edges(s.type()).size();
        return copy(edge_heights(s), {s.num_facets(), edges, 2});
      },
      "surface"_a,
      "Heights of the surface that the facets approximate above the middles of their edges, along "
      "the facets' normals, and their weights in a mean, [facet][edge][2]; collective.");
  m.def(
      "mean_of_rows",
      [](In<double> x, In<std::int32_t> rows)
      {
        const std::size_t n = rows.array.shape(0), width = rows.array.shape(1);
        const auto points = x.view();
        const auto numbers = rows.view();
        std::vector<double> out(3 * n, 0.0);
        for (std::size_t i = 0; i < n; ++i)
          for (std::size_t j = 0; j < width; ++j)
            for (std::size_t k = 0; k < 3; ++k)
              out[3 * i + k] += points[3 * numbers[i * width + j] + k] / width;
        return copy(std::move(out), {n, 3});
      },
      "x"_a, "rows"_a,
      "Means of points x [point][3], one mean for each row of point numbers, [row][3].");
  m.def(
      "trace_values",
      [](int num_vertices, int degree, In<double> xi)
      {
        const FacetType type = facet_type(num_vertices);
        const std::size_t n = xi.array.shape(0), dim = xi.array.shape(1);
        const auto nodes = static_cast<std::size_t>(trace_size(type, degree));
        const auto points = xi.view();
        std::vector<double> out;
        for (std::size_t i = 0; i < n; ++i)
        {
          const auto T = trace_functions(type, degree,
                                         {points[i * dim], dim > 1 ? points[i * dim + 1] : 0.0});
          out.insert(out.end(), T.begin(), T.begin() + static_cast<std::ptrdiff_t>(nodes));
        }
        return copy(std::move(out), {n, nodes});
      },
      "num_vertices"_a, "degree"_a, "xi"_a, "Trace functions at points of a facet, [point][node].");
  m.def(
      "trace_gradients",
      [](int num_vertices, int degree, In<double> xi)
      {
        const FacetType type = facet_type(num_vertices);
        const std::size_t n = xi.array.shape(0), dim = xi.array.shape(1);
        const auto nodes = static_cast<std::size_t>(trace_size(type, degree));
        const auto points = xi.view();
        std::vector<double> out;
        for (std::size_t i = 0; i < n; ++i)
        {
          const auto T = trace_gradients(type, degree,
                                         {points[i * dim], dim > 1 ? points[i * dim + 1] : 0.0});
          for (std::size_t j = 0; j < nodes; ++j)
            out.insert(out.end(), T[j].begin(), T[j].end());
        }
        return copy(std::move(out), {n, nodes, 2});
      },
      "num_vertices"_a, "degree"_a, "xi"_a,
      "Derivatives of the trace functions, [point][node][2].");
  m.def(
      "count_degenerate", [](int num_vertices, In<double> x)
      { return count_degenerate(facet_type(num_vertices), x.view()); }, "num_vertices"_a, "x"_a,
      "Number of facets x [facet][vertex][3] that have no area or are not convex.");
}
