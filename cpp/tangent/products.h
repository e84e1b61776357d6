// Products Lᵀ D R of rows over all unknowns of the equations; the rows themselves are never
// assembled.
#pragma once

#include "gap/gap.h"
#include "tangent/row_sums.h"

#include <petscmat.h>

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
  /// Call visit(columns, values, count, factor) for runs of entries of a row; negative columns are
  /// to be ignored.
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
  visit_runs(
      row,
      [&visit](const PetscInt* columns, const double* values, std::size_t count, double factor)
      {
        for (std::size_t i = 0; i < count; ++i)
          if (columns[i] >= 0)
            visit(columns[i], factor * values[i]);
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
    for (std::int64_t e = side.offset[point]; e < side.offset[point + 1]; ++e)
    {
      const PetscInt* numbers = &part.numbers[side.column[e] * d];
      const double* c = &side.coefficient[e * size];
      if (size == 1 && gap.kind() == GapKind::jump)
        visit(numbers + k, c, 1, part.factor);
      else // all unknowns of the node
        visit(numbers, c + k * d, d, part.factor);
    }
  }
  for (const Others& part : others_)
  {
    const std::size_t k = component - part.first;
    if (component < part.first || k >= part.width)
      continue;
    const std::size_t i = point * part.width + k;
    const auto first = static_cast<std::size_t>(part.rows->offset[i]),
               last = static_cast<std::size_t>(part.rows->offset[i + 1]);
    visit(part.rows->column.data() + first, part.rows->value.data() + first, last - first,
          part.factor);
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
