// Pairing points on the overlay of two surfaces: exact quadrature of (7).
#pragma once

#include "geometry/planar.h"
#include "pairing/pairing.h"
#include "pairing/pieces.h"
#include "surface/relief.h"

namespace qsdolfinx
{

/// Parts of a facet that are smaller than this part of its area are left out of the overlay: what
/// sides that coincide, see `intersect`, leave of it.
inline constexpr double sliver_tolerance = 4e-9;

/// Quadrature on the pieces of the overlay.
struct OverlayRules
{
  Rule piece; ///< points on the interval [0, 1] (2D) or triangle (3D)
  Rule edge;  ///< points on the interval for integrals along edges, see PlanarFacet::integrals
};

/// Pairing points on the overlay of two surfaces, on the ranks that own the facets they were made
/// from. Collective.
///
/// Every facet of the slave, and with `both` also every facet of the master, each with half the
/// weight, is cut along the facets of the other surface that it faces. Those are projected onto its
/// plane, along its normal, which is the direction from ξ_p to ζ_p as well. The normal n_p is
/// chosen by `normals`. A pair of points counts if each sees the other: on the line through both,
/// looking both ways, nothing of its surface is met before it, and it is the nearer of two; and if
/// they have no shorter way out of each other's body, see WaysOut.
///
/// The shape functions of general quadrilaterals are not polynomials in the plane. On each piece a
/// constant is added to them that makes Σ w_p N_i(ξ_p) the exact integral; their sum stays 1 and
/// they still interpolate positions exactly.
///
/// @param both (7) with both halves; otherwise the integral over the slave alone
/// @param radius points further than this from the other surface are left out
/// @param normals which normals n_p are
/// @param rules quadrature
/// @param slave_relief, master_relief what of the curved surfaces that the facets approximate gaps
/// are measured from
PairingPoints overlay_surfaces(const Surface& slave, const Surface& master, bool both,
                               const SearchRadius& radius, Normals normals,
                               const OverlayRules& rules, const Relief& slave_relief,
                               const Relief& master_relief);

/// The same pieces with the facets they were cut from, gaps being along the normals of these, which
/// have been solved for.
/// Collective.
/// @param slave, master surfaces that follow their bodies, see Surface::follow
Pieces overlay_pieces(const Surface& slave, const Surface& master, bool both,
                      const SearchRadius& radius, const OverlayRules& rules);

/// Where surfaces are curved the same way, at a point of the overlay.
struct ConformingPoint
{
  double slave, master; ///< how far the surfaces bulge out of the facets, along the slave's normal,
                        ///< by the curvature that both share
  double gap;           ///< of the curved surfaces
  double weight;        ///< area
};

/// Points of the slave, paired with the master, where both are curved the same way, by radii that
/// differ by less than a factor of two. Collective.
/// @param slave_relief, master_relief where curvatures are known from
/// @param area of all points of the slave that are paired on this rank
std::vector<ConformingPoint> conforming_points(const Surface& slave, const Surface& master,
                                               const SearchRadius& radius,
                                               const OverlayRules& rules,
                                               const Relief& slave_relief,
                                               const Relief& master_relief, double& area);

} // namespace qsdolfinx
