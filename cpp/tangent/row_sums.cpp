#include "tangent/row_sums.h"
#include "parallel/exchange.h"
#include "parallel/petsc.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <numeric>
#include <utility>

using namespace qsdolfinx;

namespace
{
/// Number of values that are collected before they are summed, while they are in the processor's
/// cache: 256 KiB.
constexpr std::size_t most_values = std::size_t(1) << 15;
/// Number of sums that are collected before they are summed for the first time: 2 MiB.
constexpr std::size_t most_sums = std::size_t(1) << 18;
} // namespace

std::int32_t RowSums::number_of(PetscInt key)
{
  if (key < 0)
    return -1;
  const std::int32_t out = numbering_(key);
  if (numbering_.size() > known_.size())
  {
    known_.push_back(key);
    count_.push_back(0);
    sums_.push_back(0.0);
    is_found_.push_back(0);
  }
  return out;
}

void RowSums::add(std::span<const PetscInt> rows, std::span<const PetscInt> columns,
                  std::span<const double> values)
{
  if (values_.size() + values.size() > summed_.values + most_values)
  {
    sum(summed_);
    summed_ = {parts_.size(), columns_.size(), values_.size()};
    if (values_.size() > 2 * num_sums_ + most_sums)
      sum_all();
  }
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (const std::int32_t row = number_of(rows[i]); row >= 0)
      parts_.push_back({row, columns_.size(), values_.size() + i * columns.size(), columns.size()});
  for (PetscInt column : columns)
    columns_.push_back(number_of(column));
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
  std::vector<PetscInt> own;
  for (std::size_t first = 0, last = 0; first < values.size(); first = last)
  {
    own.clear();
    for (; last < values.size() && rows[last] == rows[first]; ++last)
      own.push_back(static_cast<PetscInt>(columns[last]));
    const auto row = static_cast<PetscInt>(rows[first]);
    add({&row, 1}, own, values.subspan(first, own.size()));
  }
}

/// Numbers of the parts from `first` on, sorted by their rows, and where those of each row end.
/// Rows are in the order of their first parts.
std::pair<std::vector<std::size_t>, std::vector<std::size_t>> RowSums::by_rows(std::size_t first)
{
  std::vector<std::int32_t> rows;
  for (std::size_t i = first; i < parts_.size(); ++i)
    if (count_[parts_[i].row]++ == 0)
      rows.push_back(parts_[i].row);
  std::vector<std::size_t> order(parts_.size() - first), end;
  std::size_t before = 0;
  for (std::int32_t row : rows)
    before += std::exchange(count_[row], before);
  for (std::size_t i = first; i < parts_.size(); ++i)
    order[count_[parts_[i].row]++] = i;
  for (std::int32_t row : rows)
    end.push_back(std::exchange(count_[row], 0));
  return {std::move(order), std::move(end)};
}

/// Add the parts of the same row from a position on.
void RowSums::sum(const Position& from)
{
  const auto [order, end] = by_rows(from.parts);
  std::vector<Part> parts;
  std::vector<std::int32_t> columns, found; // of the current row
  std::vector<double> values;
  double* const sums = sums_.data() + 1; // that of column −1 is ignored
  std::span<const std::size_t> before;
  for (std::size_t row = 0, first = 0; row < end.size(); first = end[row++])
  {
    const auto own = std::span(order).subspan(first, end[row] - first);
    // The unknowns of a node have the same columns.
    const auto of_part = [this](std::size_t i) { return parts_[i].columns; };
    if (!std::ranges::equal(own, before, {}, of_part, of_part))
    {
      find_columns(own, found);
      columns.insert(columns.end(), found.begin(), found.end());
    }
    for (std::size_t i : own)
    {
      const std::int32_t* column = &columns_[parts_[i].columns];
      const double* value = &values_[parts_[i].values];
      for (std::size_t j = 0; j < parts_[i].size; ++j)
        sums[column[j]] += value[j];
    }
    parts.push_back({parts_[own[0]].row, from.columns + columns.size() - found.size(),
                     from.values + values.size(), found.size()});
    for (std::int32_t c : found)
      values.push_back(std::exchange(sums[c], 0.0));
    before = own;
  }
  const auto replace = [](auto& all, std::size_t first, const auto& last)
  {
    all.resize(first);
    all.insert(all.end(), last.begin(), last.end());
  };
  replace(parts_, from.parts, parts);
  replace(columns_, from.columns, columns);
  replace(values_, from.values, values);
}

/// Find all columns of some parts, in the order of their first appearance.
void RowSums::find_columns(std::span<const std::size_t> parts, std::vector<std::int32_t>& found)
{
  found.clear();
  for (std::size_t i : parts)
    for (std::size_t j = 0; j < parts_[i].size; ++j)
      if (const std::int32_t c = columns_[parts_[i].columns + j]; c >= 0 && !is_found_[c])
      {
        is_found_[c] = 1;
        found.push_back(c);
      }
  for (std::int32_t c : found)
    is_found_[c] = 0;
}

void RowSums::sum_all()
{
  sum({});
  summed_ = {parts_.size(), columns_.size(), values_.size()};
  num_sums_ = values_.size();
}

/// Send the sums in rows of other ranks to them. Collective.
void RowSums::send_to_owners()
{
  const PetscInt* ranges = nullptr;
  PetscMPIInt size = 0, rank = 0;
  const MPI_Comm comm = PetscObjectComm(reinterpret_cast<PetscObject>(matrix_));
  MPI_Comm_size(comm, &size);
  MPI_Comm_rank(comm, &rank);
  if (size == 1)
    return;
  check(MatGetOwnershipRanges(matrix_, &ranges));
  std::vector<int> to;
  std::vector<std::int64_t> places;
  std::vector<double> values;
  std::erase_if(parts_,
                [&](const Part& part)
                {
                  const PetscInt row = known_[part.row];
                  const auto* next = std::upper_bound(ranges, ranges + size + 1, row);
                  const int owner = static_cast<int>(next - ranges) - 1;
                  for (std::size_t j = 0; owner != rank && j < part.size; ++j)
                  {
                    to.push_back(owner);
                    places.insert(places.end(), {row, known_[columns_[part.columns + j]]});
                    values.push_back(values_[part.values + j]);
                  }
                  return owner != rank;
                });
  const Exchange exchange(comm, to);
  places = exchange.forward<std::int64_t>(places, 2);
  values = exchange.forward<double>(values, 1);
  std::array<std::vector<std::int64_t>, 2> of_rows_and_columns;
  for (std::size_t i = 0; i < places.size(); ++i)
    of_rows_and_columns[i % 2].push_back(places[i]);
  add_entries(of_rows_and_columns[0], of_rows_and_columns[1], values);
  sum_all();
}

void RowSums::insert()
{
  sum_all();
  send_to_owners();
  PetscBool is_assembled = PETSC_FALSE;
  check(MatAssembled(matrix_, &is_assembled));
  if (!is_assembled)
    return set_pattern();
  std::vector<PetscInt> columns;
  for (const Part& part : parts_)
  {
    columns.clear();
    for (std::size_t j = 0; j < part.size; ++j)
      columns.push_back(known_[columns_[part.columns + j]]);
    check(MatSetValues(matrix_, 1, &known_[part.row], static_cast<PetscInt>(part.size),
                       columns.data(), &values_[part.values], ADD_VALUES));
  }
  check(MatAssemblyBegin(matrix_, MAT_FINAL_ASSEMBLY));
  check(MatAssemblyEnd(matrix_, MAT_FINAL_ASSEMBLY));
}

/// Make the sums the matrix: first by columns, so that columns ascend in each row.
void RowSums::set_pattern()
{
  std::vector<std::int32_t> order(known_.size());
  std::iota(order.begin(), order.end(), 0);
  std::ranges::sort(order, {}, [this](std::int32_t i) { return known_[i]; });
  std::vector<std::size_t> end(known_.size() + 1, 0); // of the columns
  for (const Part& part : parts_)
    for (std::size_t j = 0; j < part.size; ++j)
      ++end[columns_[part.columns + j] + 1];
  std::partial_sum(end.begin(), end.end(), end.begin());
  std::vector<std::pair<PetscInt, double>> by_columns(values_.size()); // row, value
  PetscInt begin = 0, last = 0;
  check(MatGetOwnershipRange(matrix_, &begin, &last));
  std::vector<PetscInt> offset(static_cast<std::size_t>(last - begin) + 1, 0);
  for (const Part& part : parts_)
  {
    const PetscInt row = known_[part.row] - begin;
    offset[row + 1] = static_cast<PetscInt>(part.size);
    for (std::size_t j = 0; j < part.size; ++j)
      by_columns[end[columns_[part.columns + j]]++]
          = {row, values_[part.values + j]}; // as in sum()
  }
  std::partial_sum(offset.begin(), offset.end(), offset.begin());
  std::vector<PetscInt> next(offset), columns(values_.size());
  for (std::int32_t column : order)
    for (std::size_t i = column > 0 ? end[column - 1] : 0; i < end[column]; ++i)
    {
      const auto [row, value] = by_columns[i];
      columns[next[row]] = known_[column];
      values_[next[row]++] = value;
    }
  check(MatSeqAIJSetPreallocationCSR(matrix_, offset.data(), columns.data(), values_.data()));
  check(MatMPIAIJSetPreallocationCSR(matrix_, offset.data(), columns.data(), values_.data()));
}
