// Closest point on one facet: segment, triangle, bilinear quadrilateral. Geometry only, no MPI.
#pragma once

#include "geometry/facet.h"

namespace qsdolfinx
{

/// Newton's method on a bilinear quadrilateral stops when the step in (ξ, η) is below this ...
inline constexpr double projection_tolerance = 1e-14;
/// ... or after this many iterations; the best point found so far is then returned.
inline constexpr int projection_max_iterations = 30;

/// Closest point of a facet.
struct ClosestPoint
{
  std::array<double, 2> xi{0, 0}; ///< reference coordinates, within the facet
  Vec3 x{0, 0, 0};                ///< the point
  double distance = 0;            ///< its distance from the query
};

/// Closest point of a facet to p.
///
/// Exact on segments and triangles. On a bilinear quadrilateral the distance may have several local
/// minima: the four edges are searched exactly, then Newton's method (projection_tolerance,
/// projection_max_iterations) runs in the interior from the centre and the four quadrants; the
/// nearest of all points found is returned, so that the result is defined even if Newton's method
/// does not converge.
ClosestPoint closest_point(FacetType type, std::span<const double> vertices, const Vec3& p);

} // namespace qsdolfinx
