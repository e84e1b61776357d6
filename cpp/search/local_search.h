// Closest facets among those of this rank.
#pragma once

#include "geometry/boxes.h"
#include "geometry/projection.h"
#include "surface/surface.h"
#include <limits>

namespace qsdolfinx
{

/// Two distances that differ by less than this part of the facet size are equal; the facet whose
/// sorted vertex coordinates come first is then taken, whatever the partition.
inline constexpr double tie_tolerance = 1e-10;

/// A node is beside the surface, and unpaired, if its offset from the closest point in the facet's
/// plane is more than this part of the facet size, and this point is on the boundary of the surface
/// or the offset is more than twice the distance from the plane, as past a corner of the surface.
/// Its force would have a lever of this length, and the moments on the two sides would differ.
inline constexpr double overhang_tolerance = 0.1;

/// A facet faces a node if the cosine of the angle that its normal and the node's enclose is below
/// this. It is not 0: the faces beside a corner, which stand on what the corner touches, lean to
/// either side of 90° as the body is strained.
inline constexpr double facing_cosine = -0.1;

/// A facet is in front of a node if its normal and the node's enclose more than 120°, the cosine
/// being below this, the node's offset is within overhang_tolerance, and the line through the node
/// along its normal meets the facet's box, widened by the facet's size.
inline constexpr double front_cosine = -0.5;

/// A facet's answer to one node.
struct Candidate
{
  std::size_t facet;
  ClosestPoint point;
};

/// A facet's vertices in lexicographic order: a name for the facet that no partition changes.
std::array<double, 12> name_of(std::span<const double> x);

/// Searches the facets of one rank, as closest_facets says. Answers do not depend on the order of
/// the questions, but neighbours asked for one after the other are found faster.
class LocalSearch
{
public:
  /// @param opposite whether facets face a node only if they do so within 60°
  LocalSearch(const Surface& surface, double radius, bool opposite);

  /// Facets that are closest to p and face it, ties included; valid until the next call.
  std::span<const Candidate> candidates(const Vec3& p, const Vec3& normal);

  /// Whether a facet that does not face the node was nearer than those that `candidates` found.
  bool saw_back() const { return back_ < limit_; }

  /// Of the facets that are further from p than `beyond`, those that are closest and in front of
  /// it, ties included; valid until the next call.
  std::span<const Candidate> in_front(const Vec3& p, const Vec3& normal, double beyond);

  /// The one of some candidates whose name is first; null if there is none.
  const Candidate* first_by_name(std::span<const Candidate> ties) const;

  /// Whether the node at p is beside the surface, see overhang_tolerance.
  bool beside(const Candidate& c, const Vec3& p) const;

  /// Distances that differ by less are equal to that of facet f.
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
  std::size_t last_ = std::numeric_limits<std::size_t>::max(); ///< found for the last node
  std::vector<Candidate> found_;
  double limit_ = 0, back_ = 0; ///< distances: of what was found, of what does not face the node
};

} // namespace qsdolfinx
