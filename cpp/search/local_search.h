// Search for the closest facets among those of this rank.
#pragma once

#include "geometry/boxes.h"
#include "geometry/projection.h"
#include "surface/surface.h"
#include <limits>

namespace qsdolfinx
{

/// Two distances that differ by less than this fraction of the facet size count as equal. The facet
/// whose sorted vertex coordinates come first is then taken, independently of the partition.
inline constexpr double tie_tolerance = 1e-10;

/// A node is beside the surface, and unpaired, if two conditions hold. Its offset from the closest
/// point, measured in the facet's plane, is more than this fraction of the facet size. The closest
/// point is on the boundary of the surface, or the offset is more than twice the distance from the
/// plane, as past a corner of the surface. The contact force would have a lever arm of the length
/// of the offset, and the moments on the two sides would differ.
inline constexpr double overhang_tolerance = 0.1;

/// A facet faces a node if the cosine of the angle between its normal and the node's normal is
/// below this value. It is not 0: the faces beside a corner are perpendicular to the surface that
/// the corner touches, and their angle varies around 90° as the body is strained.
inline constexpr double facing_cosine = -0.1;

/// A facet is in front of a node if its normal and the node's normal enclose more than 120° (the
/// cosine is below this value), the node's offset is within overhang_tolerance, and the line
/// through the node along its normal meets the facet's box, widened by the facet's size.
inline constexpr double front_cosine = -0.5;

/// A facet that may be closest to a node, with its closest point.
struct Candidate
{
  std::size_t facet;
  ClosestPoint point;
};

/// A facet's vertices in lexicographic order, which identify the facet independently of the
/// partition.
std::array<double, 12> name_of(std::span<const double> x);

/// Searches the facets of one rank, as described for closest_facets. Results do not depend on the
/// order of the queries, but the search is faster if consecutive queries are for neighbouring
/// nodes.
class LocalSearch
{
public:
  /// @param opposite whether facets face a node only if they do so within 60°
  LocalSearch(const Surface& surface, double radius, bool opposite);

  /// Facets that are closest to p and face it, ties included; valid until the next call.
  std::span<const Candidate> candidates(const Vec3& p, const Vec3& normal);

  /// Whether a facet that does not face the node was nearer than those that `candidates` found.
  bool saw_back() const { return back_ < limit_; }

  /// The closest facets among those that are in front of p and further from it than `beyond`, ties
  /// included; valid until the next call.
  std::span<const Candidate> in_front(const Vec3& p, const Vec3& normal, double beyond);

  /// The candidate whose name (see name_of) is first among those that the node at p is not beside,
  /// or among all if it is beside all of them; null if there are no candidates.
  const Candidate* best(std::span<const Candidate> ties, const Vec3& p) const;

  /// Whether the node at p is beside the surface, see overhang_tolerance.
  bool beside(const Candidate& c, const Vec3& p) const;

  /// Tolerance for equal distances: a distance that differs by less from that of facet f is equal
  /// to it.
  double tie(std::size_t f) const { return tie_tolerance * surface_.facets().size[f]; }

private:
  void drop_beyond_limit();
  double offset(const Candidate& c, const Vec3& p) const;
  bool faces(const Candidate& c, const Vec3& normal) const;
  double bound(const Vec3& p, const Vec3& normal) const;

  const Surface& surface_;
  double radius_;
  bool opposite_;
  const BoxTree& tree_;
  double largest_ = 0;                                         ///< size of a facet
  std::size_t last_ = std::numeric_limits<std::size_t>::max(); ///< facet found for the previous
                                                               ///< node
  std::vector<Candidate> found_;
  double limit_ = 0, back_ = 0; ///< distances of the facets found, and of facets that do not face
                                ///< the node
};

} // namespace qsdolfinx
