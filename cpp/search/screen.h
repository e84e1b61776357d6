// Facets that stand between a point and its partner.
#pragma once

#include "geometry/boxes.h"
#include "surface/surface.h"

#include <optional>

namespace qsdolfinx
{

/// A facet that is nearer to an end of a line of sight than this part of the smallest facet's size
/// touches that end, and is not between the ends.
inline constexpr double touch_tolerance = 1e-6;

/// Copies of the facets of a surface that this rank may have to look through.
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

/// Facets that a line may meet or a point be near: those of a rank or copies of others'.
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

/// Where the line x + t d meets a facet, if it does, as t; a quadrilateral is two triangles.
std::optional<double> meet_facet(const Vec3& x, const Vec3& d, FacetType type,
                                 std::span<const double> v);

/// All facets of a surface that may meet a box: this rank's, and copies of those of others.
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

/// Ranks, and facets of this rank that meet the ranks' boxes. @param boxes of all ranks
void facets_in_boxes(const Surface& surface, std::span<const Box> boxes, std::vector<int>& rank,
                     std::vector<std::size_t>& facet);

/// A point and its partner on the other surface.
struct Sight
{
  Vec3 x, y;
  Vec3 normal;          ///< outward at x
  bool is_deep = false; ///< whether x is far behind y
};

/// Which facets hide x from y.
enum class Screens
{
  backs, ///< those of y's surface that are seen from behind; of those that are deep, all
  own    ///< those of x's surface, but those with x as a vertex
};

/// Whether facets of a surface hide the ends of the lines from each other, [line]. Collective.
///
/// They do if one lies between x and y. With `own` also, if the first one beyond y is nearer to y
/// than x is and looks as x does: then y is that facet's, as y is in front of it or just behind.
std::vector<std::uint8_t> hidden(const Surface& surface, std::span<const Sight> lines,
                                 Screens screens);

} // namespace qsdolfinx
