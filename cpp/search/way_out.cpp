#include "search/way_out.h"
#include "geometry/projection.h"
#include "search/local_search.h"

#include <algorithm>
#include <cmath>
#include <numbers>

using namespace qsdolfinx;

namespace
{
/// Faces are across a line if they are within 30° of it: least angle between their normals and the
/// line, and its cosine.
constexpr double across_angle = std::numbers::pi / 3, across_cosine = 0.5;

/// Faces are opposite to each other if their normals are opposite within 30°.
constexpr double opposite_cosine = -smooth_cosine;

/// A point is above a face, not beside it, if its height is more than this fraction of its
/// distance.
constexpr double above = 0.9;

/// A length is shorter than another one if it is so by more than this fraction.
constexpr double equal_tolerance = 1e-6;

/// Box around one of the two points of each overlap, widened by the depth of the overlap.
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

WaysOut::Faces::Faces(const FacetView& view) : facets(view)
{
  std::vector<Vec3> normals;
  for (std::size_t f = 0; f < facets.size(); ++f)
  {
    const Vec3 a = facets.outward(f);
    normals.push_back((1 / norm(a)) * a);
    mean = mean + normals.back();
  }
  const double length = norm(mean);
  if (!(length > 0))
  {
    angle = normals.empty() ? -1.0 : std::numbers::pi;
    return;
  }
  mean = (1 / length) * mean;
  for (const Vec3& n : normals)
    angle = std::max(angle, std::acos(std::clamp(dot(n, mean), -1.0, 1.0)));
}

bool WaysOut::Faces::may_be_across(const Vec3& axis) const
{
  return angle >= 0 && std::acos(std::min(std::abs(dot(axis, mean)), 1.0)) + angle > across_angle;
}

WaysOut::WaysOut(const std::vector<FacetView>& other, const std::vector<FacetView>& own)
    : other_(other.begin(), other.end()), own_(own.begin(), own.end())
{
}

void WaysOut::find(const std::vector<Faces>& all, const Vec3& p, const Vec3& q, const Vec3& axis,
                   std::vector<WayOut>& out) const
{
  out.clear();
  const double depth = norm(q - p), rounding = equal_tolerance * depth;
  for (const Faces& faces : all)
  {
    if (!faces.may_be_across(axis))
      continue;
    const FacetView& facets = faces.facets;
    facets.tree.nearest(p, depth,
                        [&](std::size_t f)
                        {
                          const Vec3 a = facets.outward(f), n = (1 / norm(a)) * a;
                          if (std::abs(dot(n, axis)) > across_cosine)
                            return depth;
                          const ClosestPoint c = closest_point(facets.type, facets.facet_x(f), p);
                          const double height = dot(p - c.x, n);
                          if (c.distance < depth && height < rounding)
                            out.push_back({c.distance, n});
                          else if (height > above * c.distance && dot(q - c.x, n) < 0)
                            out.push_back({0, n}); // p is outside: the line to q enters here
                          return depth;
                        });
  }
}

bool WaysOut::is_outside(const Overlap& overlap, double depth) const
{
  bool out = false;
  const double rounding = equal_tolerance * depth, limit = depth + rounding;
  for (const Faces& faces : other_)
  {
    const FacetView& facets = faces.facets;
    facets.tree.nearest(
        overlap.x, limit,
        [&](std::size_t f)
        {
          const Vec3 a = facets.outward(f);
          if (out || dot(a, overlap.axis) > smooth_cosine * norm(a)
              || dot(a, overlap.normal) < facing_cosine * norm(a))
            return limit;
          const ClosestPoint c = closest_point(facets.type, facets.facet_x(f), overlap.x);
          out = c.distance <= limit && dot(overlap.x - c.x, a) > 2 * rounding * norm(a);
          return limit;
        });
  }
  return out;
}

bool WaysOut::are_shorter(const Overlap& overlap)
{
  const double depth = norm(overlap.y - overlap.x);
  if (overlap.at_an_edge && is_outside(overlap, depth))
    return true;
  find(other_, overlap.x, overlap.y, overlap.axis, from_x_);
  if (from_x_.empty())
    return false;
  find(own_, overlap.y, overlap.x, overlap.axis, from_y_);
  for (const WayOut& a : from_x_)
    for (const WayOut& b : from_y_)
      if (a.length + b.length < (1 - equal_tolerance) * depth
          && dot(a.normal, b.normal) < opposite_cosine)
        return true;
  return false;
}

std::vector<std::uint8_t> qsdolfinx::have_shorter_ways_out(const Surface& own, const Surface& other,
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
