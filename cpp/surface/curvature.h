// Curvature of the surface that flat facets approximate, and how far it bulges out of them.
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

/// Facets that turn by more than this towards each other meet in a crease: cos 30°.
inline constexpr double crease_cosine = 0.8660254037844386;

/// Curvature of this rank's facets, from the turning between facets at their vertices. Collective.
///
/// Nodal normals weighted as by Max (1999), exact on circles and spheres, give the slopes at both
/// ends of the line between two vertices of a facet, and their limited mean its curvature: a flat
/// facet beside a fillet stays flat. Where the surface ends, or has a crease, a normal says
/// nothing about the direction across; then the other end counts alone. Directions that nothing is
/// known of have no curvature.
std::vector<Curvature> facet_curvature(const Surface& surface);

/// How far the surface that facets approximate is over the middles of their edges, along a facet's
/// normal in its centre, [facet][edge] in the order of facet_edges, by the same slopes; exact on
/// circles. Collective.
std::vector<double> edge_heights(const Surface& surface);

/// Curvature of surfaces that are at these heights over this rank's facets.
/// @param heights along the outward normals at the nodes of trace_functions of degree 2,
/// [facet][node]
std::vector<Curvature> curvature_of_heights(const Surface& surface,
                                            std::span<const double> heights);

/// e·K e.
double along(const Curvature& K, const Vec3& e);

/// Height over a facet, along its outward normal, of a surface of curvature K through its vertices.
/// @param v vertex coordinates, @param N shape functions at the point
double bulge(const Curvature& K, FacetType type, std::span<const double> v,
             const std::array<double, 4>& N);

/// ½ (a − b): of two surfaces that face each other, the curvature that both share.
Curvature shared_curvature(const Curvature& a, const Curvature& b);

} // namespace qsdolfinx
