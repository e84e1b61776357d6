// Closest facets of one surface to the nodes of another, across ranks.
#pragma once

#include "search/radius.h"
#include "surface/surface.h"
#include <cstdint>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// For every owned node of a surface the closest point of another surface.
struct ClosestFacets
{
  std::vector<std::uint8_t> found;  ///< 1 if the node is paired
  std::vector<std::int64_t> dofs;   ///< unknowns of the facet's trace, [node][trace node][block]
  std::vector<int> owner;           ///< their owners, [node][trace node]
  std::vector<double> shape_values; ///< trace functions at the closest point, [node][trace node]
  std::vector<double> x;            ///< closest point, [node][3]
  std::vector<double> normal;       ///< outward unit normal of the facet there, [node][3]
  std::vector<double> mean_normal;  ///< mean of those of all facets whose closest point it is
  std::vector<double> middle;       ///< mean of the facet's vertices, [node][3]
  std::vector<double> xi;           ///< reference coordinates of the closest point, [node][2]
  std::vector<double> nodes_x;      ///< nodes of the facet's trace, of surfaces that follow a body
                                    ///< or are of degree 1, [node][trace node][3]
  std::vector<std::uint8_t> side;   ///< sides of its vertices that were asked for, [node][vertex]
};

/// Points of a surface with outward normals there.
struct Places
{
  std::span<const double> x;                   ///< [point][3]
  std::span<const double> normal;              ///< unit normals, [point][3]
  std::span<const double> size_of_facets = {}; ///< of the largest facet at each, if it matters

  /// Size of the largest facet at a point, 0 if it is not known.
  double facet_size(std::size_t k) const { return size_of_facets.empty() ? 0 : size_of_facets[k]; }
  std::size_t size() const { return x.size() / 3; }
};

/// Search, for each owned node of `nodes`, the closest point on the facets of `surface`.
/// Collective.
///
/// A closest facet that is further away than the radius leaves the node unpaired. Facets that do
/// not face the node (see facing_cosine: the back of a body) do not count. Nor do those that are
/// hidden, see `hidden`, or that it has not come in by, see WaysOut; a node that is beside its
/// closest facet or behind a back finds the next one in front of it, if there is one. Local
/// searches use a tree of the facets' boxes, O(log n) a node; nodes travel only to ranks whose
/// facets' box is within the largest radius.
/// @param sides of the vertices of the surface's facets on this rank, [facet][vertex], to be told
/// of those that are found; null, on all ranks, if nobody wants to know
ClosestFacets closest_facets(const Surface& nodes, const Surface& surface,
                             const SearchRadius& radius,
                             const std::vector<std::uint8_t>* sides = nullptr);

/// The same for any points of this rank. @param own surface that they are on
ClosestFacets closest_facets(const Places& points, const Surface& own, const Surface& surface,
                             const SearchRadius& radius);

/// The same for places with normals of their own on the first surface. Facets count if their normal
/// and the place's enclose more than 120°. Collective.
ClosestFacets closest_opposite(const Surface& of_places, const Nodes& places,
                               const Surface& surface, const SearchRadius& radius,
                               const std::vector<std::uint8_t>* sides);

} // namespace qsdolfinx
