#include "gap/piece_forces.h"
#include "parallel/petsc.h"
#include "sliding/rise.h"
#include "surface/surface.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

using namespace qsdolfinx;

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

namespace
{
/// Least cosine of the angle between a facet's normal and the mean normal at its vertex for a
/// curved surface over the facet, whose slope would otherwise exceed 3. Below a sharp tip facets
/// turn as far as its sides, at nodes that were smooth.
constexpr double least_upright = 0.3;
} // namespace

void qsdolfinx::raise_facets(Pieces& pieces, Vec normals)
{
  const PieceSide& side = raised_side(pieces);
  const auto d = static_cast<std::size_t>(pieces.gdim), n = static_cast<std::size_t>(side.type),
             nodes = static_cast<std::size_t>(side.num_nodes);
  const std::vector<double> values = values_at(normals, side.dofs);
  const bool interpolates = side.degree == 1 && side.type != FacetType::interval;
  pieces.rise.assign(interpolates ? 0 : pieces.size() * n * n, 0.0);
  pieces.rise_normal.assign(pieces.size() * n * 3, 0.0);
  for (std::size_t p = 0; p < pieces.size(); ++p)
  {
    const auto x = side.x_of(p).first(3 * n);
    const Vec3 area = side.orientation[p] * area_vector(side.type, x, facet_centre(side.type)),
               outward = (1 / norm(area)) * area;
    for (std::size_t i = 0; i < n; ++i)
    {
      Vec3 m{};
      std::copy_n(&values[(p * nodes + i) * d], d, m.begin());
      if (!(dot(m, outward) > least_upright)) // no normal here, or a fold
        continue;
      std::copy_n(m.begin(), 3,
                  pieces.rise_normal.begin() + static_cast<std::ptrdiff_t>(3 * (p * n + i)));
      for (std::size_t j = 0; j < n; ++j)
        if (!interpolates && j != i && (n < 4 || i + j != 3)) // along edges
        {
          const Vec3 edge = along_edge(side.type, side.degree, side.x_of(p), static_cast<int>(i),
                                       static_cast<int>(j));
          pieces.rise[(p * n + i) * n + j] = -dot(m, edge) / dot(m, outward);
        }
    }
  }
}

const PieceSide& qsdolfinx::raised_side(const Pieces& pieces)
{
  return pieces.size() == 0 || pieces.cut_is_slave[0] ? pieces.master : pieces.slave;
}

std::array<ByNormals, 2> qsdolfinx::forces_by_normals(const Pieces& pieces,
                                                      std::span<const double> stress, bool slips)
{
  if (stress.size() < (slips ? 3 : 1) * pieces.points.size())
    throw std::invalid_argument("a pressure or traction for each point");
  const PieceSide& side = raised_side(pieces);
  const std::array<const PieceSide*, 2> sides{&pieces.slave, &pieces.master};
  const auto d = static_cast<std::size_t>(pieces.gdim), n = static_cast<std::size_t>(side.type),
             nodes = static_cast<std::size_t>(side.num_nodes);
  const std::size_t width = slips ? 3 : 1;
  std::array<ByNormals, 2> out;
  std::vector<double> by_nodes, by_normals;
  std::size_t first = 0;
  for (std::size_t i = 0; i < pieces.size() && !pieces.rise_normal.empty(); ++i)
  {
    const RayPair pair = pair_of(pieces, i);
    const auto points = pieces.points_of(i);
    const auto rows = 3 * static_cast<std::size_t>(pair.num_nodes());
    by_nodes.assign(rows * rows, 0.0);
    by_normals.assign(rows * 3 * n, 0.0);
    const auto of_piece = stress.subspan(width * first, width * points.size());
    first += points.size();
    (slips ? add_slip_forces_by_rise : add_forces_by_rise)(pair, points, of_piece, by_nodes,
                                                           by_normals);
    for (std::size_t s = 0, node = 0; s < 2; ++s)
      for (std::size_t j = 0; j < static_cast<std::size_t>(sides[s]->num_nodes); ++j, ++node)
        for (std::size_t r = 0; r < d; ++r)
          for (std::size_t k = 0; k < n; ++k)
            for (std::size_t c = 0; c < d; ++c)
              out[s].append(
                  sides[s]->dofs[(i * static_cast<std::size_t>(sides[s]->num_nodes) + j) * d + r],
                  side.dofs[(i * nodes + k) * d + c], by_normals[((3 * node + r) * n + k) * 3 + c]);
  }
  return out;
}

std::vector<double> qsdolfinx::distances_of(const Pieces& pieces)
{
  std::vector<double> out;
  for (const RayPoint& point : pieces.points)
    out.push_back(point.t);
  return out;
}

std::vector<double> qsdolfinx::cover_of(const Pieces& pieces)
{
  const auto nk = static_cast<std::size_t>(pieces.num_multipliers);
  std::vector<double> out(pieces.size() * nk, 0.0);
  for (std::size_t i = 0; i < pieces.size(); ++i)
    for (const RayPoint& point : pieces.points_of(i))
    {
      const auto N
          = shape_functions(pieces.slave.type, pieces.cut_is_slave[i] ? point.xi : point.zeta);
      for (std::size_t k = 0; k < nk; ++k)
        out[i * nk + k] += point.weight * N[k];
    }
  return out;
}

std::vector<std::int64_t> qsdolfinx::side_dofs(const Pieces& pieces)
{
  const auto n = static_cast<std::size_t>(pieces.num_multipliers),
             width = static_cast<std::size_t>(pieces.slave.num_nodes),
             d = static_cast<std::size_t>(pieces.gdim);
  std::vector<std::int64_t> out(pieces.size() * n);
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i] = pieces.slave.dofs[((i / n) * width + i % n) * d + pieces.multiplier_side[i]];
  return out;
}
