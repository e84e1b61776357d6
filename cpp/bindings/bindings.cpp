// Python bindings. Communicators come as Fortran handles (mpi4py's comm.py2f()), PETSc objects as
// the `handle` of petsc4py's, so that no header or binary interface of mpi4py or petsc4py is
// needed.
#include "geometry/projection.h"
#include "pairing/overlay.h"
#include "pairing/pairing.h"
#include "pairing/rigid.h"
#include "search/search.h"
#include "surface/surface.h"
#include "tangent/friction.h"
#include "tangent/insertion.h"
#include "tangent/rows.h"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>

namespace nb = nanobind;
using namespace nb::literals;
using namespace qsdolfinx;

namespace
{
template <typename T>
using In = nb::ndarray<const T, nb::c_contig, nb::device::cpu>;

template <typename T>
std::span<const T> view(const In<T>& a)
{
  return {a.data(), a.size()};
}

/// NumPy array that owns the data: a copy, unless they are temporary.
template <typename T>
nb::object copy(std::vector<T> data, std::initializer_list<std::size_t> shape)
{
  auto* owned = new std::vector<T>(std::move(data));
  nb::capsule owner(owned, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return nb::cast(nb::ndarray<nb::numpy, T>(owned->data(), shape, owner));
}

FacetType facet_type(int num_vertices)
{
  if (num_vertices < 2 || num_vertices > 4)
    throw nb::value_error("a facet has 2, 3 or 4 vertices");
  return static_cast<FacetType>(num_vertices);
}

/// Quadrature rule from points [point][dim] and weights, scaled to sum to 1.
Rule rule(const In<double>& x, const In<double>& w)
{
  const std::size_t n = w.size(), dim = x.size() / n;
  Rule out{{}, {w.data(), w.data() + n}};
  double total = 0;
  for (std::size_t i = 0; i < n; ++i)
  {
    out.x.push_back({x.data()[i * dim], dim > 1 ? x.data()[i * dim + 1] : 0.0});
    total += out.w[i];
  }
  for (double& value : out.w)
    value /= total;
  return out;
}

using Handle = std::uintptr_t;
std::array<Vec, 2> vecs(std::array<Handle, 2> h)
{
  return {reinterpret_cast<Vec>(h[0]), reinterpret_cast<Vec>(h[1])};
}

nb::dict as_dict(const PairingSide& side, std::size_t n, std::size_t gdim)
{
  const std::size_t nv = side.num_nodes;
  nb::dict out;
  out["x"] = copy(side.x, {n, 3});
  out["dofs"] = copy(side.dofs, {n, nv, gdim});
  out["owner"] = copy(side.owner, {n, nv});
  out["shape_values"] = copy(side.shape_values, {n, nv});
  return out;
}

void bind_surface(nb::module_& m)
{
  nb::class_<Surface>(m, "Surface", "Distributed contact surface.")
      .def(
          "__init__",
          [](Surface* self, int comm, int gdim, int num_vertices, In<double> x, int degree,
             In<std::int64_t> dofs, In<int> owner, In<double> inside, std::int64_t local_size,
             bool axisymmetric)
          {
            new (self) Surface(MPI_Comm_f2c(comm), gdim, facet_type(num_vertices), view(x), degree,
                               view(dofs), view(owner), view(inside), local_size, axisymmetric);
          },
          "comm"_a, "gdim"_a, "num_vertices"_a, "x"_a, "degree"_a, "dofs"_a, "owner"_a, "inside"_a,
          "local_size"_a, "axisymmetric"_a, "Collective. See surface.h.")
      .def(
          "move",
          [](Surface& s, In<double> x, In<double> inside) { s.move(view(x), view(inside)); }, "x"_a,
          "inside"_a, "Other coordinates of the facets; collective.")
      .def_prop_ro("facet_size_range", &Surface::facet_size_range)
      .def_prop_ro("facet_x",
                   [](const Surface& s)
                   {
                     return copy(s.facets().x,
                                 {s.num_facets(), static_cast<std::size_t>(s.num_vertices()), 3});
                   })
      .def_prop_ro("facet_dofs",
                   [](const Surface& s)
                   {
                     return copy(s.facets().dofs,
                                 {s.num_facets(), static_cast<std::size_t>(s.num_trace()),
                                  static_cast<std::size_t>(s.gdim())});
                   })
      .def_prop_ro(
          "node_dofs", [](const Surface& s)
          { return copy(s.nodes().dofs, {s.nodes().size(), static_cast<std::size_t>(s.gdim())}); })
      .def_prop_ro("node_x",
                   [](const Surface& s) { return copy(s.nodes().x, {s.nodes().size(), 3}); })
      .def_prop_ro("node_area",
                   [](const Surface& s) { return copy(s.nodes().area, {s.nodes().size()}); })
      .def_prop_ro("node_normal",
                   [](const Surface& s) { return copy(s.nodes().normal, {s.nodes().size(), 3}); });

  m.def(
      "mean_of_rows",
      [](In<double> x, In<std::int32_t> rows)
      {
        const std::size_t n = rows.shape(0), width = rows.shape(1);
        std::vector<double> out(3 * n, 0.0);
        for (std::size_t i = 0; i < n; ++i)
          for (std::size_t j = 0; j < width; ++j)
            for (std::size_t k = 0; k < 3; ++k)
              out[3 * i + k] += x.data()[3 * rows.data()[i * width + j] + k] / width;
        return copy(std::move(out), {n, 3});
      },
      "x"_a, "rows"_a, "Means of points (x is [point][3]), one of each row of their numbers.");
  m.def(
      "count_degenerate", [](int num_vertices, In<double> x)
      { return count_degenerate(facet_type(num_vertices), view(x)); }, "num_vertices"_a, "x"_a,
      "Facets without area, or not convex.");
}

void bind_pairing(nb::module_& m)
{
  nb::class_<PairingPoints>(m, "PairingPoints", "Pairing points of one pass.")
      .def_prop_ro("size", &PairingPoints::size)
      .def_prop_ro("slave", [](const PairingPoints& p)
                   { return as_dict(p.slave, p.size(), static_cast<std::size_t>(p.gdim)); })
      .def_prop_ro("master", [](const PairingPoints& p)
                   { return as_dict(p.master, p.size(), static_cast<std::size_t>(p.gdim)); })
      .def_prop_ro("multiplier_values",
                   [](const PairingPoints& p)
                   {
                     return copy(p.multiplier_values,
                                 {p.size(), static_cast<std::size_t>(p.num_multipliers)});
                   })
      .def_prop_ro("normal", [](const PairingPoints& p) { return copy(p.normal, {p.size(), 3}); })
      .def_prop_ro("gap", [](const PairingPoints& p) { return copy(p.gap, {p.size()}); })
      .def_prop_ro("weight", [](const PairingPoints& p) { return copy(p.weight, {p.size()}); })
      .def_ro("num_unpaired", &PairingPoints::num_unpaired);

  m.def(
      "pair_surfaces",
      [](const Surface& slave, const Surface& master, bool both, double radius, int normals)
      {
        return pair_surfaces(slave, master, both ? Sampling::both : Sampling::slave_nodes, radius,
                             static_cast<Normals>(normals));
      },
      "slave"_a, "master"_a, "both"_a, "radius"_a, "normals"_a,
      "Nodal pairing points; collective.");
  m.def(
      "overlay_surfaces",
      [](const Surface& slave, const Surface& master, bool both, double radius, int normals,
         In<double> piece_x, In<double> piece_w, In<double> edge_x, In<double> edge_w)
      {
        const OverlayRules rules{rule(piece_x, piece_w), rule(edge_x, edge_w)};
        return overlay_surfaces(slave, master, both, radius, static_cast<Normals>(normals), rules);
      },
      "slave"_a, "master"_a, "both"_a, "radius"_a, "normals"_a, "piece_x"_a, "piece_w"_a,
      "edge_x"_a, "edge_w"_a, "Pairing points on the overlay; collective.");
  m.def(
      "closest_facets",
      [](const Surface& nodes, const Surface& surface, double radius)
      {
        const ClosestFacets c = closest_facets(nodes, surface, radius);
        const std::size_t n = c.found.size();
        return nb::make_tuple(copy(c.found, {n}), copy(c.x, {n, 3}));
      },
      "nodes"_a, "surface"_a, "radius"_a,
      "Which owned nodes find a facet of the other surface, and the closest points; collective.");
  m.def(
      "closest_point",
      [](int num_vertices, In<double> vertices, std::array<double, 3> p)
      {
        const auto c = closest_point(facet_type(num_vertices), view(vertices), p);
        return nb::make_tuple(c.distance, c.xi, c.x);
      },
      "num_vertices"_a, "vertices"_a, "p"_a,
      "Closest point of one facet to p: distance, reference coordinates, position.");
}

void bind_rigid(nb::module_& m)
{
  m.def("sample_nodes", &sample_nodes, "slave"_a, "Points at the nodes, without a master.");
  m.def(
      "sample_facets", [](const Surface& slave, In<double> x, In<double> w)
      { return sample_facets(slave, rule(x, w)); }, "slave"_a, "x"_a, "w"_a,
      "Quadrature points on the facets, without a master.");
  m.def(
      "face_tool",
      [](PairingPoints& points, In<std::uint8_t> keep, In<double> normal, In<double> gap,
         std::size_t group) { face_tool(points, view(keep), view(normal), view(gap), group); },
      "points"_a, "keep"_a, "normal"_a, "gap"_a, "group"_a,
      "Set normals and gaps, and drop points; see rigid.h.");
  m.def("forget_master", &forget_master, "points"_a, "Forget the unknowns of the master.");
}

void bind_gap(nb::module_& m)
{
  nb::class_<GapOperator>(m, "GapOperator", "Weighted gaps of the slave nodes of this rank.")
      .def(
          "__init__",
          [](GapOperator* self, const Surface& slave, const Surface* master,
             const PairingPoints& points, bool jump, bool by_cover)
          {
            new (self) GapOperator(slave, master, points, jump ? GapKind::jump : GapKind::normal,
                                   by_cover);
          },
          "slave"_a, "master"_a.none(), "points"_a, "jump"_a, "by_cover"_a,
          "Collective. See gap.h.")
      .def_prop_ro("num_rows", &GapOperator::num_rows)
      .def_prop_ro("width", &GapOperator::width)
      .def_prop_ro("row_node",
                   [](const GapOperator& g) { return copy(g.row_node(), {g.num_rows()}); })
      .def_prop_ro("row_area",
                   [](const GapOperator& g) { return copy(g.row_area(), {g.num_rows()}); })
      .def_prop_ro("initial_gap",
                   [](const GapOperator& g) { return copy(g.initial_gap(), {g.num_rows()}); })
      .def_prop_ro("slave_sum",
                   [](const GapOperator& g)
                   {
                     const std::size_t width = g.kind() == GapKind::normal ? g.gdim() : 1;
                     return copy(g.slave_sum(), {g.num_rows(), width});
                   })
      .def(
          "apply",
          [](GapOperator& g, Handle slave, Handle master, std::array<double, 2> scale)
          {
            return copy(g.apply(vecs({slave, master}), scale),
                        {g.num_rows(), static_cast<std::size_t>(g.width())});
          },
          "slave"_a, "master"_a, "scale"_a = std::array{1.0, 1.0},
          "Linear part of the gap, shape (rows, width); collective.")
      .def(
          "add_transpose",
          [](GapOperator& g, In<double> f, Handle slave, Handle master, bool slave_only)
          { g.add_transpose(view(f), vecs({slave, master}), slave_only); }, "f"_a, "slave"_a,
          "master"_a, "slave_only"_a, "Add the transposed operator times f; collective.")
      .def(
          "constrain",
          [](GapOperator& g, Handle slave, Handle master) { g.constrain(vecs({slave, master})); },
          "slave"_a, "master"_a, "Mark constrained unknowns; collective.");

  m.def(
      "insert_contact",
      [](const GapOperator& g, In<double> stiffness, std::array<Handle, 4> blocks,
         std::array<double, 2> scale, bool slave_only, bool pattern)
      {
        ContactBlocks mats;
        for (std::size_t i = 0; i < 4; ++i)
          mats[i] = reinterpret_cast<Mat>(blocks[i]);
        insert_contact(g, view(stiffness), mats, scale, slave_only, pattern);
      },
      "gap"_a, "stiffness"_a, "blocks"_a, "scale"_a, "slave_only"_a, "pattern"_a,
      "Add Gᵀ D G to the blocks (ss, sm, ms, mm).");
  m.def(
      "insert_friction",
      [](const GapOperator& jump, const GapOperator& normal, In<double> stiffness,
         In<double> coupling, std::array<Handle, 4> blocks, std::array<double, 2> scale,
         bool slave_only)
      {
        ContactBlocks mats;
        for (std::size_t i = 0; i < 4; ++i)
          mats[i] = reinterpret_cast<Mat>(blocks[i]);
        insert_friction(jump, normal, view(stiffness), view(coupling), mats, scale, slave_only);
      },
      "jump"_a, "normal"_a, "stiffness"_a, "coupling"_a, "blocks"_a, "scale"_a, "slave_only"_a,
      "Add Jᵀ (D J + c G) to the blocks (ss, sm, ms, mm).");
}

void bind_rows(nb::module_& m)
{
  m.def(
      "put_rows",
      [](Handle block, Handle matrix, In<std::int32_t> rows,
         std::array<In<std::int64_t>, 2> row_numbers, std::array<In<std::int64_t>, 2> columns,
         int mode)
      {
        put_rows(reinterpret_cast<Mat>(block), reinterpret_cast<Mat>(matrix), view(rows),
                 {view(row_numbers[0]), view(row_numbers[1])}, {view(columns[0]), view(columns[1])},
                 static_cast<RowMode>(mode));
      },
      "block"_a, "matrix"_a, "rows"_a, "row_numbers"_a, "column_numbers"_a, "mode"_a,
      "Put rows of one body's block into the matrix of all bodies.");
  m.def(
      "count_entries",
      [](Handle block)
      {
        const std::vector<std::int32_t> counts = count_entries(reinterpret_cast<Mat>(block));
        return copy(counts, {2, counts.size() / 2});
      },
      "block"_a, "Number of entries in own and in other columns, [2][row].");
}
} // namespace

NB_MODULE(_cpp, m)
{
  m.doc() = "Contact kernels of qsdolfinx: surface, search, pairing points, weighted gap, blocks.";
  bind_surface(m);
  bind_pairing(m);
  bind_rigid(m);
  bind_gap(m);
  bind_rows(m);
}
