// Derivative of contact forces, and of the equations of multipliers, at the points of one piece.
#pragma once

#include "sliding/changes.h"
#include "tangent/point_forces.h"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Matrix of a piece. Its rows are first those of the nodes of the piece, [node][3], the slave's
/// first, and then those of its multipliers, [component][multiplier].
class PieceMatrix
{
public:
  /// Arguments as for add_point_forces. @param own whether each piece has one multiplier
  PieceMatrix(const Pieces& pieces, const SlipOfPieces* slip, const PointState& at, bool own);

  std::size_t size() const { return size_; }
  std::size_t num_functions() const { return nk_; }
  /// Row of a multiplier.
  std::size_t row_of(std::size_t component, std::size_t k) const
  {
    return n_ + component * nk_ + k;
  }
  /// Compute the matrix of a piece. @param first number of its first point
  std::span<const double> of(std::size_t piece, std::size_t first);

private:
  void set_piece(const RayPair& pair);
  RayStress stress_of(std::size_t p) const;
  bool has_force(std::size_t p) const;
  void set_place(std::size_t p);
  void set_trials(const Rays& rays, std::size_t p);
  void add_kept(std::size_t r, std::size_t p, WideRow& to) const;
  void set_stresses(std::size_t p);
  void add_equations(std::size_t p);
  void add_turning();
  void add_rise(const RayPair& pair);

  const Pieces& pieces_;
  const SlipOfPieces* slip_;
  const PointState& at_;
  bool own_;
  std::size_t m_, n_, nk_, size_; ///< components, rows of nodes, multipliers, all rows
  bool has_functions_;
  std::vector<std::vector<double>> lambda_;  ///< λ_ck of each component; empty if it is constant
  std::vector<std::vector<double>> missing_; ///< see PointState, for each component; empty for 0
  std::vector<std::vector<double>> begun_;   ///< see PointState, for each component
  std::vector<double> matrix_, velocity_;
  std::vector<PointMotion> motions_;

  // Of the current piece:
  std::size_t piece_ = 0, first_ = 0;
  std::span<const RayPoint> points_;
  bool cut_is_slave_ = true;
  Vec3 normal_{};                                  ///< outward of the slave
  std::vector<double> turn_, slips_, spin_;        ///< slips: of the current point
  std::array<std::array<double, 3>, 4> turning_{}; ///< Σ_p w_p N_k turning_p, [multiplier]

  // Of the current point:
  RayChange change_;
  std::array<double, 4> N_{};
  std::array<std::array<double, 2>, max_trace> dN_{};
  std::array<WideRow, 4> trials_, stresses_; ///< Δy_c, and Σ_l D_cl Δy_l; then γ_c times it
  std::array<forms::Row, 4> moved_;          ///< Δλ_c as the point moves
};

} // namespace qsdolfinx
