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

/// How far the sum of many small matrices is from a symmetric one: their products with two fixed
/// vectors of random entries.
class Asymmetry
{
public:
  /// @param H rows of @param length entries @param numbers of the first rows and columns, which
  /// count: the same for the same unknown
  void add(std::span<const double> H, std::size_t length, std::span<const std::uint64_t> numbers)
  {
    const std::size_t n = numbers.size();
    for (auto* v : {&first_, &second_})
      v->resize(n);
    for (std::size_t a = 0; a < n; ++a)
    {
      first_[a] = entry(2 * numbers[a]);
      second_[a] = entry(2 * numbers[a] + 1);
    }
    double one = 0, other = 0;
    for (std::size_t a = 0; a < n; ++a)
      for (std::size_t b = 0; b < n; ++b)
      {
        one += first_[a] * H[a * length + b] * second_[b];
        other += second_[a] * H[a * length + b] * first_[b];
      }
    sums_[0] += one - other;
    sums_[1] += std::abs(one) + std::abs(other);
  }

  /// Whether it is by rounding alone. Collective.
  bool is_none(MPI_Comm comm)
  {
    MPI_Allreduce(MPI_IN_PLACE, sums_.data(), 2, MPI_DOUBLE, MPI_SUM, comm);
    return std::abs(sums_[0]) <= rounding * sums_[1];
  }

private:
  static constexpr double rounding = 1e-9;

  /// In [−1, 1): the finaliser of splitmix64.
  static double entry(std::uint64_t number)
  {
    std::uint64_t z = (number + 1) * 0x9e3779b97f4a7c15ULL;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return static_cast<double>(static_cast<std::int64_t>(z ^ (z >> 31))) * 0x1p-63;
  }

  std::vector<double> first_, second_;
  std::array<double, 2> sums_{};
};
} // namespace

bool qsdolfinx::insert_curvature(const Surface* master, const Pieces& pieces, Vec cover, Vec lambda,
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
  std::vector<std::uint64_t> numbers(3 * (nodes[0] + (master ? nodes[1] : 0)));
  std::vector<PetscScalar> block;
  Asymmetry asymmetry;
  for (std::size_t i = 0; i < pieces.size(); ++i)
  {
    const auto of_piece = std::span(multipliers).subspan(i * nk, nk);
    shares.gather(i, of_piece);
    if (std::ranges::all_of(of_piece, [](double value) { return value == 0; }))
      continue;
    std::ranges::fill(H, 0.0);
    const RayPair pair = pair_of(pieces, i);
    add_curvature(pair, pieces.points_of(i), of_piece, H);
    add_rim(pair, pieces.rim_of(i), of_piece, H);
    for (int s = 0; s < num_sides; ++s)
      for (std::size_t j = 0; j < nodes[s]; ++j)
        for (std::size_t c = 0; c < 3; ++c)
          numbers[3 * (s * nodes[0] + j) + c]
              = 8 * static_cast<std::uint64_t>(sides[s]->dofs[(i * nodes[s] + j) * d]) + 4 * s + c;
    asymmetry.add(H, n, numbers);
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
  MPI_Comm comm;
  check(PetscObjectGetComm(reinterpret_cast<PetscObject>(lambda), &comm));
  return asymmetry.is_none(comm);
}
