// How points of a piece of the overlay move on the facet that is cut, as the corners of the piece
// do, and what that adds to derivatives of sums over the points. No MPI.
#pragma once

#include "geometry/planar.h"
#include "sliding/ray.h"

#include <array>
#include <cstdint>
#include <span>

namespace qsdolfinx
{

/// Corner of a piece: a vertex of one of the facets, projected, or where edges of both cross.
struct PieceCorner
{
  /// Vertices at the ends of each facet's edge, twice the same where the corner is that; −1 where
  /// it is a vertex of the other facet.
  std::array<std::int8_t, 2> cut{-1, -1}, other{-1, -1};
  bool around = true; ///< whether it is one of those that the middle of the piece is between
};

/// Number of the middle of a piece as a corner.
inline constexpr std::uint8_t middle_corner = 255;

/// Where a point is in a triangle between corners of its piece, in 2D in the interval: it keeps its
/// place there, and its part of the area.
struct PointPlace
{
  std::array<std::uint8_t, 3> corner;
  std::array<double, 2> at; ///< coordinates in the triangle or interval
};

/// A piece.
struct PieceShape
{
  std::span<const PieceCorner> corners; ///< anticlockwise; none if points do not move
  std::span<const PointPlace> places;   ///< of its points
  bool axisymmetric = false;            ///< whether areas are those of rings
};

/// How points move: δξ₁, δξ₂ and δ ln w by the nodes of both. @param out [point][3][node][3]
void point_motions(const RayPair& pair, const PieceShape& shape, std::span<const RayPoint> points,
                   std::span<double> out);

/// Add what the motion of points adds to the derivative of Σ_p w_p p_p ∂g_p, p_p constant, the rest
/// of which is of fixed ξ and w.
/// @param motions as point_motions has them @param pressure p_p, [point] @param hessian
/// [node][3][node][3], rows are those of ∂g_p; not symmetric
void add_motion_of_points(const RayPair& pair, std::span<const double> motions,
                          std::span<const RayPoint> points, std::span<const double> pressure,
                          std::span<double> hessian);

/// The same of Σ_p w_p τ_p·(what tractions work on), see RaySlip. @param traction τ_p, [point][3]
void add_slip_motion_of_points(const RayPair& pair, std::span<const double> motions,
                               std::span<const RayPoint> points, std::span<const double> traction,
                               std::span<double> hessian);

} // namespace qsdolfinx
