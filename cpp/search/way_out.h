// Points within another body that have entered it through other faces than those they are paired
// with.
#pragma once

#include "search/screen.h"

namespace qsdolfinx
{

/// Points that are less deep than this fraction of a facet's size are not checked for shorter ways
/// out.
inline constexpr double shallow_tolerance = 1e-3;

/// Overlap of two bodies along a line: the point x of one body is behind the point y of the other.
struct Overlap
{
  Vec3 x, y;
  Vec3 axis;       ///< unit normal of the face from which the pair was found
  bool at_an_edge; ///< whether y is on an edge of its facet, and x not straight behind it
  Vec3 normal;     ///< at x
};

/// Determines for which overlaps there is a shorter way out of the bodies. Such an overlap is not a
/// contact between the bodies. Nothing is collective.
///
/// Where two corners overlap, the faces beside the corners face each other through both bodies, but
/// their penetration is only the width of the overlap. There is a shorter way out if two other
/// faces, across the line of the overlap and opposite to each other, have x and y behind them, and
/// the ways out through these two faces, from x and from y, are together shorter than the overlap
/// is deep. If y is on an edge, the overlap is also rejected if x is in front of another facet that
/// is as near and does not face x: x is then not inside.
class WaysOut
{
public:
  /// @param other facets of y's surface near the points
  /// @param own facets of x's surface near the points
  WaysOut(const std::vector<FacetView>& other, const std::vector<FacetView>& own);

  bool are_shorter(const Overlap& overlap);

private:
  struct WayOut
  {
    double length;
    Vec3 normal;
  };
  /// Facets, with a cone that contains their normals.
  struct Faces
  {
    explicit Faces(const FacetView& facets);
    bool may_be_across(const Vec3& axis) const;
    FacetView facets;
    Vec3 mean{0, 0, 0};
    double angle = 0; ///< largest angle between the mean and a normal
  };
  /// Find the ways out from p through some faces; all are shorter than the distance to q. If p is
  /// already outside and the line to q enters through the face, the length is 0.
  void find(const std::vector<Faces>& all, const Vec3& p, const Vec3& q, const Vec3& axis,
            std::vector<WayOut>& out) const;
  bool is_outside(const Overlap& overlap, double depth) const;

  std::vector<Faces> other_, own_;
  std::vector<WayOut> from_x_, from_y_; // reused storage
};

/// Whether there are shorter ways out for overlaps of points of this rank, [overlap]. Collective.
/// @param own surface of x
/// @param other surface of y
std::vector<std::uint8_t> have_shorter_ways_out(const Surface& own, const Surface& other,
                                                std::span<const Overlap> overlaps);

} // namespace qsdolfinx
