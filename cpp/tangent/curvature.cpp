#include "tangent/curvature.h"
#include "gap/piece_forces.h"
#include "parallel/petsc.h"
#include "sliding/rise.h"

#include <algorithm>
#include <stdexcept>

using namespace qsdolfinx;

namespace
{
/// Adds matrices of pieces, [node][3][node][3], the slave's nodes first, to the matrix of all
/// unknowns.
class Insertion
{
public:
  /// @throws std::invalid_argument if there is not a number for each unknown of the pieces
  Insertion(const Pieces& pieces, const Destination& to)
      : num_sides_(to.numbers[1].empty() ? 1 : 2), to_(to),
        d_(static_cast<std::size_t>(pieces.gdim)),
        nodes_{static_cast<std::size_t>(pieces.slave.num_nodes),
               static_cast<std::size_t>(pieces.master.num_nodes)},
        sums_(to.sums)
  {
    for (int s = 0; s < num_sides_; ++s)
      if (to.numbers[s].size() != pieces.size() * nodes_[s] * d_)
        throw std::invalid_argument("a number for each unknown");
    for (int s = 0; s < num_sides_; ++s)
      for (std::size_t i = 0; i < nodes_[s] * d_; ++i)
      {
        of_matrix_.push_back(3 * (s * nodes_[0] + i / d_) + i % d_);
        scale_.push_back(to.scale[s]);
      }
  }

  /// Rows of a matrix.
  std::size_t size() const { return 3 * (nodes_[0] + nodes_[1]); }

  void add(std::size_t piece, std::span<const double> H)
  {
    const std::size_t n = of_matrix_.size();
    numbers_.clear();
    for (int s = 0; s < num_sides_; ++s)
    {
      const auto own = to_.numbers[s].subspan(piece * nodes_[s] * d_, nodes_[s] * d_);
      numbers_.insert(numbers_.end(), own.begin(), own.end());
    }
    block_.resize(n * n);
    for (std::size_t r = 0; r < n; ++r)
      for (std::size_t c = 0; c < n; ++c)
        block_[r * n + c] = scale_[c] * H[of_matrix_[r] * size() + of_matrix_[c]];
    sums_.add(numbers_, numbers_, block_);
  }

private:
  int num_sides_;
  const Destination& to_;
  std::size_t d_;
  std::array<std::size_t, 2> nodes_;
  std::vector<std::size_t> of_matrix_; ///< rows of a matrix that are unknowns
  std::vector<double> scale_;          ///< of these
  RowSums& sums_;
  std::vector<PetscInt> numbers_; ///< reused storage
  std::vector<double> block_;     ///< reused storage
};

/// Terms of the derivatives of the pieces' forces: for fixed points, for the motion of points, and
/// for heights.
struct Terms
{
  using Points = std::span<const RayPoint>;
  using In = std::span<const double>;
  using Out = std::span<double>;
  void (*fixed)(const RayPair&, Points, In, Out);
  void (*moving)(const RayPair&, const PieceMotion&, Points, In, Out);
  void (*rising)(const RayPair&, Points, In, Out, Out);
};

/// @param stress [point][width]
void add_pieces(const Pieces& pieces, std::span<const double> stress, std::size_t width, bool moves,
                const Destination& to, const Terms& terms)
{
  if (stress.size() < width * pieces.points.size())
    throw std::invalid_argument("a pressure or traction for each point");
  Insertion insertion(pieces, to);
  const bool have_corners = moves && !pieces.corner_end.empty();
  std::vector<double> H(insertion.size() * insertion.size()), by_normals;
  for (std::size_t i = 0, first = 0; i < pieces.size(); first = pieces.end[i++])
  {
    const auto points = pieces.points_of(i);
    const auto of_piece = stress.subspan(width * first, width * points.size());
    if (std::ranges::all_of(of_piece, [](double value) { return value == 0; }))
      continue;
    std::ranges::fill(H, 0.0);
    const RayPair pair = pair_of(pieces, i);
    terms.fixed(pair, points, of_piece, H);
    if (have_corners)
      terms.moving(pair, motion_of(pieces, i), points, of_piece, H);
    if (moves)
    {
      by_normals.assign(3 * insertion.size() * static_cast<std::size_t>(pair.other.num_vertices()),
                        0.0);
      terms.rising(pair, points, of_piece, H, by_normals);
    }
    insertion.add(i, H);
  }
}
} // namespace

std::vector<std::int64_t> qsdolfinx::free_unknowns(const PieceSide& side, Vec markers)
{
  const std::vector<double> marked = values_at(markers, side.dofs);
  std::vector<std::int64_t> out = side.dofs;
  for (std::size_t i = 0; i < out.size(); ++i)
    if (marked[i] != 0)
      out[i] = -1;
  return out;
}

void qsdolfinx::add_curvature(const Pieces& pieces, std::span<const double> pressure, bool moves,
                              const Destination& to)
{
  add_pieces(pieces, pressure, 1, moves, to,
             {add_curvature_of_points, add_motion_of_points, add_forces_by_rise});
}

void qsdolfinx::add_slip_curvature(const Pieces& pieces, std::span<const double> traction,
                                   bool moves, const Destination& to)
{
  add_pieces(pieces, traction, 3, moves, to,
             {add_slip_curvature_of_points, add_slip_motion_of_points, add_slip_forces_by_rise});
}
