// Heights of the facets of a mesh of degree 2 above the flat facets through their vertices.
#pragma once

#include "surface/surface.h"
#include <optional>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Heights of the curved facets of a surface, along the outward normals of the flat facets at the
/// nodes of trace_functions of degree 2, [facet][node]. None, on all ranks, for flat facets.
using Heights = std::optional<std::span<const double>>;

/// Positions of the nodes of degree 2 on the flat facets, [facet][node][3].
std::vector<double> flat_nodes(const Surface& surface);

/// Outward unit normals of the flat facets at the nodes of degree 2, [facet][node][3].
std::vector<double> flat_normals(const Surface& surface);

/// Height at ξ of a facet. @param heights at its nodes
double height_at(FacetType type, std::span<const double> heights, std::array<double, 2> xi);

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

} // namespace qsdolfinx
