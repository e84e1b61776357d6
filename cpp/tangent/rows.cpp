#include "tangent/rows.h"
#include "parallel/petsc.h"

#include <algorithm>
#include <functional>

using namespace qsdolfinx;

namespace
{
/// Converts numbers to the larger system. Neighbouring entries of a row mostly have the same owner.
class Renumber
{
public:
  explicit Renumber(const Numbering& numbers) : numbers_(numbers) {}

  PetscInt operator()(PetscInt i)
  {
    const auto& ranges = numbers_.ranges;
    if (i < ranges[owner_] || i >= ranges[owner_ + 1])
      owner_ = std::upper_bound(ranges.begin(), ranges.end(), std::int64_t(i)) - ranges.begin() - 1;
    return static_cast<PetscInt>(i + numbers_.shifts[owner_]);
  }

private:
  Numbering numbers_;
  std::size_t owner_ = 0;
};
} // namespace

void qsdolfinx::put_rows(Mat block, Mat matrix, std::span<const std::int32_t> rows,
                         const Numbering& row_numbers, const Numbering& column_numbers,
                         RowMode mode)
{
  PetscInt first = 0;
  check(MatGetOwnershipRange(block, &first, nullptr));
  Renumber row_number(row_numbers), column_number(column_numbers);
  std::vector<PetscInt> renumbered;
  std::vector<PetscScalar> zeros;
  const InsertMode insert = mode == RowMode::add ? ADD_VALUES : INSERT_VALUES;
  for (std::int32_t local : rows)
  {
    PetscInt count = 0;
    const PetscInt* columns = nullptr;
    const PetscScalar* values = nullptr;
    check(MatGetRow(block, first + local, &count, &columns, &values));
    renumbered.resize(count);
    std::transform(columns, columns + count, renumbered.begin(), std::ref(column_number));
    if (mode == RowMode::zero)
      zeros.resize(std::max(zeros.size(), std::size_t(count)), 0.0);
    const PetscInt row = row_number(first + local);
    check(MatSetValues(matrix, 1, &row, count, renumbered.data(),
                       mode == RowMode::zero ? zeros.data() : values, insert));
    check(MatRestoreRow(block, first + local, &count, &columns, &values));
  }
}

std::vector<std::int32_t> qsdolfinx::count_entries(Mat block)
{
  PetscInt first = 0, last = 0, begin = 0, end = 0;
  check(MatGetOwnershipRange(block, &first, &last));
  check(MatGetOwnershipRangeColumn(block, &begin, &end));
  const std::size_t size = last - first;
  std::vector<std::int32_t> counts(2 * size);
  for (std::size_t i = 0; i < size; ++i)
  {
    const PetscInt row = first + static_cast<PetscInt>(i);
    PetscInt count = 0;
    const PetscInt* columns = nullptr;
    check(MatGetRow(block, row, &count, &columns, nullptr));
    counts[i] = static_cast<std::int32_t>(
        std::count_if(columns, columns + count, [&](PetscInt c) { return c >= begin && c < end; }));
    counts[size + i] = static_cast<std::int32_t>(count) - counts[i];
    check(MatRestoreRow(block, row, &count, &columns, nullptr));
  }
  return counts;
}

void qsdolfinx::set_places(Mat matrix, std::span<const std::int64_t> rows,
                           std::span<const std::int64_t> columns)
{
  std::vector<PetscInt> i(rows.begin(), rows.end()), j(columns.begin(), columns.end());
  check(MatSetPreallocationCOO(matrix, static_cast<PetscCount>(i.size()), i.data(), j.data()));
}

void qsdolfinx::set_values(Mat matrix, std::span<const double> values)
{
  check(MatSetValuesCOO(matrix, values.data(), INSERT_VALUES));
}
