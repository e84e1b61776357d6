#include "gap/piece_forces.h"
#include "parallel/petsc.h"
#include "surface/surface.h"

#include <algorithm>
#include <utility>

using namespace qsdolfinx;

namespace
{
/// Forces on the nodes of one piece, [node][gdim], from its slips [k][node][3][3].
void contract(std::span<const double> slip, std::span<const double> traction, std::size_t nodes,
              std::size_t d, std::vector<double>& forces)
{
  std::ranges::fill(forces, 0.0);
  for (std::size_t k = 0; k < traction.size() / d; ++k)
    for (std::size_t j = 0; j < nodes; ++j)
      for (std::size_t a = 0; a < d; ++a)
        for (std::size_t b = 0; b < d; ++b)
          forces[j * d + b] += traction[k * d + a] * slip[((k * nodes + j) * 3 + a) * 3 + b];
}
} // namespace

std::vector<double> qsdolfinx::values_at(Vec x, std::span<const std::int64_t> dofs)
{
  const std::vector<PetscInt> wanted(dofs.begin(), dofs.end());
  Vec local;
  IS is;
  VecScatter scatter;
  const auto n = static_cast<PetscInt>(wanted.size());
  check(VecCreateSeq(PETSC_COMM_SELF, n, &local));
  check(ISCreateGeneral(PETSC_COMM_SELF, n, wanted.data(), PETSC_USE_POINTER, &is));
  check(VecScatterCreate(x, is, local, nullptr, &scatter));
  check(VecScatterBegin(scatter, x, local, INSERT_VALUES, SCATTER_FORWARD));
  check(VecScatterEnd(scatter, x, local, INSERT_VALUES, SCATTER_FORWARD));
  const PetscScalar* values;
  check(VecGetArrayRead(local, &values));
  std::vector<double> out(values, values + n);
  check(VecRestoreArrayRead(local, &values));
  check(VecScatterDestroy(&scatter));
  check(ISDestroy(&is));
  check(VecDestroy(&local));
  return out;
}

void qsdolfinx::raise_facets(Pieces& pieces, Vec normals)
{
  const bool of_master = pieces.size() == 0 || pieces.cut_is_slave[0];
  const PieceSide& side = of_master ? pieces.master : pieces.slave;
  const auto d = static_cast<std::size_t>(pieces.gdim), n = static_cast<std::size_t>(side.type),
             nodes = static_cast<std::size_t>(side.num_nodes);
  const std::vector<double> values = values_at(normals, side.dofs);
  pieces.rise.assign(pieces.size() * n * n, 0.0);
  for (std::size_t p = 0; p < pieces.size(); ++p)
  {
    const auto x = side.x_of(p).first(3 * n);
    const Vec3 area = side.orientation[p] * area_vector(side.type, x, facet_centre(side.type)),
               outward = (1 / norm(area)) * area;
    for (std::size_t i = 0; i < n; ++i)
    {
      Vec3 m{};
      std::copy_n(&values[(p * nodes + i) * d], d, m.begin());
      if (!(dot(m, outward) > smooth_cosine)) // where it is none, or the surface turns sharply
        continue;
      for (std::size_t j = 0; j < n; ++j)
        if (j != i && (n < 4 || i + j != 3)) // along edges
        {
          const Vec3 edge
              = facet_vertex(x, static_cast<int>(j)) - facet_vertex(x, static_cast<int>(i));
          pieces.rise[(p * n + i) * n + j] = -dot(m, edge) / dot(m, outward);
        }
    }
  }
}

std::vector<double> qsdolfinx::distances_of(const Pieces& pieces)
{
  std::vector<double> out;
  for (std::size_t i = 0; i < pieces.size(); ++i)
  {
    const RayPair pair = pair_of(pieces, i);
    for (const RayPoint& point : pieces.points_of(i))
      out.push_back(point.t - lift_of(pair, point.zeta).height);
  }
  return out;
}

std::vector<std::int64_t> qsdolfinx::first_dofs(const Pieces& pieces)
{
  std::vector<std::int64_t> out;
  for (std::size_t i = 0; i < pieces.size(); ++i)
    for (int k = 0; k < pieces.num_multipliers; ++k)
      out.push_back(pieces.slave.dofs[(i * pieces.slave.num_nodes + k) * pieces.gdim]);
  return out;
}

std::vector<std::int64_t> qsdolfinx::multiplier_dofs(const Pieces& pieces)
{
  const auto d = static_cast<std::size_t>(pieces.gdim);
  std::vector<std::int64_t> out;
  out.reserve(pieces.size() * pieces.num_multipliers * d);
  for (std::size_t i = 0; i < pieces.size(); ++i)
  {
    const auto first
        = pieces.slave.dofs.begin() + static_cast<std::ptrdiff_t>(i * pieces.slave.num_nodes * d);
    out.insert(out.end(), first, first + static_cast<std::ptrdiff_t>(pieces.num_multipliers * d));
  }
  return out;
}

namespace
{
/// Part of a node's area that is covered, below which its neighbours carry its multiplier.
constexpr double least_cover = 0.1;

} // namespace

std::vector<std::int64_t> qsdolfinx::side_dofs(const Pieces& pieces)
{
  std::vector<std::int64_t> out = first_dofs(pieces);
  const auto n = static_cast<std::size_t>(pieces.num_multipliers),
             width = static_cast<std::size_t>(pieces.slave.num_nodes);
  const auto d = static_cast<std::size_t>(pieces.gdim);
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i] = pieces.slave.dofs[((i / n) * width + i % n) * d + pieces.multiplier_side[i]];
  return out;
}

std::vector<double> qsdolfinx::values_at_rim(const Pieces& pieces, Vec values)
{
  const std::vector<double> v = values_at(values, side_dofs(pieces));
  const auto nk = static_cast<std::size_t>(pieces.num_multipliers);
  std::vector<double> out;
  for (std::size_t i = 0; i < pieces.size(); ++i)
    for (const RimPoint& at : pieces.rim_of(i))
    {
      const auto N = shape_functions(pieces.slave.type,
                                     pieces.cut_is_slave[i] ? at.point.xi : at.point.zeta);
      double sum = 0;
      for (std::size_t k = 0; k < nk; ++k)
        sum += N[k] * v[i * nk + k];
      out.push_back(sum);
    }
  return out;
}

Shares::Shares(const Pieces& pieces, Vec cover)
    : num_multipliers_(static_cast<std::size_t>(pieces.num_multipliers))
{
  if (cover)
    cover_ = values_at(cover, side_dofs(pieces));
}

void Shares::share_out(std::size_t piece, std::span<double> rows) const
{
  if (cover_.empty())
    return;
  const auto c = std::span(cover_).subspan(piece * num_multipliers_, num_multipliers_);
  const double needed = std::min(least_cover, *std::ranges::max_element(c));
  const auto well = std::ranges::count_if(c, [needed](double value) { return value >= needed; });
  const std::size_t width = rows.size() / num_multipliers_;
  for (std::size_t k = 0; k < num_multipliers_; ++k)
    for (std::size_t i = 0; c[k] < needed && i < width; ++i)
    {
      const double shared = std::exchange(rows[k * width + i], 0.0) / static_cast<double>(well);
      for (std::size_t l = 0; l < num_multipliers_; ++l)
        if (c[l] >= needed)
          rows[l * width + i] += shared;
    }
}

void Shares::gather(std::size_t piece, std::span<double> values) const
{
  if (cover_.empty())
    return;
  const auto c = std::span(cover_).subspan(piece * num_multipliers_, num_multipliers_);
  const double needed = std::min(least_cover, *std::ranges::max_element(c));
  const auto well = std::ranges::count_if(c, [needed](double value) { return value >= needed; });
  const std::size_t width = values.size() / num_multipliers_;
  for (std::size_t k = 0; k < num_multipliers_; ++k)
    for (std::size_t i = 0; c[k] < needed && i < width; ++i)
    {
      double sum = 0;
      for (std::size_t l = 0; l < num_multipliers_; ++l)
        if (c[l] >= needed)
          sum += values[l * width + i];
      values[k * width + i] = sum / static_cast<double>(well);
    }
}

void qsdolfinx::add_slip_forces(const Pieces& pieces, Vec cover, Vec traction, std::array<Vec, 2> b)
{
  const Shares shares(pieces, cover);
  std::vector<double> tau = values_at(traction, multiplier_dofs(pieces));
  const auto d = static_cast<std::size_t>(pieces.gdim);
  const std::array<std::size_t, 2> count{static_cast<std::size_t>(pieces.slave.num_nodes) * d,
                                         static_cast<std::size_t>(pieces.master.num_nodes) * d};
  const std::size_t width = static_cast<std::size_t>(pieces.num_multipliers) * d,
                    nodes = (count[0] + count[1]) / d;
  const std::array<const PieceSide*, 2> sides{&pieces.slave, &pieces.master};
  std::vector<double> slip(static_cast<std::size_t>(pieces.num_multipliers) * nodes * 9),
      forces(nodes * d);
  std::vector<PetscInt> dofs;
  for (std::size_t i = 0; i < pieces.size(); ++i)
  {
    const auto of_piece = std::span(tau).subspan(i * width, width);
    shares.gather(i, of_piece);
    if (std::ranges::all_of(of_piece, [](double value) { return value == 0; }))
      continue;
    std::ranges::fill(slip, 0.0);
    add_slip(pair_of(pieces, i), pieces.points_of(i), slip);
    contract(slip, of_piece, nodes, d, forces);
    for (std::size_t s = 0; s < 2; ++s)
    {
      if (!b[s])
        continue;
      const auto first = sides[s]->dofs.begin() + static_cast<std::ptrdiff_t>(i * count[s]);
      dofs.assign(first, first + static_cast<std::ptrdiff_t>(count[s]));
      check(VecSetValues(b[s], static_cast<PetscInt>(count[s]), dofs.data(),
                         forces.data() + s * count[0], ADD_VALUES));
    }
  }
  for (Vec side : b)
    if (side)
    {
      check(VecAssemblyBegin(side));
      check(VecAssemblyEnd(side));
    }
}
