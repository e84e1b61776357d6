#include "search/way_out.h"
#include "geometry/projection.h"

#include <cmath>

using namespace qsdolfinx;

namespace
{
/// Faces are across a line if they are within 30° of it: cosine of their normals with it.
constexpr double across_cosine = 0.5;

/// Faces are opposite to each other if their normals are, within 30°.
constexpr double opposite_cosine = -smooth_cosine;

/// Lengths are shorter if they are so by more than this part.
constexpr double equal_tolerance = 1e-6;

/// Box of the points of some overlaps, with all that is as near to them as they are deep.
Box box_around(std::span<const Overlap> overlaps, const Vec3 Overlap::* point)
{
  Box box;
  for (const Overlap& overlap : overlaps)
  {
    const Vec3& p = overlap.*point;
    const Box near = widened({p, p}, norm(overlap.y - overlap.x));
    box.include(near.low, near.high);
  }
  return box;
}
} // namespace

void WaysOut::find(const std::vector<FacetView>& facets, const Vec3& p, const Vec3& axis,
                   double depth, std::vector<WayOut>& out) const
{
  out.clear();
  for (const FacetView& view : facets)
  {
    if (view.orientation.empty())
      continue;
    view.tree.nearest(p, depth,
                      [&](std::size_t f)
                      {
                        const Vec3 a = view.outward(f), n = (1 / norm(a)) * a;
                        if (std::abs(dot(n, axis)) > across_cosine)
                          return depth;
                        const ClosestPoint c = closest_point(view.type, view.facet_x(f), p);
                        const double rounding = equal_tolerance * depth;
                        if (c.distance < depth && dot(p - c.x, n) < rounding)
                          out.push_back({c.distance, n});
                        return depth;
                      });
  }
}

bool WaysOut::is_outside(const Overlap& overlap, double depth) const
{
  bool out = false;
  const double rounding = equal_tolerance * depth, limit = depth + rounding;
  for (const FacetView& view : other_)
    if (!view.orientation.empty())
      view.tree.nearest(overlap.x, limit,
                        [&](std::size_t f)
                        {
                          if (out)
                            return 0.0;
                          const Vec3 a = view.outward(f);
                          if (dot(a, overlap.axis) > smooth_cosine * norm(a))
                            return limit;
                          const ClosestPoint c
                              = closest_point(view.type, view.facet_x(f), overlap.x);
                          out = c.distance <= limit
                                && dot(overlap.x - c.x, a) > 2 * rounding * norm(a);
                          return out ? 0.0 : limit;
                        });
  return out;
}

bool WaysOut::are_shorter(const Overlap& overlap)
{
  const double depth = norm(overlap.y - overlap.x);
  if (overlap.at_an_edge && is_outside(overlap, depth))
    return true;
  find(other_, overlap.x, overlap.axis, depth, from_x_);
  if (from_x_.empty())
    return false;
  find(own_, overlap.y, overlap.axis, depth, from_y_);
  for (const WayOut& a : from_x_)
    for (const WayOut& b : from_y_)
      if (a.length + b.length < (1 - equal_tolerance) * depth
          && dot(a.normal, b.normal) < opposite_cosine)
        return true;
  return false;
}

std::vector<std::uint8_t> qsdolfinx::have_shorter_ways_out(const Surface& own,
                                                           const Surface& other,
                                                           std::span<const Overlap> overlaps)
{
  const NearFacets near_x(other, box_around(overlaps, &Overlap::x)),
      near_y(own, box_around(overlaps, &Overlap::y));
  WaysOut ways(near_x.views(), near_y.views());
  std::vector<std::uint8_t> out;
  out.reserve(overlaps.size());
  for (const Overlap& overlap : overlaps)
    out.push_back(ways.are_shorter(overlap));
  return out;
}
