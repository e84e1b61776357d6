#include "tangent/row_sums.h"
#include "parallel/petsc.h"

#include <algorithm>
#include <cstdint>

using namespace qsdolfinx;

namespace
{
/// Number of values that are collected before they are inserted: 2 MiB.
constexpr std::size_t most_values = std::size_t(1) << 18;
} // namespace

void RowSums::add(std::span<const PetscInt> rows, std::span<const PetscInt> columns,
                  std::span<const double> values)
{
  if (values_.size() + values.size() > most_values)
    insert();
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (rows[i] >= 0)
      parts_.push_back(
          {rows[i], columns_.size(), values_.size() + i * columns.size(), columns.size()});
  columns_.insert(columns_.end(), columns.begin(), columns.end());
  values_.insert(values_.end(), values.begin(), values.end());
}

void RowSums::add_squares(std::span<const std::int64_t> numbers, std::span<const double> values,
                          std::size_t size)
{
  std::vector<PetscInt> own(size);
  for (std::size_t i = 0; i * size < numbers.size(); ++i)
  {
    std::ranges::copy(numbers.subspan(i * size, size), own.begin());
    add(own, own, values.subspan(i * size * size, size * size));
  }
}

void RowSums::add_entries(std::span<const std::int64_t> rows, std::span<const std::int64_t> columns,
                          std::span<const double> values)
{
  for (std::size_t e = 0; e < values.size(); ++e)
  {
    const auto i = static_cast<PetscInt>(rows[e]), j = static_cast<PetscInt>(columns[e]);
    if (i >= 0 && j >= 0)
      check(MatSetValues(matrix_, 1, &i, 1, &j, &values[e], ADD_VALUES));
  }
}

void RowSums::insert()
{
  std::vector<PetscInt> known(columns_); // ascending; below, a column is represented by its place
  std::ranges::sort(known);
  known.erase(std::ranges::unique(known).begin(), known.end());
  std::vector<std::int32_t> place(columns_.size());
  std::ranges::transform(columns_, place.begin(), [&known](PetscInt column)
                         { return std::ranges::lower_bound(known, column) - known.begin(); });
  std::ranges::stable_sort(parts_, {}, &Part::row);

  std::vector<std::int32_t> at(known.size(), -1); // place of a column in the current row, or -1
  std::vector<std::int32_t> found;
  std::vector<PetscInt> columns;
  std::vector<PetscScalar> sums;
  for (std::size_t first = 0, last = 0; first < parts_.size(); first = last)
  {
    const PetscInt row = parts_[first].row;
    for (; last < parts_.size() && parts_[last].row == row; ++last)
    {
      const Part& part = parts_[last];
      for (std::size_t j = 0; j < part.size; ++j)
      {
        const std::int32_t column = place[part.columns + j];
        if (known[column] < 0)
          continue;
        if (at[column] < 0)
        {
          at[column] = static_cast<std::int32_t>(found.size());
          found.push_back(column);
          sums.push_back(0);
        }
        sums[at[column]] += values_[part.values + j];
      }
    }
    for (std::int32_t column : found)
    {
      columns.push_back(known[column]);
      at[column] = -1;
    }
    check(MatSetValues(matrix_, 1, &row, static_cast<PetscInt>(columns.size()), columns.data(),
                       sums.data(), ADD_VALUES));
    found.clear();
    columns.clear();
    sums.clear();
  }
  parts_.clear();
  columns_.clear();
  values_.clear();
}
