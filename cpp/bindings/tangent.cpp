#include "bindings/arrays.h"
#include "bindings/module.h"
#include "tangent/friction.h"
#include "tangent/insertion.h"
#include "tangent/point_forces.h"
#include "tangent/products.h"
#include "tangent/rows.h"

#include <nanobind/stl/array.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <tuple>

namespace nb = nanobind;
using namespace nb::literals;
using namespace qsdolfinx;

namespace
{
ContactBlocks contact_blocks(const std::array<Handle, 4>& handles)
{
  ContactBlocks blocks;
  std::ranges::transform(handles, blocks.begin(),
                         [](Handle h) { return reinterpret_cast<Mat>(h); });
  return blocks;
}
} // namespace

void qsdolfinx::bind_tangent(nb::module_& m)
{
  m.def(
      "insert_contact",
      [](const GapOperator& gap, In<double> stiffness, std::array<Handle, 4> blocks,
         std::array<double, 2> scale, bool pattern)
      { insert_contact(gap, stiffness.view(), contact_blocks(blocks), scale, pattern); },
      "gap"_a, "stiffness"_a, "blocks"_a, "scale"_a, "pattern"_a,
      "Add Gᵀ D G to the blocks (ss, sm, ms, mm).");
  m.def(
      "insert_friction",
      [](const GapOperator& jump, const GapOperator& normal, In<double> stiffness,
         In<double> coupling, std::array<Handle, 4> blocks, std::array<double, 2> scale)
      {
        insert_friction(jump, normal, stiffness.view(), coupling.view(), contact_blocks(blocks),
                        scale);
      },
      "jump"_a, "normal"_a, "stiffness"_a, "coupling"_a, "blocks"_a, "scale"_a,
      "Add Jᵀ (D J + c G) to the blocks (ss, sm, ms, mm).");
  nb::class_<RowSums>(m, "RowSums", "Entries to be added to a matrix; see tangent/row_sums.h.")
      .def(
          "__init__",
          [](RowSums* self, Handle matrix) { new (self) RowSums(reinterpret_cast<Mat>(matrix)); },
          "matrix"_a, "For a matrix that must outlive this object.")
      .def(
          "add_entries",
          [](RowSums& sums, In<std::int64_t> rows, In<std::int64_t> columns, In<double> values)
          { sums.add_entries(rows.view(), columns.view(), values.view()); }, "rows"_a, "columns"_a,
          "values"_a,
          "Add entries in any order, in rows of any rank; negative numbers are left out.")
      .def(
          "add_squares",
          [](RowSums& sums, In<std::int64_t> numbers, In<double> values)
          {
            const std::size_t size = numbers.array.ndim() == 2 ? numbers.array.shape(1) : 0;
            if (values.array.size() != size * numbers.array.size())
              throw nb::value_error("values must be [block][row][row]");
            sums.add_squares(numbers.view(), values.view(), size);
          },
          "numbers"_a, "values"_a,
          "Add matrices, [block][row][row], with row numbers [block][row]; negative numbers are "
          "left out.")
      .def("insert", &RowSums::insert,
           "Insert all entries into the matrix, and assemble it. Collective.");
  m.def(
      "add_point_forces",
      [](RowSums& sums, const Pieces& pieces, const SlipOfPieces* slip,
         std::array<In<double>, 3> factors, std::array<In<double>, 2> derivatives,
         std::array<In<double>, 7> values, const std::vector<Handle>& fields,
         const std::vector<Handle>& missing, const std::vector<Handle>& begun, bool moves,
         bool gaps_move, In<std::int64_t> function_rows,
         const std::vector<const CompressedRows*>& functions, bool own,
         std::array<In<std::int64_t>, 2> numbers, std::array<double, 2> scale, std::int64_t tool,
         std::array<double, 3> way)
      {
        const std::size_t components = factors[0].array.size();
        const auto [pressure, traction, rest, turning, leaning, kept, kept_slopes] = values;
        PointState at{components,
                      factors[0].view(),
                      factors[1].view(),
                      factors[2].view(),
                      derivatives[0].view(),
                      derivatives[1].view(),
                      pressure.view(),
                      traction.view(),
                      rest.view(),
                      turning.view(),
                      leaning.view(),
                      kept.view(),
                      kept_slopes.view(),
                      {},
                      {},
                      {},
                      moves,
                      gaps_move};
        for (Handle field : fields)
          at.fields.push_back(reinterpret_cast<Vec>(field));
        for (Handle field : missing)
          at.missing.push_back(reinterpret_cast<Vec>(field));
        for (Handle field : begun)
          at.begun.push_back(reinterpret_cast<Vec>(field));
        add_point_forces(pieces, slip, at, {function_rows.view(), functions, own},
                         {sums, {numbers[0].view(), numbers[1].view()}, scale, tool, way});
      },
      "sums"_a, "pieces"_a, "slip"_a.none(), nb::kw_only(), "factors"_a, "derivatives"_a,
      "values"_a, "fields"_a, "missing"_a, "begun"_a, "moves"_a, "gaps_move"_a, "function_rows"_a,
      "functions"_a, "own"_a, "numbers"_a, "scale"_a, "tool"_a, "way"_a,
      "Add the derivative of the forces and of the equations of multipliers at the points of "
      "pieces: factors γ, a, and that of N in R_λ; derivatives D and those of r by λ; pressures, "
      "tractions, r, vectors that turn with facets, their components along normals, and the part "
      "of the trials that turns, with its derivatives by functions; λ, and a field of that part; "
      "see "
      "tangent/point_forces.h. Collective.");
  m.def(
      "free_unknowns",
      [](const Pieces& pieces, int side, Handle markers)
      {
        auto out = free_unknowns(side == 0 ? pieces.slave : pieces.master,
                                 reinterpret_cast<Vec>(markers));
        const std::size_t n = out.size();
        return copy(std::move(out), {n});
      },
      "pieces"_a, "side"_a, "markers"_a,
      "Unknowns of the slave (0) or master (1), negative where a Dirichlet condition holds, "
      "[piece][node][gdim]. Collective.");
  m.def(
      "put_rows",
      [](Handle block, Handle matrix, In<std::int32_t> rows,
         std::array<In<std::int64_t>, 2> row_numbers, std::array<In<std::int64_t>, 2> columns,
         int mode)
      {
        put_rows(reinterpret_cast<Mat>(block), reinterpret_cast<Mat>(matrix), rows.view(),
                 {row_numbers[0].view(), row_numbers[1].view()},
                 {columns[0].view(), columns[1].view()}, static_cast<RowMode>(mode));
      },
      "block"_a, "matrix"_a, "rows"_a, "row_numbers"_a, "column_numbers"_a, "mode"_a,
      "Insert rows of one body's block into the matrix of all bodies.");
  m.def(
      "count_entries",
      [](Handle block)
      {
        const std::vector<std::int32_t> counts = count_entries(reinterpret_cast<Mat>(block));
        return copy(counts, {2, counts.size() / 2});
      },
      "block"_a, "Numbers of entries in columns of this rank and in other columns, [2][row].");
  nb::class_<CompressedRows>(m, "CompressedRows",
                             "Rows of this rank over all unknowns; see tangent/products.h.")
      .def(
          "__init__",
          [](CompressedRows* self, In<std::int64_t> offset, In<std::int64_t> column,
             In<double> value)
          {
            const auto o = offset.view(), c = column.view();
            const auto v = value.view();
            new (self)
                CompressedRows{{o.begin(), o.end()}, {c.begin(), c.end()}, {v.begin(), v.end()}};
          },
          "offset"_a, "column"_a, "value"_a,
          "First entry of each row, [row + 1]; column numbers and values, [entry].");
  nb::class_<StackedRows>(m, "StackedRows",
                          "Rows of points over all unknowns; see tangent/products.h.")
      .def(nb::init<std::size_t, std::size_t>(), "num_points"_a, "components"_a)
      .def_prop_ro("components", &StackedRows::components)
      .def(
          "add_gaps",
          [](StackedRows& rows, const GapOperator& gap, int side, In<std::int64_t> numbers,
             double factor, std::size_t first)
          {
            const auto n = numbers.view();
            rows.add_gaps(gap, side, {n.begin(), n.end()}, factor, first);
          },
          "gap"_a, "side"_a, "numbers"_a, "factor"_a, "first"_a, nb::keep_alive<1, 2>(),
          "Add a factor times one side of an operator, in components from `first` on; `numbers` "
          "are the numbers of its unknowns, [column][block], negative where a Dirichlet condition "
          "holds.")
      .def("add_rows", &StackedRows::add_rows, "rows"_a, "factor"_a, "first"_a, "width"_a,
           nb::keep_alive<1, 2>(),
           "Add a factor times rows, `width` for each point, in components from `first` on.")
      .def(
          "entries",
          [](const StackedRows& rows)
          {
            std::vector<std::int64_t> row, column;
            std::vector<double> value;
            for (std::size_t i = 0; i < rows.num_rows(); ++i)
              rows.visit(i,
                         [&](PetscInt c, double v)
                         {
                           row.push_back(static_cast<std::int64_t>(i));
                           column.push_back(c);
                           value.push_back(v);
                         });
            const std::size_t n = value.size();
            return std::tuple(copy(std::move(row), {n}), copy(std::move(column), {n}),
                              copy(std::move(value), {n}));
          },
          "Rows, columns and values, [entry].");
  m.def(
      "add_products",
      [](RowSums& sums, const StackedRows& left, const StackedRows& right, In<double> D)
      { add_products(sums, left, right, D.view()); }, "sums"_a, "left"_a, "right"_a, "D"_a,
      "Add Lᵀ D R to a matrix; D has a number for each row, or a matrix [component][component] for "
      "each point.");
  m.def(
      "set_places", [](Handle matrix, In<std::int64_t> rows, In<std::int64_t> columns)
      { set_places(reinterpret_cast<Mat>(matrix), rows.view(), columns.view()); }, "matrix"_a,
      "rows"_a, "columns"_a,
      "Fix the non-zero pattern of a matrix; places may be in rows of any rank and repeat. "
      "Collective.");
  m.def(
      "set_values", [](Handle matrix, In<double> values)
      { set_values(reinterpret_cast<Mat>(matrix), values.view()); }, "matrix"_a, "values"_a,
      "Replace the entries of a matrix, in the order of its places. Collective.");
}
