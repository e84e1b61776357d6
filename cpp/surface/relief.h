// Surface correction for curvature: height of the surface that flat facets approximate above them,
// and the part of this height that is used in gaps.
#pragma once

#include "surface/curvature.h"
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Part of the surface's height above its facets that is used in gaps.
enum class Lift : int
{
  none,   ///< nothing: gaps are measured between the facets
  shared, ///< the curvature that both sides share, for bodies whose displacements cannot flatten
          ///< the bulge of a facet
  own     ///< all of it
};

/// Surface of one side, as heights above its facets.
struct Relief
{
  Lift lift;
  bool known; ///< whether `heights` are given; otherwise curvature is found from the angles between
              ///< facets
  /// Heights along the outward normals at the nodes of trace_functions of degree 2, [facet][node],
  /// if `known`.
  std::span<const double> heights;
};

/// Positions of the nodes of degree 2 on the flat facets, [facet][node][3].
std::vector<double> relief_nodes(const Surface& surface);

/// Outward unit normals of the flat facets at the nodes of degree 2, [facet][node][3].
std::vector<double> relief_normals(const Surface& surface);

/// Height at ξ of a facet. @param heights at its nodes
double height_at(FacetType type, std::span<const double> heights, std::array<double, 2> xi);

/// Height at ξ of the plane or bilinear surface through a facet's vertices.
double vertex_height(FacetType type, std::span<const double> heights,
                     const std::array<double, 4>& N);

/// Gradient along a facet of a function of ξ that is quadratic along each axis.
template <typename Function>
Vec3 surface_gradient(FacetType type, std::span<const double> v, std::array<double, 2> xi,
                      const Function& function)
{
  // Central differences of quadratic functions are exact.
  const auto difference = [&](const auto& of, int axis)
  {
    auto low = xi, high = xi;
    low[axis] -= 0.5;
    high[axis] += 0.5;
    return of(high) - of(low);
  };
  const auto point = [&](std::array<double, 2> at) { return facet_point(type, v, at); };
  const Vec3 a = difference(point, 0);
  const double along_a = difference(function, 0);
  if (type == FacetType::interval)
    return (along_a / dot(a, a)) * a;
  const Vec3 b = difference(point, 1);
  const double along_b = difference(function, 1);
  const double aa = dot(a, a), ab = dot(a, b), bb = dot(b, b), det = aa * bb - ab * ab;
  return ((along_a * bb - along_b * ab) / det) * a + ((along_b * aa - along_a * ab) / det) * b;
}

/// Curvature of this rank's facets, from the heights if they are known, otherwise from the angles
/// between facets. Collective.
std::vector<Curvature> relief_curvature(const Surface& surface, const Relief& relief);

} // namespace qsdolfinx
