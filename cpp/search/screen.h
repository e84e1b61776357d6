// Visibility: facets that lie between a point and its partner.
#pragma once

#include "geometry/boxes.h"
#include "surface/surface.h"

#include <optional>

namespace qsdolfinx
{

/// A facet that is nearer to an end of a line of sight than this fraction of the smallest facet's
/// size touches this end, and does not count as lying between the ends.
inline constexpr double touch_tolerance = 1e-6;

/// Copies of those facets of a surface that may hide points from each other on this rank.
struct FacetCopies
{
  FacetType type;
  std::vector<double> x;           ///< [facet][vertex][3]
  std::vector<double> orientation; ///< ±1, times the area vector points outward

  std::size_t size() const { return orientation.size(); }
  std::span<const double> facet_x(std::size_t f) const
  {
    const std::size_t width = 3 * static_cast<std::size_t>(type);
    return std::span(x).subspan(f * width, width);
  }
  /// Outward at the centre, of any length.
  Vec3 outward(std::size_t f) const
  {
    return orientation[f] * area_vector(type, facet_x(f), facet_centre(type));
  }
};

/// View of facets that a line may meet or that may be near a point: those of this rank, or copies
/// of those of other ranks.
struct FacetView
{
  FacetType type;
  std::span<const double> x, orientation;
  const BoxTree& tree;

  std::size_t size() const { return orientation.size(); }
  std::span<const double> facet_x(std::size_t f) const
  {
    const std::size_t width = 3 * static_cast<std::size_t>(type);
    return x.subspan(f * width, width);
  }
  /// Outward at the centre, of any length.
  Vec3 outward(std::size_t f) const
  {
    return orientation[f] * area_vector(type, facet_x(f), facet_centre(type));
  }
};

/// Parameter t at which the line x + t d meets a facet, if it does. A quadrilateral is treated as
/// two triangles.
std::optional<double> meet_facet(const Vec3& x, const Vec3& d, FacetType type,
                                 std::span<const double> v);

/// All facets of a surface that may meet a box: facets of this rank, and copies of facets of other
/// ranks.
class NearFacets
{
public:
  /// Collective.
  NearFacets(const Surface& surface, const Box& box);
  std::vector<FacetView> views() const;

private:
  const Surface& surface_;
  FacetCopies others_;
  BoxTree tree_;
};

/// Find pairs of a rank and a facet of this rank that meets the rank's box. @param boxes of all
/// ranks
void facets_in_boxes(const Surface& surface, std::span<const Box> boxes, std::vector<int>& rank,
                     std::vector<std::size_t>& facet);

/// A point and its partner on the other surface.
struct Sight
{
  Vec3 x, y;
  Vec3 normal;          ///< outward at x
  bool is_deep = false; ///< whether x is far behind y
};

/// Kinds of facets that may hide x from y.
enum class Screens
{
  backs, ///< facets of y's surface that are seen from behind; all its facets if the point is deep
  own    ///< facets of x's surface, except those with x as a vertex
};

/// Whether facets of a surface hide the ends of the lines from each other, [line]. Collective.
///
/// They do if a facet lies between x and y. With `own` they also do if the first facet beyond y is
/// nearer to y than x is and has its normal on the same side as x: y then belongs to this facet,
/// since y is in front of it or just behind it.
std::vector<std::uint8_t> hidden(const Surface& surface, std::span<const Sight> lines,
                                 Screens screens);

} // namespace qsdolfinx
