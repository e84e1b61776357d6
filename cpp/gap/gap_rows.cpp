#include "gap/gap_rows.h"
#include "parallel/key_numbers.h"

#include <algorithm>
#include <numeric>

using namespace qsdolfinx;

namespace
{
std::span<const std::int64_t> facet_of(const PairingSide& side, std::size_t p, int block)
{
  const std::size_t width = static_cast<std::size_t>(side.num_nodes) * block;
  return std::span(side.dofs).subspan(p * width, width);
}

std::span<const std::uint8_t> sides_of(const PairingPoints& points, std::size_t p)
{
  const auto n = static_cast<std::size_t>(points.num_multipliers);
  return std::span(points.multiplier_side).subspan(p * n, n);
}
} // namespace

Slots::Slots(const Surface& slave, const PairingPoints& points)
    : num_nodes(slave.nodes().size()),
      per_node(points.in_corner.empty() ? 1 : static_cast<std::size_t>(points.gdim)),
      in_corner(points.in_corner)
{
}

std::vector<Patch> qsdolfinx::find_patches(const Surface& slave,
                                           std::span<const PairingPoints* const> sets,
                                           const Slots& slots)
{
  std::int64_t end = 0, size = slave.local_size();
  MPI_Scan(&size, &end, 1, MPI_INT64_T, MPI_SUM, slave.comm());
  std::vector<Patch> out;
  for (const PairingPoints* points : sets)
  {
    const int d = points->block;
    for (std::size_t first = 0, last; first < points->size(); first = last)
    {
      const auto on_slave = facet_of(points->slave, first, d),
                 on_master = facet_of(points->master, first, d);
      const auto sides = sides_of(*points, first);
      for (last = first + 1; last < points->size(); ++last)
        if (!std::ranges::equal(facet_of(points->slave, last, d), on_slave)
            || !std::ranges::equal(facet_of(points->master, last, d), on_master)
            || !std::ranges::equal(sides_of(*points, last), sides))
          break;
      for (int i = 0; i < points->num_multipliers; ++i)
        if (const std::int64_t dof = on_slave[i * d]; dof >= end - size && dof < end)
          out.push_back({points, first, last, i, slots(slave.node_index(dof), sides[i])});
    }
  }
  return out;
}

double qsdolfinx::cover(const Patch& patch)
{
  double sum = 0;
  for (std::size_t p = patch.first; p < patch.last; ++p)
    sum += patch.weight(p);
  return sum;
}

RowTerms::RowTerms(std::span<const Patch> patches, int side, GapKind kind,
                   std::span<const double> area)
    : width_(1)
{
  const bool turns = kind == GapKind::jump && !patches.empty() && patches[0].points->turns;
  const auto d = static_cast<std::size_t>(patches.empty() ? 1 : patches[0].points->block);
  if (!patches.empty())
    width_ = kind == GapKind::normal ? d : turns ? d * d : 1;
  terms_.reserve(patches.size());
  std::vector<double> value(width_);
  KeyNumbers numbering(area.size());
  for (const Patch& patch : patches)
  {
    const PairingPoints& points = *patch.points;
    const PairingSide& columns = side == 0 ? points.slave : points.master;
    const int nc = columns.num_nodes;
    const double sign = side == 0 ? 1.0 : -1.0;
    for (int j = 0; j < nc; ++j)
    {
      std::ranges::fill(value, 0.0);
      bool any = false;
      for (std::size_t p = patch.first; p < patch.last; ++p)
      {
        const double N = patch.multiplier_value(p), M = columns.shape_values[p * nc + j];
        const double w = points.weight[p] * N / area[patch.slot], wM = sign * w * M;
        any = any || (N != 0 && (M != 0 || (turns && columns.dofs[(p * nc + j) * d] >= 0)));
        if (turns)
        {
          const double* turn = &columns.turn[(p * nc + j) * width_];
          for (std::size_t i = 0; i < width_; ++i)
            value[i] += w * turn[i] + (i % (d + 1) == 0 ? wM : 0.0);
        }
        else
          for (std::size_t i = 0; i < width_; ++i)
            value[i] += wM * (kind == GapKind::normal ? points.normal[3 * p + i] : 1.0);
      }
      if (!any)
        continue;
      const std::int64_t* dofs = &columns.dofs[(patch.first * nc + j) * points.block];
      const std::int32_t column = numbering(*dofs);
      if (numbering.size() > column_dofs_.size())
        column_dofs_.push_back(dofs);
      terms_.push_back({patch.slot, column});
      values_.insert(values_.end(), value.begin(), value.end());
    }
  }
}

std::vector<std::int64_t> RowTerms::rows(std::size_t num_slots,
                                         std::vector<std::size_t>& row_slot) const
{
  std::vector<std::int64_t> row_of(num_slots, -1);
  for (const Term& term : terms_)
    row_of[term.slot] = 0;
  for (std::size_t slot = 0; slot < num_slots; ++slot)
    if (row_of[slot] == 0)
    {
      row_of[slot] = static_cast<std::int64_t>(row_slot.size());
      row_slot.push_back(slot);
    }
  return row_of;
}

/// Number of each column in the order of its unknowns; also sets the unknowns of `out`.
std::vector<std::int32_t> RowTerms::number_columns(GapOperator::Side& out, int block) const
{
  std::vector<std::int32_t> order(column_dofs_.size()), number(order.size());
  std::iota(order.begin(), order.end(), 0);
  std::ranges::sort(order, {}, [this](std::int32_t i) { return *column_dofs_[i]; });
  out.dofs.reserve(order.size() * block);
  for (std::size_t i = 0; i < order.size(); ++i)
  {
    number[order[i]] = static_cast<std::int32_t>(i);
    for (int j = 0; j < block; ++j)
      out.dofs.push_back(static_cast<PetscInt>(column_dofs_[order[i]][j]));
  }
  return number;
}

void RowTerms::compress(GapOperator::Side& out, int block, std::span<const std::int64_t> row_of,
                        std::size_t num_rows) const
{
  const std::vector<std::int32_t> number = number_columns(out, block);
  out.free_dofs = out.dofs;

  // Order the terms by rows; within each row their order stays the same.
  std::vector<std::size_t> end(num_rows + 1, 0), order(terms_.size());
  for (const Term& term : terms_)
    ++end[row_of[term.slot] + 1];
  std::partial_sum(end.begin(), end.end(), end.begin());
  for (std::size_t t = 0; t < terms_.size(); ++t)
    order[end[row_of[terms_[t].slot]]++] = t; // end[r] moves from the first term to past the last

  std::vector<std::int64_t> place(number.size(), -1); // of a column's entry in this row, or -1
  std::vector<std::int32_t> columns;
  out.offset.assign(1, 0);
  for (std::size_t r = 0, first = 0; r < num_rows; first = end[r++])
  {
    const std::int64_t start = out.offset.back();
    columns.clear();
    for (std::size_t i = first; i < end[r]; ++i)
      if (const std::int32_t c = number[terms_[order[i]].column]; place[c] < start)
      {
        place[c] = start;
        columns.push_back(c);
      }
    std::sort(columns.begin(), columns.end());
    for (std::size_t i = 0; i < columns.size(); ++i)
      place[columns[i]] = start + static_cast<std::int64_t>(i);
    out.column.insert(out.column.end(), columns.begin(), columns.end());
    out.offset.push_back(static_cast<std::int64_t>(out.column.size()));
    out.coefficient.resize(out.column.size() * width_, 0.0);
    for (std::size_t i = first; i < end[r]; ++i)
    {
      const Term& term = terms_[order[i]];
      double* c = &out.coefficient[place[number[term.column]] * width_];
      for (std::size_t j = 0; j < width_; ++j)
        c[j] += values_[order[i] * width_ + j];
    }
  }
}
