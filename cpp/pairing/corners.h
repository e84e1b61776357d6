// Nodes in the corner of several walls, which each of their smooth sides faces one of.
#pragma once

#include "search/search.h"
#include <cstdint>
#include <vector>

namespace qsdolfinx
{

/// What the nodes of a surface with creases face besides their closest facet.
struct Corners
{
  std::vector<std::uint8_t> at;   ///< whether the owned node is in a corner, [node]
  std::vector<std::uint8_t> side; ///< smooth side that looks at the closest facet most, [node]
  Sides sides;                    ///< of all owned nodes at creases
  ClosestFacets walls; ///< what each of these sides faces, if its node is in a corner, [entry]
};

/// Find nodes in corners. Collective.
///
/// Each smooth side of a node looks for a facet of its own: the closest whose normal and the side's
/// enclose more than 120°. A node is in a corner if two of its sides find walls, such that
/// - the walls' normals differ by more than a smooth surface's may, see smooth_cosine,
/// - no other side of the node looks at either more than the one that found it does,
/// - one of the two pairs, sides or walls, is convex and the other concave: a convex corner lies in
///   a concave one. Two convex corners that meet have one pair.
/// @param closest closest facets of the nodes; what has none is not in a corner
/// @param sides see closest_facets
Corners find_corners(const Surface& nodes, const Surface& surface, const SearchRadius& radius,
                     const ClosestFacets& closest, const std::vector<std::uint8_t>* sides);

} // namespace qsdolfinx
