#include "search/winding.h"
#include "parallel/exchange.h"
#include "search/screen.h"

#include <cmath>

using namespace qsdolfinx;

namespace
{
/// Ways to infinity; away from the axis of rings.
constexpr std::array<Vec3, 3> ways{
    {{0.7236, 0.5537, 0.4117}, {0.6217, -0.6841, 0.3814}, {0.4513, 0.3329, -0.8279}}};

/// Distance along the way, over its length, at which a facet is the one that the point is on.
constexpr double own_facet = 1e-12;

/// Margin of boxes over the length of the way: in 2D they have no height.
constexpr double box_margin = 1e-9;

/// A box around all facets.
Box box_of_all(const std::vector<Box>& boxes)
{
  Box out;
  for (const Box& box : boxes)
    out.include(box.low, box.high);
  return out;
}

/// A way to where there is nothing any more.
Vec3 way_out(const Vec3& way, int gdim, double length)
{
  const Vec3 flat = gdim == 2 ? Vec3{way[0], way[1], 0} : way;
  return (length / norm(flat)) * flat;
}

/// Facets of this rank that are left less those that are entered.
int count(const Surface& surface, const Vec3& x, const Vec3& d)
{
  int out = 0;
  surface.tree().along(LinePart(x, d, 1.0, box_margin * norm(d)),
                       [&](std::size_t f)
                       {
                         const auto v = surface.facet_x(f);
                         const auto t = meet_facet(x, d, surface.type(), v);
                         if (!t || *t <= own_facet || *t > 1)
                           return;
                         const Vec3 a
                             = area_vector(surface.type(), v, facet_centre(surface.type()));
                         out += surface.facets().orientation[f] * dot(a, d) > 0 ? 1 : -1;
                       });
  return out;
}
} // namespace

std::vector<std::uint8_t> qsdolfinx::within_body(const Surface& surface, std::span<const Vec3> x,
                                                 std::span<const Vec3> normal)
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
    for (std::size_t p = 0; p < x.size(); ++p)
    {
      const LinePart line(x[p], d, 1.0, box_margin * length);
      for (std::size_t r = 0; r < boxes.size(); ++r)
        if (line.meets(boxes[r]))
        {
          dest.push_back(static_cast<int>(r));
          point.push_back(p);
          places.insert(places.end(), x[p].begin(), x[p].end());
        }
    }
    const Exchange exchange(surface.comm(), dest);
    const auto asked = exchange.forward<double>(places, 3);
    std::vector<int> found;
    for (std::size_t i = 0; i < asked.size(); i += 3)
      found.push_back(count(surface, {asked[i], asked[i + 1], asked[i + 2]}, d));
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
