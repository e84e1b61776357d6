// Nodes in a corner of several walls, where each smooth side of the node faces one of the walls.
#pragma once

#include "search/search.h"
#include <cstdint>
#include <vector>

namespace qsdolfinx
{

/// Walls that the nodes of a surface with sharp edges face in addition to their closest facet.
struct Corners
{
  std::vector<std::uint8_t> at;   ///< whether the owned node is in a corner, [node]
  std::vector<std::uint8_t> side; ///< smooth side that faces the closest facet most, [node]
  Sides sides;                    ///< sides of all owned nodes on sharp edges
  ClosestFacets walls; ///< facet that each of these sides faces, if its node is in a corner,
                       ///< [entry]
};

/// Find nodes in corners. Collective.
///
/// For each smooth side of a node, the closest facet is searched whose normal and the side's normal
/// enclose an angle of more than 120°. A node is in a corner if two of its sides find walls, such
/// that
/// - the walls' normals differ by more than a smooth surface's may, see smooth_cosine,
/// - no other side of the node faces either wall more than the side that found it,
/// - the two sides are convex and the two walls concave, or vice versa: a convex corner lies in a
///   concave one. A node has one contact pair where two convex corners meet.
/// @param closest closest facets of the nodes; a node without one is not in a corner
/// @param sides see closest_facets
Corners find_corners(const Surface& nodes, const Surface& surface, const SearchRadius& radius,
                     const ClosestFacets& closest, const std::vector<std::uint8_t>* sides);

} // namespace qsdolfinx
