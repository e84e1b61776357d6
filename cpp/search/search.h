// Closest facets of one surface to the nodes of another, across ranks.
#pragma once

#include "search/radius.h"
#include "surface/surface.h"
#include <cstdint>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Closest point on another surface for every owned node of a surface.
struct ClosestFacets
{
  std::vector<std::uint8_t> found;  ///< 1 if the node is paired
  std::vector<std::int64_t> dofs;   ///< unknowns of the facet's trace, [node][trace node][block]
  std::vector<int> owner;           ///< their owners, [node][trace node]
  std::vector<double> shape_values; ///< trace functions at the closest point, [node][trace node]
  std::vector<double> x;            ///< closest point, [node][3]
  std::vector<double> normal;       ///< outward unit normal of the facet there, [node][3]
  std::vector<double> mean_normal;  ///< mean of the normals of all facets that have this closest
                                    ///< point
  std::vector<double> middle;       ///< mean of the facet's vertices, [node][3]
  std::vector<double> xi;           ///< reference coordinates of the closest point, [node][2]
  std::vector<double> nodes_x;      ///< positions of the facet's trace nodes, for surfaces with
                                    ///< updated geometry or of degree 1, [node][trace node][3]
  std::vector<std::uint8_t> side;   ///< sides of its vertices, if requested, [node][vertex]
};

/// Points of a surface with outward normals there.
struct Places
{
  std::span<const double> x;                   ///< [point][3]
  std::span<const double> normal;              ///< unit normals, [point][3]
  std::span<const double> size_of_facets = {}; ///< size of the largest facet at each point, if
                                               ///< needed

  /// Size of the largest facet at a point, 0 if it is not known.
  double facet_size(std::size_t k) const { return size_of_facets.empty() ? 0 : size_of_facets[k]; }
  std::size_t size() const { return x.size() / 3; }
};

/// Find, for each owned node of `nodes`, the closest point on the facets of `surface`. Collective.
///
/// A closest facet that is further away than the radius leaves the node unpaired. Three kinds of
/// facets do not count: facets that do not face the node (see facing_cosine: the back of a body),
/// facets that are hidden (see `hidden`), and facets through which the node has not entered the
/// body (see WaysOut). For a node that is beside its closest facet, or hidden by the back of
/// another facet, the next facet in front of it is taken, if there is one. Local searches use a
/// tree of the facets' boxes, O(log n) per node. Nodes are sent only to ranks whose box of facets
/// is within the largest radius.
/// @param sides of the vertices of the surface's facets on this rank, [facet][vertex], to be
/// returned for the facets that are found; null, on all ranks, if they are not needed
ClosestFacets closest_facets(const Surface& nodes, const Surface& surface,
                             const SearchRadius& radius,
                             const std::vector<std::uint8_t>* sides = nullptr);

/// Find the closest points for any points of this rank. @param own surface on which the points are
ClosestFacets closest_facets(const Places& points, const Surface& own, const Surface& surface,
                             const SearchRadius& radius);

/// Find the closest points for places on the first surface that have their own normals. Facets
/// count if their normal and that of the place enclose an angle of more than 120°. Collective.
ClosestFacets closest_opposite(const Surface& of_places, const Nodes& places,
                               const Surface& surface, const SearchRadius& radius,
                               const std::vector<std::uint8_t>* sides);

} // namespace qsdolfinx
