// Pairing points on the segments of two surfaces (their overlay): exact quadrature of (7).
#pragma once

#include "geometry/planar.h"
#include "pairing/pairing.h"
#include "pairing/pieces.h"
#include "search/kept_pairs.h"
#include "surface/heights.h"

namespace qsdolfinx
{

/// Intersections that are smaller than this fraction of the facet's area are left out of the
/// overlay. They are remainders of sides that coincide, see `intersect`.
inline constexpr double sliver_tolerance = 4e-9;

/// Quadrature rules on the pieces (segments) of the overlay.
struct OverlayRules
{
  Rule piece; ///< points on the interval [0, 1] (2D) or triangle (3D)
  Rule edge;  ///< points on the interval for integrals along edges, see PlanarFacet::integrals
};

/// Compute pairing points on the overlay of two surfaces. Each point is on the rank that owns the
/// facet that was cut. Collective.
///
/// Every facet of the slave is cut into segments along the facets of the other surface that it
/// faces. With `both` every facet of the master is cut as well, and each side has half the weight.
/// The facets of the other surface are projected onto the plane of the facet that is cut, along its
/// normal, which is also the direction from ξ_p to ζ_p. The normal n_p is chosen by `normals`. A
/// pair of points counts if the points are visible from each other: on the line through both, in
/// both directions, no other facet of a point's own surface is met before the point, and the point
/// is the nearer one of two. In addition there must be no shorter way for them out of the other
/// body, see WaysOut.
///
/// The shape functions of general quadrilaterals are not polynomials in the plane. On each piece a
/// constant is added to each of them, so that Σ w_p N_i(ξ_p) is the exact integral. Their sum stays
/// 1, and they still interpolate positions exactly.
///
/// @param both whether both halves of (7) are integrated; otherwise only the integral over the
/// slave
/// @param radius points further than this from the other surface are left out
/// @param normals choice of the normals n_p
/// @param rules quadrature
/// @param slave_heights, master_heights of curved facets, between which gaps are measured
PairingPoints overlay_surfaces(const Surface& slave, const Surface& master, bool both,
                               const SearchRadius& radius, Normals normals,
                               const OverlayRules& rules, const Heights& slave_heights,
                               const Heights& master_heights);

/// Compute the pieces of the overlay together with their facets, for updated geometry. Gaps are
/// measured along the normals of the facets that were cut; the ends of the rays have been solved
/// for. Collective.
/// @param slave, master surfaces with updated geometry, see Surface::follow
/// @param pairs of these surfaces, which are kept from one call to the next
Pieces overlay_pieces(const Surface& slave, const Surface& master, bool both, KeptPairs& pairs,
                      const OverlayRules& rules);

/// A point of the overlay where both surfaces are curved the same way.
struct ConformingPoint
{
  double slave, master; ///< heights of the surfaces above flat facets, along the slave's normal,
                        ///< from the curvature that both share; 0 on curved facets
  double gap;           ///< gap between the curved surfaces
  double weight;        ///< area
};

/// Points of the slave that are paired with the master, and those where both surfaces are curved
/// the same way with radii that differ by less than a factor of two.
struct Conforming
{
  PairingPoints points; ///< `gap` is the change of the gap by the chord errors of flat facets
  std::vector<ConformingPoint> found;
};

/// Find the points where both surfaces are curved the same way, from the angles between their
/// facets. Collective. @param are_flat whether gaps are measured from flat facets of slave and
/// master
Conforming conforming_points(const Surface& slave, const Surface& master,
                             const SearchRadius& radius, const OverlayRules& rules,
                             std::array<bool, 2> are_flat);

} // namespace qsdolfinx
