// Points that have passed through a body of another surface while both moved.
#pragma once

#include "surface/surface.h"

namespace qsdolfinx
{

/// Cosine of the angle (60°) between the outward normals of a point and of a face below which the
/// face lets the point out of a body it should not have been in: the face looks the way that the
/// point does, so that the body between them is now behind the point, within the point's own body.
inline constexpr double alike_cosine = 0.5;

/// Sine of the angle (6°) between a path and a face below which the path is straighter than that of
/// the point: it glides along the face, around the edge, and away from it.
inline constexpr double grazing_sine = 0.1;

/// Motion of facets and of points, straight and at constant speed in each of its pieces.
struct Paths
{
  std::size_t num_pieces;          ///< positions are given at one time more
  std::span<const double> facet_x; ///< vertices of this rank's facets, [time][facet][vertex][3]
  std::span<const double> x;       ///< points of another surface, [time][point][3]
  std::span<const double> normal;  ///< their outward unit normals, [time][point][3]
};

/// Depths of the paths within bodies that the points have passed through, [point]; 0 for all other
/// points. Collective.
///
/// A point has passed through a body if it has come out of it, and not gone in again, through faces
/// that look the way it does (see alike_cosine). The path within counts from where it went in
/// first, from the start if it was within the body or on it. The depth is the distance of its end
/// from the face where it went in, or of its start from that where it comes out, if smaller. Paths
/// that graze one of these faces (see grazing_sine) do not count.
std::vector<double> passed_depths(const Surface& surface, const Paths& paths);

} // namespace qsdolfinx
