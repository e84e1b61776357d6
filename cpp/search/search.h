// Closest facets of one surface to the nodes of another, across ranks.
#pragma once

#include "surface/surface.h"
#include <cstdint>
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
  std::vector<double> middle;       ///< mean of the facet's vertices, [node][3]
  std::vector<std::uint8_t> side;   ///< sides of its vertices that were asked for, [node][vertex]
};

/// Search, for each owned node of `nodes`, the closest point on the facets of `surface`.
/// Collective.
///
/// Facets further away than `radius` and facets that do not face the node (their normal and the
/// node's enclose less than 90°: the back of a body) do not count. Nor do those that are hidden,
/// see `hidden`; a node that is beside its closest facet or behind a back finds the next one in
/// front of it, if there is one. Local searches use a tree of the facets' boxes, O(log n) a node;
/// nodes travel only to ranks whose facets' box is within the radius.
/// @param sides of the vertices of the surface's facets on this rank, [facet][vertex], to be told
/// of those that are found; null, on all ranks, if nobody wants to know
ClosestFacets closest_facets(const Surface& nodes, const Surface& surface, double radius,
                             const std::vector<std::uint8_t>* sides = nullptr);

/// The same for places with normals of their own on the first surface. Facets count if their normal
/// and the place's enclose more than 120°. Collective.
ClosestFacets closest_opposite(const Surface& of_places, const Nodes& places,
                               const Surface& surface, double radius,
                               const std::vector<std::uint8_t>* sides);

} // namespace qsdolfinx
