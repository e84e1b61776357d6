// Forces at the rays of a piece whose points move, and their derivatives by the nodes of both
// facets. No MPI.
#pragma once

#include "sliding/forms.h"
#include "sliding/motion.h"

#include <array>
#include <span>

namespace qsdolfinx
{

/// A linear form in the components of all nodes and in the multipliers of up to 4 components.
using WideRow = std::array<double, forms::max_columns + 4 * 4>;

/// Variations at a ray by the nodes of both facets. The point moves on its facet as its piece does,
/// and the end and the length of the ray follow.
struct RayChange
{
  std::array<forms::Row, 2> xi, zeta;
  forms::Row ln_weight, t;
};

/// @param motion of the points of the piece; empty if they do not move
void change_of_ray(const Rays& rays, std::size_t point, const PieceMotion& motion, RayChange& out);

/// Stresses at a point, times its weight.
struct RayStress
{
  double pressure;
  Vec3 traction;
};

/// Derivative of the forces f·v of rays, where v is the variation of the distance between both ends
/// of a ray, see forms.h: f pushes one facet at the start of the ray, −f the other at its end. f is
/// the work of the pressure on gaps, see gap_gradients, and of the traction on the sliding of the
/// end, see RaySlip::works. Let Δ be the variations of RayChange; then
///
///   Δ(f·v) = Δf·v + f·(Σ ΔT_i δy_i − Σ ΔM_j δz_j + Δt δn + t Δδn),
///
/// and Δf = Σ_k (Δφ_k A_k + φ_k ΔA_k) with the rows A_k of J⁻¹ and ΔA_k = −A_k ΔJ J⁻¹. Heights of a
/// curved surface change with ζ alone; see rise.h for the rest.
class RayForces
{
public:
  /// @param width number of columns of the matrix, those of the nodes first
  /// @param matrix added, [row of a node][width]
  RayForces(const Rays& rays, std::size_t width, std::span<double> matrix);

  /// Add the force of a point.
  /// @param changes of the pressure, and of the components of the traction if there is one, times
  /// the weight, which is constant here
  void add(std::size_t point, const RayChange& change, const RayStress& stress,
           std::span<const WideRow> changes);
  /// Add the terms of all points with the direction of the rays. Call it at the end.
  void finish();

private:
  const Rays& rays_;
  std::size_t width_;
  double* matrix_;
  Vec3 lever_{};                         ///< Σ t f
  std::array<WideRow, 3> lever_changes_; ///< its change
};

} // namespace qsdolfinx
