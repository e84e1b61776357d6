// Products Lᵀ D R of rows over all unknowns of the equations; the rows themselves are never
// assembled.
#pragma once

#include "gap/gap.h"
#include "tangent/row_sums.h"

#include <petscmat.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Rows of this rank in compressed form. Columns are numbers among all unknowns; negative columns
/// are ignored.
struct CompressedRows
{
  std::vector<std::int64_t> offset; ///< entries of row i: [offset[i], offset[i + 1])
  std::vector<PetscInt> column;     ///< of each entry
  std::vector<double> value;        ///< of each entry
};

/// Entries of a row from one part of a StackedRows: groups of consecutive numbers among all
/// unknowns.
struct Run
{
  const PetscInt* numbers;  ///< group j begins at numbers + node[j] * stride
  const std::int32_t* node; ///< [group]; null for one group at `numbers`
  std::size_t count, width, stride;
  const double* values; ///< of group j from values + j * step on
  std::size_t step;
  double factor;

  const PetscInt* group(std::size_t j) const { return node ? numbers + node[j] * stride : numbers; }
  /// Whether the entries have the columns of those of another run.
  bool same_columns(const Run& other) const
  {
    if (count != other.count || width != other.width)
      return false;
    return node ? numbers == other.numbers && std::equal(node, node + count, other.node)
                : std::equal(numbers, numbers + count * width, other.numbers);
  }
};

/// A sum of rows of gap operators and of other rows, `components` rows for each point. The parts
/// are stored by reference and must outlive the object.
class StackedRows
{
public:
  StackedRows(std::size_t num_points, std::size_t components)
      : num_points_(num_points), components_(components)
  {
  }

  std::size_t num_points() const { return num_points_; }
  std::size_t components() const { return components_; }
  std::size_t num_rows() const { return num_points_ * components_; }

  /// Add a factor times one side of an operator, in components from `first` on.
  /// @param numbers numbers of the side's unknowns among all unknowns, [column][block]; negative
  /// where a Dirichlet condition holds
  void add_gaps(const GapOperator& gap, int side, std::vector<PetscInt> numbers, double factor,
                std::size_t first);
  /// Add a factor times rows, `width` for each point, in components from `first` on.
  void add_rows(const CompressedRows& rows, double factor, std::size_t first, std::size_t width);

  /// Call visit(column, value) for the entries of a row. A column may occur several times.
  template <typename Visit>
  void visit(std::size_t row, Visit visit) const;
  /// Call visit(run) for the runs of a row; negative columns are to be ignored.
  template <typename Visit>
  void visit_runs(std::size_t row, Visit visit) const;

private:
  struct Gaps
  {
    const GapOperator* gap;
    int side;
    std::vector<PetscInt> numbers;
    double factor;
    std::size_t first;
  };
  struct Others
  {
    const CompressedRows* rows;
    double factor;
    std::size_t first, width;
  };

  std::size_t num_points_, components_;
  std::vector<Gaps> gaps_;
  std::vector<Others> others_;
};

template <typename Visit>
void StackedRows::visit(std::size_t row, Visit visit) const
{
  visit_runs(row,
             [&visit](const Run& run)
             {
               for (std::size_t j = 0; j < run.count; ++j)
                 for (std::size_t i = 0; i < run.width; ++i)
                   if (run.group(j)[i] >= 0)
                     visit(run.group(j)[i], run.factor * run.values[j * run.step + i]);
             });
}

template <typename Visit>
void StackedRows::visit_runs(std::size_t row, Visit visit) const
{
  const std::size_t point = row / components_, component = row % components_;
  for (const Gaps& part : gaps_)
  {
    const GapOperator& gap = *part.gap;
    const std::size_t d = gap.block(), size = gap.entry_size(), k = component - part.first;
    if (component < part.first || k >= std::size_t(gap.width()))
      continue;
    const GapOperator::Side& side = gap.side(part.side);
    const auto first = static_cast<std::size_t>(side.offset[point]),
               count = static_cast<std::size_t>(side.offset[point + 1]) - first;
    const bool single = size == 1 && gap.kind() == GapKind::jump; // or all unknowns of the node
    visit(Run{part.numbers.data() + (single ? k : 0), side.column.data() + first, count,
              single ? 1 : d, d, side.coefficient.data() + first * size + (single ? 0 : k * d),
              size, part.factor});
  }
  for (const Others& part : others_)
  {
    const std::size_t k = component - part.first;
    if (component < part.first || k >= part.width)
      continue;
    const std::size_t i = point * part.width + k;
    const auto first = static_cast<std::size_t>(part.rows->offset[i]),
               last = static_cast<std::size_t>(part.rows->offset[i + 1]);
    visit(Run{part.rows->column.data() + first, nullptr, 1, last - first, 0,
              part.rows->value.data() + first, 0, part.factor});
  }
}

/// Add Lᵀ D R to a matrix over all unknowns. Consecutive points with the same columns, such as the
/// points of a piece, are inserted as one block. Where D is zero, explicit zeros are inserted, so
/// that the pattern stays the same.
///
/// @param D a number for each row, or a matrix [component][component] for each point
void add_products(RowSums& sums, const StackedRows& left, const StackedRows& right,
                  std::span<const double> D);

} // namespace qsdolfinx
