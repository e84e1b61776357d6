#include "search/winding.h"
#include "parallel/exchange.h"
#include "search/screen.h"

#include <cmath>

using namespace qsdolfinx;

namespace
{
/// Directions of the rays to infinity; they point away from the axis of rings.
constexpr std::array<Vec3, 3> ways{
    {{0.7236, 0.5537, 0.4117}, {0.6217, -0.6841, 0.3814}, {0.4513, 0.3329, -0.8279}}};

/// Distance along the ray, relative to its length, below which the point counts as being on a
/// facet. If the point is on an edge, it is also on the facets beside its own.
constexpr double at_point = 1e-10;

/// Margin of boxes, relative to the length of the ray: in 2D the boxes have no height.
constexpr double box_margin = 1e-9;

/// A box around all facets.
Box box_of_all(const std::vector<Box>& boxes)
{
  Box out;
  for (const Box& box : boxes)
    out.include(box.low, box.high);
  return out;
}

/// Vector along a ray that ends outside of all facets.
Vec3 way_out(const Vec3& way, int gdim, double length)
{
  const Vec3 flat = gdim == 2 ? Vec3{way[0], way[1], 0} : way;
  return (length / norm(flat)) * flat;
}

double cross_along(const Vec3& d, const Vec3& a, const Vec3& b) { return dot(d, cross(a, b)); }

/// Number of times that the ray x + t d, t > 0, leaves the body through a quadrilateral, which may
/// be warped, minus the number of times that it enters. There are up to two places (u, v) where
/// a + u b + v c + u v e is along d.
int count_warped(const Vec3& x, const Vec3& d, std::span<const double> v, double orientation)
{
  const Vec3 p = facet_vertex(v, 0), a = p - x, b = facet_vertex(v, 1) - p,
             c = facet_vertex(v, 2) - p, e = facet_vertex(v, 3) - p - b - c;
  const double k0 = cross_along(d, a, b), k1 = cross_along(d, a, e) + cross_along(d, c, b),
               k2 = cross_along(d, c, e), root = k1 * k1 - 4 * k0 * k2;
  if (root < 0)
    return 0;
  const double q = -0.5 * (k1 + std::copysign(std::sqrt(root), k1));
  const std::array<double, 2> found{q / k2, k0 / q}; // infinite if there is only one
  int out = 0;
  for (std::size_t i = 0; i < (root > 0 ? 2 : 1); ++i)
  {
    const double t = found[i];
    if (!(t >= 0 && t < 1))
      continue;
    // The components of a + t c and b + t e perpendicular to d are parallel.
    const Vec3 r = cross(d, a + t * c), s = cross(d, b + t * e);
    const double u = -dot(r, s) / dot(s, s);
    const Vec3 way = a + u * b + t * c + u * t * e;
    if (u >= 0 && u < 1 && dot(way, d) > at_point * dot(d, d))
      out += orientation * dot(area_vector(FacetType::quadrilateral, v, {u, t}), d) > 0 ? 1 : -1;
  }
  return out;
}

/// Number of facets of this rank through which the ray leaves the body, minus the number through
/// which it enters. @param own facet of this rank on which x is
int count(const Surface& surface, const Vec3& x, const Vec3& d, std::optional<std::size_t> own)
{
  int out = 0;
  surface.tree().along(LinePart(x, d, 1.0, box_margin * norm(d)),
                       [&](std::size_t f)
                       {
                         if (f == own)
                           return;
                         const auto v = surface.facet_x(f);
                         const double orientation = surface.facets().orientation[f];
                         if (surface.type() == FacetType::quadrilateral)
                         {
                           out += count_warped(x, d, v, orientation);
                           return;
                         }
                         const auto t = meet_facet(x, d, surface.type(), v);
                         if (t && *t > at_point)
                           out += orientation * dot(area_vector(surface.type(), v, {0, 0}), d) > 0
                                      ? 1
                                      : -1;
                       });
  return out;
}
} // namespace

std::vector<std::uint8_t> qsdolfinx::within_body(const Surface& surface, std::span<const Vec3> x,
                                                 std::span<const Vec3> normal,
                                                 std::span<const std::size_t> facet)
{
  const std::vector<Box> boxes = surface.rank_boxes(0);
  const Box all = box_of_all(boxes);
  const double length = 2 * norm(all.high - all.low);
  std::vector<int> votes(x.size(), 0);
  for (const Vec3& way : ways)
  {
    const Vec3 d = way_out(way, surface.gdim(), length);
    std::vector<int> dest;
    std::vector<std::size_t> point;
    std::vector<double> places;
    std::vector<std::int64_t> facets; // rank, and number there
    for (std::size_t p = 0; p < x.size(); ++p)
    {
      const LinePart line(x[p], d, 1.0, box_margin * length);
      for (std::size_t r = 0; r < boxes.size(); ++r)
        if (line.meets(boxes[r]))
        {
          dest.push_back(static_cast<int>(r));
          point.push_back(p);
          places.insert(places.end(), x[p].begin(), x[p].end());
          facets.push_back(surface.rank());
          facets.push_back(static_cast<std::int64_t>(facet[p]));
        }
    }
    const Exchange exchange(surface.comm(), dest);
    const auto asked = exchange.forward<double>(places, 3);
    const auto on = exchange.forward<std::int64_t>(facets, 2);
    std::vector<int> found;
    for (std::size_t i = 0; i < exchange.num_received(); ++i)
    {
      std::optional<std::size_t> own;
      if (on[2 * i] == surface.rank())
        own = static_cast<std::size_t>(on[2 * i + 1]);
      found.push_back(count(surface, facet_vertex(asked, static_cast<int>(i)), d, own));
    }
    const auto told = exchange.reverse<int>(found, 1);
    std::vector<int> left(x.size(), 0);
    for (std::size_t i = 0; i < told.size(); ++i)
      left[point[i]] += told[i];
    for (std::size_t p = 0; p < x.size(); ++p)
      votes[p] += left[p] - (dot(normal[p], d) < 0 ? 1 : 0) > 0 ? 1 : 0;
  }
  std::vector<std::uint8_t> out;
  for (int vote : votes)
    out.push_back(vote >= 2);
  return out;
}
