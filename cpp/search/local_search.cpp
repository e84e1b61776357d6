#include "search/local_search.h"

#include <algorithm>
#include <utility>

using namespace qsdolfinx;

std::array<double, 12> qsdolfinx::name_of(std::span<const double> x)
{
  std::array<double, 12> name{};
  std::ranges::copy(x, name.begin());
  const auto vertex = [&name](std::size_t i) { return std::span(name).subspan(3 * i, 3); };
  for (std::size_t i = 1; i < x.size() / 3; ++i)
    for (std::size_t j = i; j > 0 && std::ranges::lexicographical_compare(vertex(j), vertex(j - 1));
         --j)
      std::ranges::swap_ranges(vertex(j), vertex(j - 1));
  return name;
}

LocalSearch::LocalSearch(const Surface& surface, double radius, bool opposite)
    : surface_(surface), radius_(radius), opposite_(opposite), tree_(surface.tree())
{
  for (double size : surface.facets().size)
    largest_ = std::max(largest_, size);
}

std::span<const Candidate> LocalSearch::candidates(const Vec3& p, const Vec3& normal)
{
  found_.clear();
  limit_ = bound(p, normal);
  back_ = std::numeric_limits<double>::infinity();
  tree_.nearest(p, limit_,
                [&](std::size_t f)
                {
                  const Candidate c{f, closest_point(surface_.type(), surface_.facet_x(f), p)};
                  if (c.point.distance <= limit_)
                  {
                    if (faces(c, normal))
                    {
                      found_.push_back(c);
                      limit_ = std::min(limit_, c.point.distance + tie(f));
                    }
                    else
                      back_ = std::min(back_, c.point.distance);
                  }
                  return limit_;
                });
  drop_beyond_limit();
  if (!found_.empty())
    last_ = found_.front().facet;
  return found_;
}

std::span<const Candidate> LocalSearch::in_front(const Vec3& p, const Vec3& normal, double beyond)
{
  found_.clear();
  limit_ = radius_;
  const Vec3 start = p - radius_ * normal, d = 2 * radius_ * normal;
  tree_.along(LinePart(start, d, 1, largest_),
              [&](std::size_t f)
              {
                const double size = surface_.facets().size[f];
                if (!LinePart(start, d, 1, size).meets(box_of(surface_.facet_x(f))))
                  return;
                const Candidate c{f, closest_point(surface_.type(), surface_.facet_x(f), p)};
                const double distance = c.point.distance;
                if (distance <= limit_ && distance > beyond + tie(f)
                    && dot(surface_.normal(f, c.point.xi), normal) < front_cosine
                    && offset(c, p) <= overhang_tolerance * size)
                {
                  found_.push_back(c);
                  limit_ = std::min(limit_, distance + tie(f));
                }
              });
  drop_beyond_limit();
  return found_;
}

void LocalSearch::drop_beyond_limit()
{
  std::erase_if(found_, [this](const Candidate& c) { return c.point.distance > limit_; });
}

const Candidate* LocalSearch::best(std::span<const Candidate> ties, const Vec3& p) const
{
  if (ties.empty())
    return nullptr;
  if (ties.size() == 1)
    return &ties.front();
  return &*std::ranges::min_element(
      ties, {}, [this, &p](const Candidate& c)
      { return std::pair(beside(c, p), name_of(surface_.facet_x(c.facet))); });
}

double LocalSearch::offset(const Candidate& c, const Vec3& p) const
{
  const Vec3 n = surface_.normal(c.facet, c.point.xi), d = p - c.point.x;
  return norm(d - dot(d, n) * n);
}

bool LocalSearch::beside(const Candidate& c, const Vec3& p) const
{
  const Vec3 n = surface_.normal(c.facet, c.point.xi), d = p - c.point.x;
  const double height = dot(d, n), offset = norm(d - height * n);
  return offset > overhang_tolerance * surface_.facets().size[c.facet]
         && (offset > 2 * std::abs(height) || surface_.on_surface_boundary(c.facet, c.point.xi));
}

bool LocalSearch::faces(const Candidate& c, const Vec3& normal) const
{
  if (opposite_)
    return dot(surface_.normal(c.facet, c.point.xi), normal) < front_cosine;
  const Vec3 a = area_vector(surface_.type(), surface_.facet_x(c.facet), c.point.xi);
  return surface_.facets().orientation[c.facet] * dot(a, normal) < facing_cosine * norm(a);
}

/// Upper bound of the distance of the closest facet: the radius, or the distance of the facet that
/// was found for the previous node, which often is a neighbour.
double LocalSearch::bound(const Vec3& p, const Vec3& normal) const
{
  if (last_ >= surface_.num_facets())
    return radius_;
  const Candidate c{last_, closest_point(surface_.type(), surface_.facet_x(last_), p)};
  return faces(c, normal) ? std::min(radius_, c.point.distance + tie(last_)) : radius_;
}
