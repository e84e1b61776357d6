#include "gap/gap.h"
#include "bindings/arrays.h"
#include "bindings/module.h"
#include "gap/point_rows.h"

#include <nanobind/stl/array.h>
#include <nanobind/stl/tuple.h>

#include <tuple>

namespace nb = nanobind;
using namespace nb::literals;
using namespace qsdolfinx;

namespace
{
std::array<Vec, 2> vecs(Handle slave, Handle master)
{
  return {reinterpret_cast<Vec>(slave), reinterpret_cast<Vec>(master)};
}
} // namespace

void qsdolfinx::bind_gap(nb::module_& m)
{
  nb::class_<SlipOfPieces>(m, "SlipOfPieces", "Slip at the points of pieces; see gap/point_rows.h.")
      .def(
          "__init__",
          [](SlipOfPieces* self, const Pieces& pieces, Handle slave, Handle master,
             In<double> of_tool)
          {
            new (self) SlipOfPieces(pieces, reinterpret_cast<Vec>(slave),
                                    reinterpret_cast<Vec>(master), of_tool.view());
          },
          "pieces"_a, "slave"_a, "master"_a, "of_tool"_a,
          "From the positions of the nodes when slip began; collective.")
      .def_prop_ro(
          "slip", [](const SlipOfPieces& s) { return copy(s.slip, {s.slip.size() / 3, 3}); },
          "Slip of the slave against the master, [point][3].")
      .def_prop_ro(
          "normal", [](const SlipOfPieces& s) { return copy(s.normal, {s.normal.size() / 3, 3}); },
          "Normals outward of the slave, [point][3].")
      .def_prop_ro(
          "arc", [](const SlipOfPieces& s) { return copy(s.arc, {s.arc.size()}); },
          "Arc length along the facets divided by the slip, which is its chord, [point].")
      .def_prop_ro(
          "gap", [](const SlipOfPieces& s) { return copy(s.gap, {s.gap.size()}); },
          "Gap of the same material points when slip began, positive in penetration, [point].")
      .def(
          "turns",
          [](const SlipOfPieces& s, const Pieces& pieces)
          {
            std::vector<double> out;
            out.reserve(9 * pieces.points.size());
            for (std::size_t i = 0; i < pieces.size(); ++i)
              for (std::size_t p = 0; p < pieces.points_of(i).size(); ++p)
                out.insert(out.end(), &s.turn[9 * i], &s.turn[9 * i] + 9);
            return copy(std::move(out), {pieces.points.size(), 3, 3});
          },
          "pieces"_a,
          "Rotation of vectors that turn with the facets of slip since slip began, [point][3][3].");
  m.def("points_of_pieces", &points_of_pieces, "slave"_a, "master"_a.none(), "pieces"_a,
        "Points of pieces as pairing points without normals.");
  nb::class_<GapOperator>(m, "GapOperator",
                          "Operator of the weighted gaps of the slave nodes of this rank; see "
                          "gap/gap.h.")
      .def(
          "__init__",
          [](GapOperator* self, const Surface& slave, const Surface* master,
             const PairingPoints& points, bool jump, int rows)
          {
            new (self) GapOperator(slave, master, points, jump ? GapKind::jump : GapKind::normal,
                                   static_cast<GapRows>(rows));
          },
          "slave"_a, "master"_a.none(), "points"_a, "jump"_a, "rows"_a,
          "Rows are nodes (0), nodes with their covered areas (1), or points (2); collective.")
      .def(
          "__init__",
          [](GapOperator* self, const Surface* master, const Pieces& pieces, In<std::int64_t> alone,
             In<double> weight, double far)
          { new (self) GapOperator(master, pieces, alone.view(), weight.view(), far); },
          "master"_a.none(), "points_of"_a, nb::kw_only(), "alone"_a, "weight"_a, "far"_a,
          "Derivative of gaps with updated geometry, a row for each point of pieces; see "
          "gap/gap.h.")
      .def(
          "__init__",
          [](GapOperator* self, const Surface* master, const Pieces& pieces, In<std::int64_t> alone,
             In<double> weight)
          { new (self) GapOperator(master, pieces, alone.view(), weight.view()); },
          "master"_a.none(), "jump_of"_a, nb::kw_only(), "alone"_a, "weight"_a,
          "Relative position at the points of pieces; see gap/gap.h.")
      .def(
          "__init__",
          [](GapOperator* self, const Surface* master, const Pieces& pieces,
             const SlipOfPieces& slip, bool works, In<double> weight)
          { new (self) GapOperator(master, pieces, slip, works, weight.view()); },
          "master"_a.none(), "points_of"_a, "slip"_a, nb::kw_only(), "works"_a, "weight"_a,
          "Derivative of slip at the points of pieces, or the variation that tractions work on.")
      .def_prop_ro("num_rows", &GapOperator::num_rows)
      .def_prop_ro("turns", &GapOperator::turns, "Whether a jump is co-rotated with facets.")
      .def_prop_ro("width", &GapOperator::width,
                   "Values per row: 1, or for a jump the unknowns of a node.")
      .def_prop_ro(
          "row_node",
          [](const GapOperator& g) { return copy(g.row_node(), {g.row_node().size()}); },
          "Index of each row's node in the slave's nodes, [row]; empty if rows are points.")
      .def_prop_ro(
          "row_side",
          [](const GapOperator& g) { return copy(g.row_side(), {g.row_side().size()}); },
          "Smooth side of the row's node, [row]; empty if sides are not distinguished.")
      .def_prop_ro(
          "row_in_corner",
          [](const GapOperator& g) { return copy(g.row_in_corner(), {g.row_in_corner().size()}); },
          "Whether the row's node may have a row for each side, [row]; empty likewise.")
      .def_prop_ro(
          "row_area", [](const GapOperator& g) { return copy(g.row_area(), {g.num_rows()}); },
          "Area by which each row's gap is divided: S_k, its covered part, or w_p, [row].")
      .def_prop_ro(
          "initial_gap", [](const GapOperator& g) { return copy(g.initial_gap(), {g.num_rows()}); },
          "Initial weighted gap, zero for a jump, [row].")
      .def_prop_ro(
          "slave_sum",
          [](const GapOperator& g)
          {
            const std::size_t width = g.kind() == GapKind::normal ? g.block() : 1;
            return copy(g.slave_sum(), {g.num_rows(), width});
          },
          "Sum of the slave's coefficients, [row][gdim], for a jump [row][1].")
      .def(
          "entries",
          [](const GapOperator& g, int side)
          {
            const GapOperator::Side& s = g.side(side);
            return std::tuple(copy(s.offset, {s.offset.size()}), copy(s.column, {s.column.size()}),
                              copy(s.coefficient, {s.column.size(), g.entry_size()}));
          },
          "side"_a,
          "Entries of one side: first entry of each row, [row + 1]; column node of each entry, "
          "[entry]; coefficients, [entry][gdim], for a jump [entry][1], or [entry][gdim * gdim] if "
          "it is co-rotated.")
      .def(
          "columns",
          [](const GapOperator& g, int side)
          {
            const auto& dofs = g.side(side).free_dofs;
            const auto d = static_cast<std::size_t>(g.block());
            return copy(std::vector<std::int64_t>(dofs.begin(), dofs.end()), {dofs.size() / d, d});
          },
          "side"_a,
          "Unknowns of one side's nodes, -1 where Dirichlet conditions hold, [column][block].")
      .def_prop_ro("num_sides", &GapOperator::num_sides, "2, or 1 if the master is rigid.")
      .def(
          "apply",
          [](GapOperator& g, Handle slave, Handle master, std::array<double, 2> scale)
          {
            return copy(g.apply(vecs(slave, master), scale),
                        {g.num_rows(), static_cast<std::size_t>(g.width())});
          },
          "slave"_a, "master"_a, "scale"_a = std::array{1.0, 1.0},
          "Linear part of the gap, [row][width]; collective.")
      .def(
          "add_transpose", [](GapOperator& g, In<double> f, Handle slave, Handle master)
          { g.add_transpose(f.view(), vecs(slave, master)); }, "f"_a, "slave"_a, "master"_a,
          "Add the transposed operator times f; collective.")
      .def_prop_ro(
          "functions",
          [](const GapOperator& g)
          {
            const GapOperator::Side& s = g.multipliers();
            std::vector<std::int64_t> unknowns;
            unknowns.reserve(s.column.size());
            for (std::int32_t column : s.column)
              unknowns.push_back(s.dofs[column]);
            return std::tuple(copy(s.offset, {s.offset.size()}),
                              copy(std::move(unknowns), {s.column.size()}),
                              copy(s.coefficient, {s.coefficient.size()}));
          },
          "N_k at points: first entry of each row, [row + 1]; unknowns that represent a side of a "
          "node, and values, [entry].")
      .def(
          "at_points", [](GapOperator& g, Handle nodal)
          { return copy(g.at_points(reinterpret_cast<Vec>(nodal)), {g.num_rows()}); }, "nodal"_a,
          "Values of a field on the slave, with a component for each side, at the points; "
          "collective.")
      .def(
          "add_to_nodes", [](GapOperator& g, In<double> f, Handle nodal)
          { g.add_to_nodes(f.view(), reinterpret_cast<Vec>(nodal)); }, "f"_a, "nodal"_a,
          "Add the sums of N_k times the values at the points to the nodes; collective.")
      .def(
          "raise_nodes", [](GapOperator& g, In<double> f, Handle nodal)
          { g.raise_nodes(f.view(), reinterpret_cast<Vec>(nodal)); }, "f"_a, "nodal"_a,
          "Raise the values of nodes to the largest value at the points beside them; collective.")
      .def(
          "constrain",
          [](GapOperator& g, Handle slave, Handle master) { g.constrain(vecs(slave, master)); },
          "slave"_a, "master"_a, "Mark constrained unknowns; collective.");
}
