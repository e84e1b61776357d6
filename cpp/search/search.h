// Closest facets of one surface to the nodes of another, across ranks.
#pragma once

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
  std::vector<std::int64_t> dofs;   ///< unknowns of the facet's vertices, [node][vertex][gdim]
  std::vector<int> owner;           ///< their owners, [node][vertex]
  std::vector<double> shape_values; ///< shape functions at the closest point, [node][vertex]
  std::vector<double> x;            ///< closest point, [node][3]
  std::vector<double> normal;       ///< outward unit normal of the facet there, [node][3]
  std::vector<double> mean_normal;  ///< mean of those of all facets whose closest point it is
};

/// Points of a surface with outward normals there.
struct Places
{
  std::span<const double> x;      ///< [point][3]
  std::span<const double> normal; ///< unit normals, [point][3]

  std::size_t size() const { return x.size() / 3; }
};

/// Search, for each owned node of `nodes`, the closest point on the facets of `surface`.
/// Collective.
///
/// Facets further away than `radius` and facets that do not face the node (their normal and the
/// node's enclose less than 90°: the back of a body) do not count. Nor do those that are hidden,
/// see `hidden`; a node that is beside its closest facet or behind a back finds the next one in
/// front of it, if there is one. Local searches use a tree of the facets' boxes, O(log n) a node;
/// nodes travel only to ranks whose facets' box is within the radius.
ClosestFacets closest_facets(const Surface& nodes, const Surface& surface, double radius);

/// The same for any points of this rank. @param own surface that they are on
ClosestFacets closest_facets(const Places& points, const Surface& own, const Surface& surface,
                             double radius);

} // namespace qsdolfinx
