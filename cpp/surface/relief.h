// How far the surface that flat facets stand for is out of them, and what of it contact sees.
#pragma once

#include "surface/curvature.h"
#include <span>
#include <vector>

namespace qsdolfinx
{

/// What of the surface's height over its facets is part of gaps.
enum class Lift : int
{
  none,   ///< nothing: facets are taken as they are
  shared, ///< the curvature that both sides share, for bodies whose displacements cannot flatten a
          ///< facet's bulge
  own     ///< all of it
};

/// One side's surface over its facets.
struct Relief
{
  Lift lift;
  bool known; ///< otherwise only the turning between facets tells of a curvature
  /// Heights along the outward normals at the nodes of trace_functions of degree 2, [facet][node],
  /// if they are known.
  std::span<const double> heights;
};

/// Positions of these nodes on the flat facets, [facet][node][3].
std::vector<double> relief_nodes(const Surface& surface);

/// Outward unit normals of the flat facets there, [facet][node][3].
std::vector<double> relief_normals(const Surface& surface);

/// Height at ξ of a facet. @param heights at its nodes
double height_at(FacetType type, std::span<const double> heights, std::array<double, 2> xi);

/// Height at ξ of the plane or bilinear surface through a facet's vertices.
double vertex_height(FacetType type, std::span<const double> heights,
                     const std::array<double, 4>& N);

/// Curvature of this rank's facets: that of the heights, or by the turning between facets.
/// Collective.
std::vector<Curvature> relief_curvature(const Surface& surface, const Relief& relief);

} // namespace qsdolfinx
