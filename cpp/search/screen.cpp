#include "search/screen.h"
#include "geometry/projection.h"
#include "parallel/exchange.h"
#include "parallel/records.h"

using namespace qsdolfinx;

namespace
{
/// Parameter t at which the line x + t d meets the segment from a to b, in the xy-plane.
std::optional<double> meet_segment(const Vec3& x, const Vec3& d, const Vec3& a, const Vec3& b)
{
  const Vec3 e = b - a, r = a - x;
  const double det = d[0] * e[1] - d[1] * e[0];
  if (det == 0)
    return std::nullopt;
  const double s = (r[0] * d[1] - r[1] * d[0]) / det;
  if (s < -seam_tolerance || s > 1 + seam_tolerance)
    return std::nullopt;
  return (r[0] * e[1] - r[1] * e[0]) / det;
}

/// Parameter t at which the line x + t d meets the triangle a, b, c (Möller & Trumbore).
std::optional<double> meet_triangle(const Vec3& x, const Vec3& d, const Vec3& a, const Vec3& b,
                                    const Vec3& c)
{
  const Vec3 e = b - a, f = c - a, r = x - a, p = cross(d, f);
  const double det = dot(e, p);
  if (det == 0)
    return std::nullopt;
  const double u = dot(r, p) / det;
  if (u < -seam_tolerance || u > 1 + seam_tolerance)
    return std::nullopt;
  const Vec3 q = cross(r, e);
  const double v = dot(d, q) / det;
  if (v < -seam_tolerance || u + v > 1 + seam_tolerance)
    return std::nullopt;
  return dot(f, q) / det;
}

bool looks_along(const FacetView& facets, std::size_t f, const Vec3& n)
{
  return dot(facets.outward(f), n) > 0;
}

bool has_vertex(const FacetView& facets, std::size_t f, const Vec3& p, double tolerance)
{
  for (int i = 0; i < static_cast<int>(facets.type); ++i)
  {
    const Vec3 r = facet_vertex(facets.facet_x(f), i) - p;
    if (dot(r, r) <= tolerance * tolerance)
      return true;
  }
  return false;
}

/// Visibility test along one line.
class Look
{
public:
  Look(const Sight& line, Screens screens, double touching)
      : line_(line), own_(screens == Screens::own), touching_(touching), d_(line.y - line.x),
        end_(touching / norm(d_)), beyond_(2 - end_)
  {
  }

  bool is_hidden() const { return between_ || looks_alike_; }

  void through(const FacetView& facets)
  {
    if (end_ >= 1 || facets.x.empty()) // the ends touch each other, or there are no facets
      return;
    facets.tree.along(LinePart(line_.x, d_, own_ ? 2.0 : 1.0, touching_),
                      [&](std::size_t f) { meet(facets, f); });
  }

private:
  void meet(const FacetView& facets, std::size_t f)
  {
    const auto t = meet_facet(line_.x, d_, facets.type, facets.facet_x(f));
    if (!t || *t <= end_ || *t >= beyond_ || between_
        || (own_ && has_vertex(facets, f, line_.x, touching_)))
      return;
    const bool alike = looks_along(facets, f, line_.normal);
    if (!own_)
      between_ = *t < 1 - end_ && (alike || (line_.is_deep && !is_at_end(facets, f)));
    else if (*t < 1 - end_ || (alike && *t < 1 + end_))
      between_ = true;
    else if (*t > 1 + end_)
    {
      beyond_ = *t;
      looks_alike_ = alike;
    }
  }

  /// Whether y is on a facet. The facet may be warped, and the line may meet it beside y.
  bool is_at_end(const FacetView& facets, std::size_t f) const
  {
    return closest_point(facets.type, facets.facet_x(f), line_.y).distance <= 10 * touching_;
  }

  const Sight& line_;
  bool own_;
  double touching_;
  Vec3 d_;
  double end_;    ///< tolerance at the ends, as a fraction of the line
  double beyond_; ///< position of the first facet met beyond y
  bool between_ = false, looks_alike_ = false;
};

/// Facets of other ranks that meet this rank's box, in an order that depends on the partition.
/// Collective.
FacetCopies copy_of_others(const Surface& surface, const Box& box)
{
  std::vector<Box> boxes = boxes_of_ranks(surface.comm(), box);
  boxes[static_cast<std::size_t>(surface.rank())] = Box{};
  std::vector<int> dest;
  std::vector<std::size_t> facets;
  facets_in_boxes(surface, boxes, dest, facets);
  const std::size_t width = 3 * static_cast<std::size_t>(surface.num_vertices());
  std::vector<double> x, orientation;
  for (std::size_t f : facets)
  {
    append_record(x, surface.facets().x, f, width);
    append_record(orientation, surface.facets().orientation, f, 1);
  }
  const Exchange exchange(surface.comm(), dest);
  return {surface.type(), exchange.forward<double>(x, static_cast<int>(width)),
          exchange.forward<double>(orientation, 1)};
}

Box box_of_lines(std::span<const Sight> lines, bool doubled)
{
  Box box;
  for (const Sight& line : lines)
    for (const Vec3& p : {line.x, doubled ? 2.0 * line.y - line.x : line.y})
      box.include(p, p);
  return box;
}
} // namespace

std::optional<double> qsdolfinx::meet_facet(const Vec3& x, const Vec3& d, FacetType type,
                                            std::span<const double> v)
{
  const Vec3 a = facet_vertex(v, 0), b = facet_vertex(v, 1);
  if (type == FacetType::interval)
    return meet_segment(x, d, a, b);
  const Vec3 c = facet_vertex(v, 2);
  auto t = meet_triangle(x, d, a, b, c);
  if (!t && type == FacetType::quadrilateral)
    t = meet_triangle(x, d, facet_vertex(v, 3), c, b);
  return t;
}

NearFacets::NearFacets(const Surface& surface, const Box& box)
    : surface_(surface), others_(copy_of_others(surface, box)),
      tree_(facet_boxes(others_.type, others_.x))
{
}

std::vector<FacetView> NearFacets::views() const
{
  return {{surface_.type(), surface_.facets().x, surface_.facets().orientation, surface_.tree()},
          {others_.type, others_.x, others_.orientation, tree_}};
}

void qsdolfinx::facets_in_boxes(const Surface& surface, std::span<const Box> boxes,
                                std::vector<int>& rank, std::vector<std::size_t>& facet)
{
  for (std::size_t f = 0; f < surface.num_facets(); ++f)
  {
    const Box box = box_of(surface.facet_x(f));
    for (std::size_t r = 0; r < boxes.size(); ++r)
      if (meet(boxes[r], box))
      {
        rank.push_back(static_cast<int>(r));
        facet.push_back(f);
      }
  }
}

std::vector<std::uint8_t> qsdolfinx::hidden(const Surface& surface, std::span<const Sight> lines,
                                            Screens screens)
{
  const NearFacets facets(surface, box_of_lines(lines, screens == Screens::own));
  const std::vector<FacetView> near = facets.views();
  const double touching = touch_tolerance * surface.facet_size_range()[0];
  std::vector<std::uint8_t> out;
  out.reserve(lines.size());
  for (const Sight& line : lines)
  {
    Look look(line, screens, touching);
    for (const FacetView& view : near)
      look.through(view);
    out.push_back(look.is_hidden());
  }
  return out;
}
