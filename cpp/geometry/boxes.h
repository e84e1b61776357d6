// Axis-aligned boxes and a tree of them.
#pragma once

#include "geometry/facet.h"
#include <algorithm>
#include <cstdint>
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
  for (std::size_t i = 3; i < x.size(); i += 3)
  {
    for (std::size_t j = 0; j < 3; ++j)
    {
      box.low[j] = std::min(box.low[j], x[i + j]);
      box.high[j] = std::max(box.high[j], x[i + j]);
    }
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

/// Square of a point's distance from a box.
inline double squared_distance(const Box& box, const Vec3& p)
{
  double sum = 0;
  for (std::size_t j = 0; j < 3; ++j)
  {
    const double d = std::max({box.low[j] - p[j], p[j] - box.high[j], 0.0});
    sum += d * d;
  }
  return sum;
}

/// Balanced binary tree of numbered boxes in one array, halved at the median of the longest side.
/// Queries allocate nothing, and the tree is the same whatever order of boxes the median leaves.
class BoxTree
{
public:
  explicit BoxTree(const std::vector<Box>& boxes);

  /// Numbers of the boxes within the radius of a box, coordinate by coordinate, ascending.
  void near(const Box& box, double radius, std::vector<std::size_t>& out) const;

  /// Call visit(i) for the boxes within the limit of p, those in near branches first. It returns
  /// the limit from then on.
  template <typename Visit>
  void nearest(const Vec3& p, double limit, Visit visit) const
  {
    if (nodes_.empty())
      return;
    struct Branch
    {
      std::uint32_t node;
      double square;
    };
    std::array<Branch, max_depth> stack;
    std::size_t depth = 0;
    double square = limit * limit;
    stack[depth++] = {0, squared_distance(nodes_[0].box, p)};
    while (depth > 0)
    {
      Branch here = stack[--depth];
      while (here.square <= square && nodes_[here.node].count == 0)
      {
        Branch left{here.node + 1, 0}, right{nodes_[here.node].first, 0};
        left.square = squared_distance(nodes_[left.node].box, p);
        right.square = squared_distance(nodes_[right.node].box, p);
        if (right.square < left.square)
          std::swap(left, right);
        if (right.square <= square)
          stack[depth++] = right;
        here = left;
      }
      if (here.square > square)
        continue;
      const Node& leaf = nodes_[here.node];
      for (std::uint32_t i = leaf.first; i < leaf.first + leaf.count; ++i)
      {
        if (leaf.count > 1 && squared_distance(entries_[i].box, p) > square)
          continue;
        limit = visit(entries_[i].number);
        square = limit * limit;
      }
    }
  }

private:
  struct Entry
  {
    Box box;
    std::size_t number;
  };
  /// The left branch of a node is the next one.
  struct Node
  {
    Box box;
    std::uint32_t first; ///< first entry of a leaf; right branch of others
    std::uint32_t count; ///< entries of a leaf; 0 of others
  };
  static constexpr std::size_t leaf_size = 4;
  static constexpr std::size_t max_depth = 64;

  void build(std::size_t first, std::size_t last);

  std::vector<Entry> entries_;
  std::vector<Node> nodes_;
};

} // namespace qsdolfinx
