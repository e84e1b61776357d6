#include "pairing/corners.h"

#include <algorithm>

using namespace qsdolfinx;

namespace
{
/// How two planes through parts of a surface meet: convex (-1), concave (1), or neither (0).
/// @param between from a point on the first part to one on the second
int bend(const Vec3& first_normal, const Vec3& second_normal, const Vec3& between)
{
  const double second_over_first = dot(between, first_normal),
               first_over_second = -dot(between, second_normal);
  if (second_over_first > 0 && first_over_second > 0)
    return 1;
  return second_over_first < 0 && first_over_second < 0 ? -1 : 0;
}

/// Smooth sides of one node and the walls that they face.
class NodeSides
{
public:
  NodeSides(const Corners& corners, std::size_t first, std::size_t last)
      : sides_(corners.sides), walls_(corners.walls), first_(first), last_(last)
  {
  }

  /// The side that faces a facet with this normal most.
  std::size_t looking_at(const Vec3& normal) const
  {
    std::size_t best = first_;
    for (std::size_t i = first_ + 1; i < last_; ++i)
      if (dot(of(sides_.at.normal, i), normal) < dot(of(sides_.at.normal, best), normal))
        best = i;
    return best;
  }

  /// Whether two of the sides face two walls of a corner.
  bool in_corner(std::size_t i, std::size_t j) const
  {
    if (!own_wall(i) || !own_wall(j)
        || dot(of(walls_.normal, i), of(walls_.normal, j)) > smooth_cosine)
      return false;
    const int own = bend(of(sides_.at.normal, i), of(sides_.at.normal, j),
                         of(sides_.inward, j) - of(sides_.inward, i)),
              other = bend(of(walls_.normal, i), of(walls_.normal, j),
                           of(walls_.middle, j) - of(walls_.middle, i));
    return own * other < 0;
  }

private:
  static Vec3 of(const std::vector<double>& values, std::size_t i)
  {
    return facet_vertex(values, static_cast<int>(i));
  }
  bool own_wall(std::size_t i) const
  {
    return walls_.found[i] && looking_at(of(walls_.normal, i)) == i;
  }

  const Sides& sides_;
  const ClosestFacets& walls_;
  std::size_t first_, last_;
};
} // namespace

Corners qsdolfinx::find_corners(const Surface& nodes, const Surface& surface,
                                const SearchRadius& radius, const ClosestFacets& closest,
                                const std::vector<std::uint8_t>* sides)
{
  const std::size_t n = nodes.nodes().size();
  Corners out{std::vector<std::uint8_t>(n, 0), std::vector<std::uint8_t>(n, 0), nodes.sides(), {}};
  out.walls = closest_opposite(nodes, out.sides.at, surface, radius, sides);
  const std::vector<std::size_t>& node = out.sides.node;
  for (std::size_t first = 0, last; first < node.size(); first = last)
  {
    const std::size_t k = node[first];
    last = static_cast<std::size_t>(std::ranges::upper_bound(node, k) - node.begin());
    const NodeSides of_node(out, first, last);
    std::vector<std::uint8_t> faces_wall(last - first, 0);
    for (std::size_t i = first; closest.found[k] && i < last; ++i)
      for (std::size_t j = i + 1; j < last; ++j)
        if (of_node.in_corner(i, j))
          out.at[k] = faces_wall[i - first] = faces_wall[j - first] = 1;
    for (std::size_t i = first; i < last; ++i)
      out.walls.found[i] = faces_wall[i - first];
    if (closest.found[k])
      out.side[k]
          = out.sides.side[of_node.looking_at(facet_vertex(closest.normal, static_cast<int>(k)))];
  }
  return out;
}
