#include "gap/gap.h"
#include "gap/gap_rows.h"
#include "gap/piece_forces.h"
#include "gap/point_rows.h"
#include "parallel/exchange.h"
#include "parallel/petsc.h"
#include "parallel/records.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <tuple>

using namespace qsdolfinx;

namespace
{
/// Collect the pairing points that were found by other ranks and act on multipliers of this rank.
PairingPoints points_from_others(const Surface& slave, const PairingPoints& points)
{
  const int nk = points.num_multipliers, ns = points.slave.num_nodes, nm = points.master.num_nodes,
            d = points.block;
  const int num_turn = points.turns ? d * d : 0;
  const int num_doubles = nk + (ns + nm) * (1 + num_turn) + 5, num_dofs = (ns + nm) * d + nk;
  std::vector<int> dest;
  std::vector<double> doubles;
  std::vector<std::int64_t> dofs;
  for (std::size_t p = 0; p < points.size(); ++p)
  {
    std::array<int, 4> sent;
    sent.fill(slave.rank());
    for (int i = 0; i < nk; ++i)
    {
      const int rank = points.slave.owner[p * ns + i];
      if (points.multiplier_values[p * nk + i] == 0
          || std::find(sent.begin(), sent.end(), rank) != sent.end())
        continue;
      sent[i] = rank;
      dest.push_back(rank);
      append_record(doubles, points.multiplier_values, p, nk);
      append_record(doubles, points.slave.shape_values, p, ns);
      append_record(doubles, points.master.shape_values, p, nm);
      append_record(doubles, points.normal, p, 3);
      append_record(doubles, points.gap, p, 1);
      append_record(doubles, points.weight, p, 1);
      append_record(doubles, points.slave.turn, p, ns * num_turn);
      append_record(doubles, points.master.turn, p, nm * num_turn);
      append_record(dofs, points.slave.dofs, p, ns * d);
      append_record(dofs, points.master.dofs, p, nm * d);
      append_record(dofs, points.multiplier_side, p, nk);
    }
  }
  const Exchange exchange(slave.comm(), dest);
  doubles = exchange.forward<double>(doubles, num_doubles);
  dofs = exchange.forward<std::int64_t>(dofs, num_dofs);

  PairingPoints out = points.none_like();
  out.turns = points.turns;
  for (std::size_t p = 0; p < exchange.num_received(); ++p)
  {
    const double* v = doubles.data() + p * num_doubles;
    const auto take = [&v](std::vector<double>& to, int n)
    {
      to.insert(to.end(), v, v + n);
      v += n;
    };
    take(out.multiplier_values, nk);
    take(out.slave.shape_values, ns);
    take(out.master.shape_values, nm);
    take(out.normal, 3);
    take(out.gap, 1);
    take(out.weight, 1);
    take(out.slave.turn, ns * num_turn);
    take(out.master.turn, nm * num_turn);
    const std::int64_t* i = dofs.data() + p * num_dofs;
    out.slave.dofs.insert(out.slave.dofs.end(), i, i + ns * d);
    out.master.dofs.insert(out.master.dofs.end(), i + ns * d, i + (ns + nm) * d);
    for (int j = (ns + nm) * d; j < num_dofs; ++j)
      out.multiplier_side.push_back(static_cast<std::uint8_t>(i[j]));
  }
  return out;
}

/// Areas of the slots: S_k, or for nodes in corners the areas of their sides.
std::vector<double> areas_of(const Slots& slots, const Surface& slave, const PairingPoints& points)
{
  const std::vector<double>& of_nodes = slave.nodes().area;
  if (slots.per_node == 1)
    return of_nodes;
  std::vector<double> out = points.side_area;
  for (std::size_t node = 0; node < of_nodes.size(); ++node)
    if (!points.in_corner[node])
      out[slots(node, 0)] = of_nodes[node];
  return out;
}

/// Make the scatter from vectors of a body to the unknowns of a side when it is first used.
/// Collective. @param x a vector of the body
void prepare(GapOperator::Side& side, Vec x)
{
  if (side.scatter)
    return;
  const auto n = static_cast<PetscInt>(side.dofs.size());
  IS is;
  check(VecCreateSeq(PETSC_COMM_SELF, n, &side.local));
  check(ISCreateGeneral(PETSC_COMM_SELF, n, side.dofs.data(), PETSC_USE_POINTER, &is));
  check(VecScatterCreate(x, is, side.local, nullptr, &side.scatter));
  check(ISDestroy(&is));
}
} // namespace

GapOperator::GapOperator(const Surface& slave, const Surface* master, const PairingPoints& points,
                         GapKind kind, GapRows rows)
    : kind_(kind), block_(points.block), num_sides_(master ? 2 : 1)
{
  if (kind == GapKind::normal && points.block != points.gdim)
    throw std::invalid_argument("scalar fields have no normal gap");
  turns_ = kind == GapKind::jump && points.turns;
  if (turns_ && rows == GapRows::points)
    throw std::invalid_argument("co-rotated jumps need rows at nodes");
  if (rows == GapRows::points)
    build_points(points);
  else
  {
    const PairingPoints others = points_from_others(slave, points);
    build_rows(slave, {&points, &others}, rows == GapRows::covered_nodes);
  }
}

GapOperator::GapOperator(const Surface* master, const Pieces& pieces, GapKind kind,
                         std::span<const double> weight)
    : kind_(kind), block_(pieces.gdim), num_sides_(master ? 2 : 1)
{
  row_area_.reserve(pieces.points.size() + weight.size());
  for (const RayPoint& point : pieces.points)
    row_area_.push_back(point.weight);
  row_area_.insert(row_area_.end(), weight.begin(), weight.end());
  initial_gap_.assign(row_area_.size(), 0);
}

GapOperator::GapOperator(const Surface* master, const Pieces& pieces,
                         std::span<const std::int64_t> alone, std::span<const double> weight,
                         double far)
    : GapOperator(master, pieces, GapKind::normal, weight)
{
  rows_of_pieces(used_sides(), pieces, alone.size(), 3, gap_gradients_of(pieces));
  multipliers_of_pieces(multipliers_, pieces, alone);
  initial_gap_ = distances_of(pieces);
  initial_gap_.insert(initial_gap_.end(), alone.size(), far);
}

GapOperator::GapOperator(const Surface* master, const Pieces& pieces,
                         std::span<const std::int64_t> alone, std::span<const double> weight)
    : GapOperator(master, pieces, GapKind::jump, weight)
{
  rows_of_pieces(used_sides(), pieces, alone.size(), 1, jumps_of(pieces));
  multipliers_of_pieces(multipliers_, pieces, alone);
}

GapOperator::GapOperator(const Surface* master, const Pieces& pieces, const SlipOfPieces& slip,
                         bool works, std::span<const double> weight)
    : GapOperator(master, pieces, GapKind::jump, weight)
{
  turns_ = true;
  rows_of_pieces(used_sides(), pieces, weight.size(), 9, slips_of(pieces, slip, works));
}

GapOperator::~GapOperator()
{
  if (!petsc_is_running())
    return;
  for (Side* side : {&sides_[0], &sides_[1], &multipliers_})
  {
    std::ignore = VecDestroy(&side->local);
    std::ignore = VecScatterDestroy(&side->scatter);
  }
}

void GapOperator::build_points(const PairingPoints& points)
{
  for (int i = 0; i < num_sides_; ++i)
    rows_at_points(sides_[i], points, i, kind_);
  multipliers_at_points(multipliers_, points);
  row_area_ = points.weight;
  initial_gap_.assign(points.size(), 0);
  if (kind_ == GapKind::normal)
    initial_gap_ = points.gap;
}

void GapOperator::build_rows(const Surface& slave, const std::array<const PairingPoints*, 2>& sets,
                             bool by_cover)
{
  const PairingPoints& points = *sets[0];
  const Slots slots(slave, points);
  const std::vector<Patch> patches = find_patches(slave, sets, slots);
  std::vector<double> area = areas_of(slots, slave, points);
  if (by_cover)
  {
    std::ranges::fill(area, 0.0);
    for (const Patch& patch : patches)
      area[patch.slot] += cover(patch);
  }
  const RowTerms of_slave(patches, 0, kind_, area), of_master(patches, 1, kind_, area);
  std::vector<std::size_t> row_slot;
  const std::vector<std::int64_t> row_of = of_slave.rows(area.size(), row_slot);
  of_slave.compress(sides_[0], block_, row_of, row_slot.size());
  of_master.compress(sides_[1], block_, row_of, row_slot.size());

  name_rows(points, slots, row_slot);
  for (std::size_t slot : row_slot)
    row_area_.push_back(area[slot]);
  initial_gap_.assign(row_slot.size(), 0);
  if (kind_ == GapKind::jump)
    return;
  for (const Patch& patch : patches)
    if (const std::int64_t row = row_of[patch.slot]; row >= 0) // else its function vanishes there
      for (std::size_t p = patch.first; p < patch.last; ++p)
        initial_gap_[row] += patch.weight(p) * patch.points->gap[p] / area[patch.slot];
}

void GapOperator::name_rows(const PairingPoints& points, const Slots& slots,
                            std::span<const std::size_t> row_slot)
{
  for (std::size_t slot : row_slot)
  {
    const std::size_t node = slot / slots.per_node;
    row_node_.push_back(static_cast<std::int64_t>(node));
    if (slots.per_node == 1)
      continue;
    row_in_corner_.push_back(points.in_corner[node]);
    row_side_.push_back(points.in_corner[node] ? static_cast<std::uint8_t>(slot % slots.per_node)
                                               : points.node_side[node]);
  }
}

std::vector<double> GapOperator::slave_sum() const
{
  const std::size_t width = kind_ == GapKind::normal ? block_ : 1, size = entry_size();
  std::vector<double> sum(num_rows() * width, 0);
  for (std::size_t r = 0; r < num_rows(); ++r)
    for (std::int64_t e = sides_[0].offset[r]; e < sides_[0].offset[r + 1]; ++e)
      for (std::size_t i = 0; i < width; ++i) // rotation terms sum to 0
        sum[r * width + i] += sides_[0].coefficient[e * size + i];
  return sum;
}

std::vector<double> GapOperator::apply(std::array<Vec, 2> x, std::array<double, 2> scale)
{
  std::vector<double> g(num_rows() * width(), 0);
  const auto w = static_cast<std::size_t>(width());
  for (int s = 0; s < num_sides_; ++s)
  {
    Side& side = sides_[s];
    prepare(side, x[s]);
    check(VecScatterBegin(side.scatter, x[s], side.local, INSERT_VALUES, SCATTER_FORWARD));
    check(VecScatterEnd(side.scatter, x[s], side.local, INSERT_VALUES, SCATTER_FORWARD));
    const PetscScalar* values;
    check(VecGetArrayRead(side.local, &values));
    for (std::size_t r = 0; r < num_rows(); ++r)
    {
      for (std::int64_t e = side.offset[r]; e < side.offset[r + 1]; ++e)
      {
        for (int i = 0; i < block_; ++i)
        {
          const double value = scale[s] * values[side.column[e] * block_ + i];
          if (kind_ == GapKind::jump && !turns_)
            g[r * w + i] += side.coefficient[e] * value;
          else
            for (std::size_t c = 0; c < w; ++c)
              g[r * w + c] += side.coefficient[(e * w + c) * block_ + i] * value;
        }
      }
    }
    check(VecRestoreArrayRead(side.local, &values));
  }
  return g;
}

void GapOperator::add_transpose(std::span<const double> f, std::array<Vec, 2> b)
{
  const auto w = static_cast<std::size_t>(width());
  if (f.size() != num_rows() * w)
    throw std::invalid_argument("f must hold `width` values per row");
  for (int s = 0; s < num_sides_; ++s)
  {
    Side& side = sides_[s];
    prepare(side, b[s]);
    check(VecSet(side.local, 0));
    PetscScalar* y;
    check(VecGetArray(side.local, &y));
    for (std::size_t r = 0; r < num_rows(); ++r)
    {
      for (std::int64_t e = side.offset[r]; e < side.offset[r + 1]; ++e)
      {
        for (int i = 0; i < block_; ++i)
        {
          double& to = y[side.column[e] * block_ + i];
          if (kind_ == GapKind::jump && !turns_)
            to += side.coefficient[e] * f[r * w + i];
          else
            for (std::size_t c = 0; c < w; ++c)
              to += side.coefficient[(e * w + c) * block_ + i] * f[r * w + c];
        }
      }
    }
    check(VecRestoreArray(side.local, &y));
    check(VecScatterBegin(side.scatter, side.local, b[s], ADD_VALUES, SCATTER_REVERSE));
    check(VecScatterEnd(side.scatter, side.local, b[s], ADD_VALUES, SCATTER_REVERSE));
  }
}

std::vector<double> GapOperator::at_points(Vec nodal)
{
  Side& side = multipliers_;
  if (side.offset.empty())
    throw std::logic_error("the rows are not points");
  prepare(side, nodal);
  check(VecScatterBegin(side.scatter, nodal, side.local, INSERT_VALUES, SCATTER_FORWARD));
  check(VecScatterEnd(side.scatter, nodal, side.local, INSERT_VALUES, SCATTER_FORWARD));
  std::vector<double> out(num_rows(), 0);
  const PetscScalar* values;
  check(VecGetArrayRead(side.local, &values));
  for (std::size_t r = 0; r < num_rows(); ++r)
    for (std::int64_t e = side.offset[r]; e < side.offset[r + 1]; ++e)
      out[r] += side.coefficient[e] * values[side.column[e]];
  check(VecRestoreArrayRead(side.local, &values));
  return out;
}

template <typename Visit>
void GapOperator::reduce_to_nodes(std::span<const double> f, Vec nodal, double start,
                                  InsertMode mode, Visit visit)
{
  Side& side = multipliers_;
  if (side.offset.empty())
    throw std::logic_error("the rows are not points");
  prepare(side, nodal);
  if (f.size() != num_rows())
    throw std::invalid_argument("f must hold one value per row");
  check(VecSet(side.local, start));
  PetscScalar* y;
  check(VecGetArray(side.local, &y));
  for (std::size_t r = 0; r < num_rows(); ++r)
    for (std::int64_t e = side.offset[r]; e < side.offset[r + 1]; ++e)
      visit(y[side.column[e]], side.coefficient[e], f[r]);
  check(VecRestoreArray(side.local, &y));
  check(VecScatterBegin(side.scatter, side.local, nodal, mode, SCATTER_REVERSE));
  check(VecScatterEnd(side.scatter, side.local, nodal, mode, SCATTER_REVERSE));
}

void GapOperator::add_to_nodes(std::span<const double> f, Vec nodal)
{
  reduce_to_nodes(f, nodal, 0.0, ADD_VALUES,
                  [](double& y, double N, double value) { y += N * value; });
}

void GapOperator::raise_nodes(std::span<const double> f, Vec nodal)
{
  reduce_to_nodes(f, nodal, std::numeric_limits<double>::lowest(), MAX_VALUES,
                  [](double& y, double N, double value)
                  {
                    if (N != 0)
                      y = std::max(y, value);
                  });
}

void GapOperator::constrain(std::array<Vec, 2> markers)
{
  for (int s = 0; s < num_sides_; ++s)
  {
    Side& side = sides_[s];
    prepare(side, markers[s]);
    check(VecScatterBegin(side.scatter, markers[s], side.local, INSERT_VALUES, SCATTER_FORWARD));
    check(VecScatterEnd(side.scatter, markers[s], side.local, INSERT_VALUES, SCATTER_FORWARD));
    const PetscScalar* marked;
    check(VecGetArrayRead(side.local, &marked));
    for (std::size_t i = 0; i < side.dofs.size(); ++i)
      side.free_dofs[i] = marked[i] != 0 ? -1 : side.dofs[i];
    check(VecRestoreArrayRead(side.local, &marked));
  }
}
