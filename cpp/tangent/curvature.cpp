#include "tangent/curvature.h"
#include "gap/piece_forces.h"
#include "parallel/petsc.h"
#include "sliding/rise.h"
#include "tangent/row_sums.h"

#include <algorithm>
#include <stdexcept>

using namespace qsdolfinx;

namespace
{
/// Unknowns of one side, -1 where a Dirichlet condition holds, [piece][node][gdim].
std::vector<PetscInt> free_dofs(const PieceSide& side, Vec markers)
{
  const std::vector<double> marked = values_at(markers, side.dofs);
  std::vector<PetscInt> out(side.dofs.begin(), side.dofs.end());
  for (std::size_t i = 0; i < out.size(); ++i)
    if (marked[i] != 0)
      out[i] = -1;
  return out;
}

/// Inserts matrices of pieces, [node][3][node][3], the slave's nodes first, once all are known.
class Insertion
{
public:
  /// Collective.
  Insertion(const Surface* master, const Pieces& pieces, std::array<Vec, 2> markers,
            ContactBlocks blocks, std::array<double, 2> scale)
      : sides_{&pieces.slave, &pieces.master}, num_sides_(master ? 2 : 1), scale_(scale),
        d_(static_cast<std::size_t>(pieces.gdim)),
        nodes_{static_cast<std::size_t>(pieces.slave.num_nodes),
               static_cast<std::size_t>(pieces.master.num_nodes)},
        sums_{RowSums(blocks[0]), RowSums(blocks[1]), RowSums(blocks[2]), RowSums(blocks[3])}
  {
    for (int s = 0; s < num_sides_; ++s)
      dofs_[s] = free_dofs(*sides_[s], markers[s]);
  }

  /// Rows of a matrix.
  std::size_t size() const { return 3 * (nodes_[0] + nodes_[1]); }

  void add(std::size_t piece, std::span<const double> H)
  {
    for (int a = 0; a < num_sides_; ++a)
      for (int b = 0; b < num_sides_; ++b)
      {
        const std::size_t rows = nodes_[a] * d_, columns = nodes_[b] * d_, row0 = a * nodes_[0],
                          column0 = b * nodes_[0];
        block_.resize(rows * columns);
        for (std::size_t r = 0; r < rows; ++r)
          for (std::size_t c = 0; c < columns; ++c)
            block_[r * columns + c]
                = scale_[b]
                  * H[(3 * (row0 + r / d_) + r % d_) * size() + 3 * (column0 + c / d_) + c % d_];
        sums_[2 * a + b].add(std::span(dofs_[a]).subspan(piece * rows, rows),
                             std::span(dofs_[b]).subspan(piece * columns, columns), block_);
      }
  }

  void insert()
  {
    for (int a = 0; a < num_sides_; ++a)
      for (int b = 0; b < num_sides_; ++b)
        sums_[2 * a + b].insert();
  }

private:
  std::array<const PieceSide*, 2> sides_;
  int num_sides_;
  std::array<double, 2> scale_;
  std::size_t d_;
  std::array<std::size_t, 2> nodes_;
  std::array<std::vector<PetscInt>, 2> dofs_; ///< [piece][node][gdim]
  std::array<RowSums, 4> sums_;               ///< ss, sm, ms, mm
  std::vector<double> block_;                 ///< reused storage
};

bool is_zero(double value) { return value == 0; }
} // namespace

void qsdolfinx::insert_curvature_of_points(const Surface* master, const Pieces& pieces,
                                           std::span<const double> pressure, bool moves,
                                           std::array<Vec, 2> markers, ContactBlocks blocks,
                                           std::array<double, 2> scale)
{
  if (pressure.size() < pieces.points.size())
    throw std::invalid_argument("a pressure for each point");
  Insertion insertion(master, pieces, markers, blocks, scale);
  std::vector<double> H(insertion.size() * insertion.size()), by_normals;
  std::size_t first = 0;
  for (std::size_t i = 0; i < pieces.size(); ++i)
  {
    const auto points = pieces.points_of(i);
    const auto of_piece = pressure.subspan(first, points.size());
    first += points.size();
    if (std::ranges::all_of(of_piece, is_zero))
      continue;
    std::ranges::fill(H, 0.0);
    const RayPair pair = pair_of(pieces, i);
    add_curvature_of_points(pair, points, of_piece, H);
    if (moves)
    {
      add_motion_of_points(pair, pieces.shape_of(i), points, of_piece, H);
      by_normals.assign(3 * insertion.size() * static_cast<std::size_t>(pair.other.num_vertices()),
                        0.0);
      add_forces_by_rise(pair, points, of_piece, H, by_normals);
    }
    insertion.add(i, H);
  }
  insertion.insert();
}

void qsdolfinx::insert_slip_curvature_of_points(const Surface* master, const Pieces& pieces,
                                                std::span<const double> traction, bool moves,
                                                std::array<Vec, 2> markers, ContactBlocks blocks,
                                                std::array<double, 2> scale)
{
  if (traction.size() < 3 * pieces.points.size())
    throw std::invalid_argument("a traction for each point");
  Insertion insertion(master, pieces, markers, blocks, scale);
  std::vector<double> H(insertion.size() * insertion.size()), by_normals;
  std::size_t first = 0;
  for (std::size_t i = 0; i < pieces.size(); ++i)
  {
    const auto points = pieces.points_of(i);
    const auto of_piece = traction.subspan(3 * first, 3 * points.size());
    first += points.size();
    if (std::ranges::all_of(of_piece, is_zero))
      continue;
    std::ranges::fill(H, 0.0);
    const RayPair pair = pair_of(pieces, i);
    add_slip_curvature_of_points(pair, points, of_piece, H);
    if (moves)
    {
      add_slip_motion_of_points(pair, pieces.shape_of(i), points, of_piece, H);
      by_normals.assign(3 * insertion.size() * static_cast<std::size_t>(pair.other.num_vertices()),
                        0.0);
      add_slip_forces_by_rise(pair, points, of_piece, H, by_normals);
    }
    insertion.add(i, H);
  }
  insertion.insert();
}
