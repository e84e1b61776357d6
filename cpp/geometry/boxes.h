// Axis-aligned boxes and a tree of them.
#pragma once

#include "geometry/facet.h"
#include <algorithm>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Axis-aligned box, given by its lowest and highest corner. Initially empty: it meets nothing.
struct Box
{
  static constexpr double inf = std::numeric_limits<double>::infinity();
  Vec3 low{inf, inf, inf}, high{-inf, -inf, -inf};

  /// Enlarge the box to include another box, or a point.
  void include(const Vec3& other_low, const Vec3& other_high)
  {
    for (std::size_t j = 0; j < 3; ++j)
    {
      low[j] = std::min(low[j], other_low[j]);
      high[j] = std::max(high[j], other_high[j]);
    }
  }
};

/// Smallest box around points. A bilinear facet lies within the convex hull, hence the box, of its
/// vertices. @param x 3 coordinates a point
inline Box box_of(std::span<const double> x)
{
  Box box;
  for (std::size_t i = 0; i < x.size(); i += 3)
  {
    const Vec3 p{x[i], x[i + 1], x[i + 2]};
    box.include(p, p);
  }
  return box;
}

/// Boxes of facets. @param x [facet][vertex][3]
std::vector<Box> facet_boxes(FacetType type, std::span<const double> x);

/// The box enlarged by the radius in each coordinate direction.
inline Box widened(const Box& box, double radius)
{
  const Vec3 all{radius, radius, radius};
  return {box.low - all, box.high + all};
}

/// Whether two boxes have a point in common.
inline bool meet(const Box& a, const Box& b)
{
  for (std::size_t j = 0; j < 3; ++j)
    if (!(a.low[j] <= b.high[j] && a.high[j] >= b.low[j]))
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

/// A part of a line, x + t d for t from 0 to `end`, that boxes are compared with.
class LinePart
{
public:
  /// @param margin distance by which boxes are widened
  LinePart(const Vec3& x, const Vec3& d, double end, double margin)
      : above_(x + Vec3{margin, margin, margin}), below_(x - Vec3{margin, margin, margin}),
        end_(end)
  {
    for (std::size_t j = 0; j < 3; ++j)
      inverse_[j] = d[j] == 0 ? huge : 1 / d[j]; // then within the box for all t, or for none
  }

  /// Whether a box, widened by the margin, has a point in common with this part of the line.
  bool meets(const Box& box) const
  {
    double first = 0, last = end_;
    for (std::size_t j = 0; j < 3; ++j)
    {
      const double below = box.low[j] - above_[j], above = box.high[j] - below_[j];
      const double s = below * inverse_[j], t = above * inverse_[j];
      first = std::max(first, std::min(s, t));
      last = std::min(last, std::max(s, t));
    }
    return first <= last;
  }

private:
  static constexpr double huge = 1e300;
  Vec3 above_, below_, inverse_{0, 0, 0};
  double end_;
};

/// Balanced binary tree of numbered boxes in one array, split at the median of the longest side.
/// Queries allocate no memory, and the tree does not depend on the order in which the median search
/// leaves the boxes.
class BoxTree
{
public:
  explicit BoxTree(const std::vector<Box>& boxes);

  /// Update the boxes and keep the branches, which is faster than a new tree. Returns whether the
  /// branches are still about as small as when the tree was made; if not, make a new tree.
  bool follow(const std::vector<Box>& boxes);

  /// Numbers of the boxes within the radius of a box in each coordinate direction, ascending.
  void near(const Box& box, double radius, std::vector<std::size_t>& out) const;

  /// Call visit(i) for the boxes that a part of a line meets.
  template <typename Visit>
  void along(const LinePart& line, Visit visit) const
  {
    std::array<std::uint32_t, max_depth> stack;
    std::size_t depth = 0;
    if (!nodes_.empty() && line.meets(nodes_[0].box))
      stack[depth++] = 0;
    while (depth > 0)
    {
      std::uint32_t n = stack[--depth];
      while (nodes_[n].count == 0) // down the left branch if the line meets it
      {
        const std::uint32_t left = n + 1, right = nodes_[n].first;
        const bool meets_right = line.meets(nodes_[right].box);
        if (line.meets(nodes_[left].box))
        {
          if (meets_right)
            stack[depth++] = right;
          n = left;
        }
        else if (meets_right)
          n = right;
        else
          break;
      }
      const Node& leaf = nodes_[n];
      if (leaf.count > 0)
        for (std::uint32_t i = leaf.first; i < leaf.first + leaf.count; ++i)
          if (line.meets(entries_[i].box))
            visit(entries_[i].number);
    }
  }

  /// Call visit(i) for the boxes within the distance `limit` of p, those in near branches first.
  /// visit(i) returns the new limit.
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
  /// The left branch of a node is the next node in the array.
  struct Node
  {
    Box box;
    std::uint32_t first; ///< first entry of a leaf; right branch of others
    std::uint32_t count; ///< entries of a leaf; 0 of others
  };
  static constexpr std::size_t leaf_size = 4;
  static constexpr std::size_t max_depth = 64;

  void build(std::size_t first, std::size_t last);
  /// Sum of the branches' lengths, widths and heights.
  double extent() const;

  std::vector<Entry> entries_;
  std::vector<Node> nodes_;
  double extent_ = 0; ///< when the tree was made
};

/// Tree of the boxes of facets that move, updated when it is used.
class MovingTree
{
public:
  /// Note that the facets have moved.
  void moved() { is_current_ = false; }
  /// The tree for facets at these positions. @param x [facet][vertex][3], the same ones until moved
  /// is called
  const BoxTree& of(FacetType type, std::span<const double> x) const;

private:
  mutable std::unique_ptr<BoxTree> tree_; ///< null until it is used
  mutable bool is_current_ = false;
};

} // namespace qsdolfinx
