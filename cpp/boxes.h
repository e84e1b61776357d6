// Axis-aligned boxes and a tree of them (Boost's R-tree).
#pragma once

#include "facet.h"
#include <algorithm>
#include <boost/geometry.hpp>
#include <boost/geometry/geometries/box.hpp>
#include <boost/geometry/geometries/point.hpp>
#include <boost/geometry/index/rtree.hpp>
#include <utility>
#include <vector>

namespace qsdolfinx
{

/// Lowest and highest corner.
struct Box
{
  Vec3 low, high;
};

/// Smallest box around points. A bilinear facet lies within the convex hull, hence the box, of its
/// vertices. @param x 3 coordinates a point, at least one point
inline Box box_of(std::span<const double> x)
{
  Box box{{x[0], x[1], x[2]}, {x[0], x[1], x[2]}};
  for (std::size_t i = 3; i < x.size(); ++i)
  {
    box.low[i % 3] = std::min(box.low[i % 3], x[i]);
    box.high[i % 3] = std::max(box.high[i % 3], x[i]);
  }
  return box;
}

/// Whether a rank's box, as all_bounding_boxes gives it, is within the radius of another.
inline bool boxes_are_near(std::span<const double> rank_box, const Box& box, double radius)
{
  for (std::size_t j = 0; j < 3; ++j)
    if (!(box.high[j] >= rank_box[j] - radius && box.low[j] <= rank_box[3 + j] + radius))
      return false;
  return true;
}

/// R-tree of numbered boxes, bulk loaded.
class BoxTree
{
public:
  using Point = boost::geometry::model::point<double, 3, boost::geometry::cs::cartesian>;
  using Entry = std::pair<boost::geometry::model::box<Point>, std::size_t>;
  using Tree = boost::geometry::index::rtree<Entry, boost::geometry::index::quadratic<16>>;

  explicit BoxTree(const std::vector<Box>& boxes)
  {
    std::vector<Entry> entries;
    entries.reserve(boxes.size());
    for (const Box& b : boxes)
      entries.emplace_back(as_boost(b, 0), entries.size());
    tree_ = Tree(entries.begin(), entries.end());
  }

  /// Numbers of the boxes within the radius of a box, coordinate by coordinate, ascending.
  void near(const Box& box, double radius, std::vector<std::size_t>& out) const
  {
    namespace index = boost::geometry::index;
    out.clear();
    for (auto it = tree_.qbegin(index::intersects(as_boost(box, radius))); it != tree_.qend(); ++it)
      out.push_back(it->second);
    std::sort(out.begin(), out.end());
  }

  const Tree& tree() const { return tree_; }

private:
  static boost::geometry::model::box<Point> as_boost(const Box& b, double r)
  {
    return {{b.low[0] - r, b.low[1] - r, b.low[2] - r},
            {b.high[0] + r, b.high[1] + r, b.high[2] + r}};
  }

  Tree tree_;
};

} // namespace qsdolfinx
