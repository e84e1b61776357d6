#include "tangent/curvature.h"
#include "gap/piece_forces.h"
#include "parallel/petsc.h"
#include "tangent/row_sums.h"

#include <algorithm>
#include <cstdint>
#include <functional>
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

  /// What tells the rows that are inserted from all others.
  void number(std::size_t piece, std::vector<std::uint64_t>& out) const
  {
    out.clear();
    for (int s = 0; s < num_sides_; ++s)
      for (std::size_t j = 0; j < nodes_[s]; ++j)
        for (int c = 0; c < 3; ++c)
          out.push_back(
              8 * static_cast<std::uint64_t>(sides_[s]->dofs[(piece * nodes_[s] + j) * d_])
              + static_cast<std::uint64_t>(4 * s + c));
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

bool qsdolfinx::insert_curvature(const Surface* master, const Pieces& pieces, Vec cover, Vec lambda,
                                 Vec allowance, std::array<Vec, 2> markers, ContactBlocks blocks,
                                 std::array<double, 2> scale)
{
  const Shares shares(pieces, cover);
  std::vector<double> multipliers = values_at(lambda, first_dofs(pieces));
  std::vector<double> works(multipliers.size());
  if (allowance)
    std::ranges::transform(multipliers, values_at(allowance, first_dofs(pieces)), works.begin(),
                           std::multiplies<>());
  Insertion insertion(master, pieces, markers, blocks, scale);
  const auto nk = static_cast<std::size_t>(pieces.num_multipliers);
  std::vector<double> H(insertion.size() * insertion.size());
  std::vector<std::uint64_t> numbers;
  Asymmetry asymmetry;
  for (std::size_t i = 0; i < pieces.size(); ++i)
  {
    const auto of_piece = std::span(multipliers).subspan(i * nk, nk),
               allowed = std::span(works).subspan(i * nk, nk);
    shares.gather(i, of_piece);
    shares.gather(i, allowed);
    if (std::ranges::all_of(of_piece, is_zero))
      continue;
    std::ranges::fill(H, 0.0);
    const RayPair pair = pair_of(pieces, i);
    add_curvature(pair, pieces.points_of(i), {of_piece, allowed}, H);
    add_rim(pair, pieces.rim_of(i), {of_piece, allowed}, H);
    insertion.number(i, numbers);
    asymmetry.add(H, insertion.size(), numbers);
    insertion.add(i, H);
  }
  insertion.insert();
  MPI_Comm comm;
  check(PetscObjectGetComm(reinterpret_cast<PetscObject>(lambda), &comm));
  return asymmetry.is_none(comm);
}

bool qsdolfinx::insert_curvature_of_points(const Surface* master, const Pieces& pieces,
                                           std::span<const double> pressure,
                                           std::span<const double> at_rim,
                                           std::array<Vec, 2> markers, ContactBlocks blocks,
                                           std::array<double, 2> scale, MPI_Comm comm)
{
  if (pressure.size() < pieces.points.size() || at_rim.size() != pieces.rim.size())
    throw std::invalid_argument("a pressure for each point, and for each one of the rim");
  Insertion insertion(master, pieces, markers, blocks, scale);
  std::vector<double> H(insertion.size() * insertion.size());
  std::vector<std::uint64_t> numbers;
  Asymmetry asymmetry;
  std::size_t first = 0, first_of_rim = 0;
  for (std::size_t i = 0; i < pieces.size(); ++i)
  {
    const auto points = pieces.points_of(i);
    const auto rim = pieces.rim_of(i);
    const auto of_piece = pressure.subspan(first, points.size()),
               of_rim = at_rim.subspan(first_of_rim, rim.size());
    first += points.size();
    first_of_rim += rim.size();
    if (std::ranges::all_of(of_piece, is_zero) && std::ranges::all_of(of_rim, is_zero))
      continue;
    std::ranges::fill(H, 0.0);
    const RayPair pair = pair_of(pieces, i);
    add_curvature_of_points(pair, points, of_piece, H);
    add_rim_of_points(pair, rim, of_rim, H);
    insertion.number(i, numbers);
    asymmetry.add(H, insertion.size(), numbers);
    insertion.add(i, H);
  }
  insertion.insert();
  return asymmetry.is_none(comm);
}

void qsdolfinx::insert_slip_curvature(const Surface* master, const Pieces& pieces, Vec cover,
                                      Vec traction, std::array<Vec, 2> markers,
                                      ContactBlocks blocks, std::array<double, 2> scale)
{
  const Shares shares(pieces, cover);
  std::vector<double> tau = values_at(traction, multiplier_dofs(pieces));
  Insertion insertion(master, pieces, markers, blocks, scale);
  const auto d = static_cast<std::size_t>(pieces.gdim),
             nk = static_cast<std::size_t>(pieces.num_multipliers);
  std::vector<double> H(insertion.size() * insertion.size()), in_space(3 * nk, 0.0);
  for (std::size_t i = 0; i < pieces.size(); ++i)
  {
    const auto of_piece = std::span(tau).subspan(i * nk * d, nk * d);
    shares.gather(i, of_piece);
    if (std::ranges::all_of(of_piece, is_zero))
      continue;
    for (std::size_t k = 0; k < nk; ++k)
      std::copy_n(of_piece.begin() + static_cast<std::ptrdiff_t>(k * d), d,
                  in_space.begin() + static_cast<std::ptrdiff_t>(3 * k));
    std::ranges::fill(H, 0.0);
    add_slip_curvature(pair_of(pieces, i), pieces.points_of(i), pieces.rim_of(i), in_space, H);
    insertion.add(i, H);
  }
  insertion.insert();
}

void qsdolfinx::insert_slip_curvature_of_points(const Surface* master, const Pieces& pieces,
                                                std::span<const double> traction,
                                                std::span<const double> at_rim,
                                                std::array<Vec, 2> markers, ContactBlocks blocks,
                                                std::array<double, 2> scale)
{
  if (traction.size() < 3 * pieces.points.size() || at_rim.size() != 3 * pieces.rim.size())
    throw std::invalid_argument("a traction for each point, and for each one of the rim");
  Insertion insertion(master, pieces, markers, blocks, scale);
  std::vector<double> H(insertion.size() * insertion.size());
  std::size_t first = 0, first_of_rim = 0;
  for (std::size_t i = 0; i < pieces.size(); ++i)
  {
    const auto points = pieces.points_of(i);
    const auto rim = pieces.rim_of(i);
    const auto of_piece = traction.subspan(3 * first, 3 * points.size()),
               of_rim = at_rim.subspan(3 * first_of_rim, 3 * rim.size());
    first += points.size();
    first_of_rim += rim.size();
    if (std::ranges::all_of(of_piece, is_zero) && std::ranges::all_of(of_rim, is_zero))
      continue;
    std::ranges::fill(H, 0.0);
    const RayPair pair = pair_of(pieces, i);
    add_slip_curvature_of_points(pair, points, of_piece, H);
    add_slip_rim_of_points(pair, rim, of_rim, H);
    insertion.add(i, H);
  }
  insertion.insert();
}
