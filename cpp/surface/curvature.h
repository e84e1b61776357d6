// Curvature of the surface that flat facets approximate, and its height above the facets.
#pragma once

#include "surface/surface.h"
#include <array>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Symmetric tensor K with dn = K dx for the outward normal, positive where a body is convex:
/// xx, yy, zz, xy, xz, yz.
using Curvature = std::array<double, 6>;

/// Curvature of this rank's facets, from the angles between facets at their vertices. Collective.
///
/// Nodal normals weighted as by Max (1999), exact on circles and spheres, give the slopes at both
/// ends of the line between two vertices of a facet, and the limited mean of these slopes gives the
/// facet's curvature: a flat facet beside a fillet stays flat. At the boundary of the surface or at
/// a sharp edge, a normal gives no information about the direction across; then only the other end
/// is used. Directions without any information have no curvature.
std::vector<Curvature> facet_curvature(const Surface& surface);

/// Heights of the surface that the facets approximate above the middles of their edges, along a
/// facet's normal at its centre, and the weight of this facet's height in the mean with that of the
/// facet beside it, [facet][edge][2] in the order of facet_edges. They are computed from
/// the same slopes as in facet_curvature and exact on circles. Collective.
std::vector<double> edge_heights(const Surface& surface);

/// e·K e.
double along(const Curvature& K, const Vec3& e);

/// Height over a facet, along its outward normal, of a surface of curvature K through its vertices.
/// @param v vertex coordinates, @param N shape functions at the point
double bulge(const Curvature& K, FacetType type, std::span<const double> v,
             const std::array<double, 4>& N);

/// ½ (a − b): curvature that two surfaces facing each other share.
Curvature shared_curvature(const Curvature& a, const Curvature& b);

} // namespace qsdolfinx
