// Motion of the points of a piece of the overlay on the facet that is cut, which follows from the
// motion of the piece's corners. No MPI.
#pragma once

#include "geometry/planar.h"
#include "sliding/ray.h"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

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

/// Motion of a point: δξ₁, δξ₂ and δ ln w as sums of velocities of the corners of its triangle, in
/// the plane of the facet that is cut, and of this facet's vertices; and δ ln w by the rotation of
/// the facets towards each other.
struct PointMotion
{
  std::array<std::uint8_t, 3> corner{};                 ///< numbers of the corners
  std::array<std::array<double, 6>, 3> by_corner{};     ///< [motion][corner][direction]
  std::array<std::array<double, 3 * 4>, 3> by_vertex{}; ///< [motion][vertex][3]
  double by_facing = 0;                                 ///< ∂ ln w/∂(−m·n), see facing_weight
};

/// Motions of the points of a piece.
struct PieceMotion
{
  /// Of corners, then of the middle, [corner][direction][node][3]; at the end δ(−m·n), [node][3],
  /// if the points' weights depend on it.
  std::span<const double> velocity;
  std::span<const PointMotion> points;
};

/// Compute the motions of the points of a piece. @param velocity, motions appended, as in
/// PieceMotion
void append_motions(const RayPair& pair, const PieceShape& shape, std::span<const RayPoint> points,
                    std::vector<double>& velocity, std::vector<PointMotion>& motions);

} // namespace qsdolfinx
