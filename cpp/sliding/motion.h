// Motion of the points of a piece of the overlay on the facet that is cut, which follows from the
// motion of the piece's corners, and its contribution to derivatives of sums over the points. No
// MPI.
#pragma once

#include "geometry/planar.h"
#include "sliding/ray.h"

#include <array>
#include <cstdint>
#include <span>

namespace qsdolfinx
{

/// Corner of a piece: a projected vertex of one of the facets, or a crossing of edges of both.
struct PieceCorner
{
  /// Vertices at the ends of each facet's edge. Both are the same if the corner is this vertex; −1
  /// if the corner is a vertex of the other facet.
  std::array<std::int8_t, 2> cut{-1, -1}, other{-1, -1};
  bool around = true; ///< whether the middle of the piece is computed from this corner
};

/// Number of the middle of a piece as a corner.
inline constexpr std::uint8_t middle_corner = 255;

/// Position of a point in a triangle between corners of its piece, in 2D in the interval. The point
/// keeps this position, and its fraction of the area.
struct PointPlace
{
  std::array<std::uint8_t, 3> corner;
  std::array<double, 2> at; ///< coordinates in the triangle or interval
};

/// A piece.
struct PieceShape
{
  std::span<const PieceCorner> corners; ///< anticlockwise; empty if points do not move
  std::span<const PointPlace> places;   ///< positions of its points
  bool axisymmetric = false;            ///< whether areas are those of rings
};

/// Compute how points move: the derivatives of ξ₁, ξ₂ and ln w by the nodes of both facets. @param
/// out [point][3][node][3]
void point_motions(const RayPair& pair, const PieceShape& shape, std::span<const RayPoint> points,
                   std::span<double> out);

/// Add the contribution of the motion of points to the derivative of Σ_p w_p p_p ∂g_p for constant
/// p_p. The rest of this derivative is for fixed ξ and w.
/// @param motions from point_motions @param pressure p_p, [point] @param hessian
/// [node][3][node][3], rows are those of ∂g_p; not symmetric
void add_motion_of_points(const RayPair& pair, std::span<const double> motions,
                          std::span<const RayPoint> points, std::span<const double> pressure,
                          std::span<double> hessian);

/// Add the same contribution for Σ_p w_p τ_p·(variation that tractions work on), see
/// RaySlip::works. @param traction τ_p, [point][3]
void add_slip_motion_of_points(const RayPair& pair, std::span<const double> motions,
                               std::span<const RayPoint> points, std::span<const double> traction,
                               std::span<double> hessian);

} // namespace qsdolfinx
