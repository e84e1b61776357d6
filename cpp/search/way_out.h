// Points in another body that have come in by other faces than those they are paired through.
#pragma once

#include "search/screen.h"

namespace qsdolfinx
{

/// Points that are less deep than this part of a facet's size are where they seem to be.
inline constexpr double shallow_tolerance = 1e-3;

/// Two bodies that overlap along a line: x of the one is behind y, a point of the other.
struct Overlap
{
  Vec3 x, y;
  Vec3 axis;       ///< unit normal of the face that the pair was found from
  bool at_an_edge; ///< whether y is on an edge of its facet, and x not straight behind it
  Vec3 normal;     ///< at x
};

/// Which overlaps are not what keeps the bodies apart. Nothing is collective.
///
/// Where two corners overlap, the faces beside them face each other through both bodies, but what
/// they are deep is the width of the overlap. An overlap is such a one if a pair of other faces,
/// across its line and opposite to each other, have these points behind them, and the ways out
/// through the one and the other, from x and from y, are shorter together than the overlap is deep.
/// If y is on an edge, also if x is in front of another facet that is as near and does not face it:
/// it is not inside.
class WaysOut
{
public:
  /// @param other facets of y's surface, @param own those of x's, near the points
  WaysOut(const std::vector<FacetView>& other, const std::vector<FacetView>& own);

  bool are_shorter(const Overlap& overlap);

private:
  struct WayOut
  {
    double length;
    Vec3 normal;
  };
  /// Facets with a cone that their normals are in.
  struct Faces
  {
    explicit Faces(const FacetView& facets);
    bool may_be_across(const Vec3& axis) const;
    FacetView facets;
    Vec3 mean{0, 0, 0};
    double angle = 0; ///< largest one between the mean and a normal
  };
  /// Ways out of some faces from p, of which q is behind or before. None is as long as to q.
  void find(const std::vector<Faces>& all, const Vec3& p, const Vec3& q, const Vec3& axis,
            std::vector<WayOut>& out) const;
  bool is_outside(const Overlap& overlap, double depth) const;

  std::vector<Faces> other_, own_;
  std::vector<WayOut> from_x_, from_y_; // reused storage
};

/// The same for overlaps of points of this rank, [overlap]. Collective.
/// @param other y's surface, @param own x's
std::vector<std::uint8_t> have_shorter_ways_out(const Surface& own, const Surface& other,
                                                std::span<const Overlap> overlaps);

} // namespace qsdolfinx
