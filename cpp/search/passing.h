// Points that have passed through a body of another surface while both moved.
#pragma once

#include "surface/surface.h"

namespace qsdolfinx
{

/// Cosine of the angle (60°) between the outward normals of a point and of a face below which the
/// face lets the point out of a body it should not have been in: the face looks the way that the
/// point does, so that the body between them is now behind the point, within the point's own body.
inline constexpr double alike_cosine = 0.5;

/// Straight path of a point of a surface, at constant speed.
struct Path
{
  Vec3 start, end;
  Vec3 normal; ///< outward unit normal at the point, at the end
};

/// Lengths of the paths within bodies that the points have passed through, [path]; 0 for all other
/// points. Collective.
///
/// A point has passed through a body if it has come out of it, and not gone in again, through faces
/// that look the way it does (see alike_cosine). The length counts from where it went in first,
/// from the start of the path if it was within the body. Facets that touch the start do not count.
/// @param surface at the end of the motion
/// @param start_x vertices of its facets at the start, [facet][vertex][3]
std::vector<double> passed_lengths(const Surface& surface, std::span<const double> start_x,
                                   std::span<const Path> paths);

} // namespace qsdolfinx
