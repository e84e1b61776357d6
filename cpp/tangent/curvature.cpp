#include "tangent/curvature.h"
#include "gap/piece_forces.h"
#include "parallel/petsc.h"

#include <algorithm>

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
} // namespace

void qsdolfinx::insert_curvature(const Surface* master, const Pieces& pieces, Vec cover, Vec lambda,
                                 std::array<Vec, 2> markers, ContactBlocks blocks,
                                 std::array<double, 2> scale)
{
  const Shares shares(pieces, cover);
  std::vector<double> multipliers = values_at(lambda, first_dofs(pieces));
  const std::array<const PieceSide*, 2> sides{&pieces.slave, &pieces.master};
  const int num_sides = master ? 2 : 1;
  std::array<std::vector<PetscInt>, 2> dofs;
  for (int s = 0; s < num_sides; ++s)
    dofs[s] = free_dofs(*sides[s], markers[s]);

  const auto d = static_cast<std::size_t>(pieces.gdim),
             nk = static_cast<std::size_t>(pieces.num_multipliers);
  const std::array<std::size_t, 2> nodes{static_cast<std::size_t>(pieces.slave.num_nodes),
                                         static_cast<std::size_t>(pieces.master.num_nodes)};
  const std::size_t n = 3 * (nodes[0] + nodes[1]);
  std::vector<double> H(n * n);
  std::vector<PetscScalar> block;
  for (std::size_t i = 0; i < pieces.size(); ++i)
  {
    const auto of_piece = std::span(multipliers).subspan(i * nk, nk);
    shares.gather(i, of_piece);
    if (std::ranges::all_of(of_piece, [](double value) { return value == 0; }))
      continue;
    std::ranges::fill(H, 0.0);
    add_curvature(pair_of(pieces, i), pieces.points_of(i), of_piece, H);
    for (int a = 0; a < num_sides; ++a)
      for (int b = 0; b < num_sides; ++b)
      {
        const std::size_t rows = nodes[a] * d, columns = nodes[b] * d, row0 = a * nodes[0],
                          column0 = b * nodes[0];
        block.resize(rows * columns);
        for (std::size_t r = 0; r < rows; ++r)
          for (std::size_t c = 0; c < columns; ++c)
            block[r * columns + c]
                = scale[b] * H[(3 * (row0 + r / d) + r % d) * n + 3 * (column0 + c / d) + c % d];
        check(MatSetValues(blocks[2 * a + b], static_cast<PetscInt>(rows), &dofs[a][i * rows],
                           static_cast<PetscInt>(columns), &dofs[b][i * columns], block.data(),
                           ADD_VALUES));
      }
  }
}
