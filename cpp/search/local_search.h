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
  LocalSearch(const Surface& surface, double radius);

  /// Facets that are closest to p and face it, ties included; valid until the next call.
  std::span<const Candidate> candidates(const Vec3& p, const Vec3& normal);

  /// The one of them whose name is first; null if there is none.
  const Candidate* closest(const Vec3& p, const Vec3& normal);

  /// Whether the node at p is beside the surface, see overhang_tolerance.
  bool beside(const Candidate& c, const Vec3& p) const;

private:
  double tie(std::size_t f) const { return tie_tolerance * surface_.facets().size[f]; }
  bool faces(const Candidate& c, const Vec3& normal) const;
  double bound(const Vec3& p, const Vec3& normal) const;

  const Surface& surface_;
  double radius_;
  BoxTree tree_;
  std::size_t last_ = std::numeric_limits<std::size_t>::max(); ///< found for the last node
  std::vector<Candidate> found_;
};

} // namespace qsdolfinx
