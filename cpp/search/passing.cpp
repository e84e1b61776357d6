#include "search/passing.h"
#include "geometry/projection.h"
#include "parallel/records.h"
#include "search/screen.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

using namespace qsdolfinx;

namespace
{
/// Tolerance of the bisection, as a fraction of the motion.
constexpr double root_tolerance = 1e-12;

/// A vector that changes linearly from the start to the end of the motion.
struct Moving
{
  Vec3 start, change;
  Vec3 at(double s) const { return start + s * change; }
};

Moving between(const Vec3& start, const Vec3& end) { return {start, end - start}; }

Moving difference(const Moving& a, const Moving& b)
{
  return {a.start - b.start, a.change - b.change};
}

/// A polynomial of degree 3 of s.
struct Cubic
{
  std::array<double, 4> c;
  double at(double s) const { return c[0] + s * (c[1] + s * (c[2] + s * c[3])); }
};

/// Six times the volume spanned by e, g and r.
Cubic volume(const Moving& e, const Moving& g, const Moving& r)
{
  const Vec3 n0 = cross(e.start, g.start), n1 = cross(e.start, g.change) + cross(e.change, g.start),
             n2 = cross(e.change, g.change);
  return {{dot(r.start, n0), dot(r.start, n1) + dot(r.change, n0),
           dot(r.start, n2) + dot(r.change, n1), dot(r.change, n2)}};
}

/// Ends of the intervals of [0, 1] in which a cubic is monotonic.
std::vector<double> monotonic(const Cubic& f)
{
  std::vector<double> out{0, 1};
  const double a = 3 * f.c[3], b = f.c[2], c = f.c[1], root = b * b - a * c; // a s² + 2 b s + c
  if (root > 0)
  {
    const double q = -(b + std::copysign(std::sqrt(root), b));
    for (double s : {q / a, c / q})
      if (s > 0 && s < 1)
        out.push_back(s);
  }
  std::sort(out.begin(), out.end());
  return out;
}

/// Places within (0, 1] where a cubic changes its sign.
std::vector<double> sign_changes(const Cubic& f)
{
  std::vector<double> out;
  const std::vector<double> ends = monotonic(f);
  for (std::size_t i = 1; i < ends.size(); ++i)
  {
    double low = ends[i - 1], high = ends[i];
    const bool first = f.at(low) < 0;
    if (first == (f.at(high) < 0))
      continue;
    while (high - low > root_tolerance)
    {
      const double middle = 0.5 * (low + high);
      ((f.at(middle) < 0) == first ? low : high) = middle;
    }
    out.push_back(high);
  }
  return out;
}

/// What the crossings of one path tell; ranks with other facets have other ones.
struct Crossings
{
  double in = 1;                   ///< where it first goes into a body
  double first = 2, last = -1;     ///< first and last crossing of faces that look as the point
  double speed = 0;                ///< motion of the point relative to the last of these faces
  int first_out = 0, last_out = 0; ///< whether the point comes out there

  void include(const Crossings& other)
  {
    in = std::min(in, other.in);
    if (other.first < first)
    {
      first = other.first;
      first_out = other.first_out;
    }
    if (other.last > last)
    {
      last = other.last;
      last_out = other.last_out;
      speed = other.speed;
    }
  }
  /// Length within bodies that the point has passed through, 0 if it has not.
  double length() const
  {
    return first_out && last_out ? speed * (last - (in < last ? in : 0.0)) : 0.0;
  }
};

/// Facets of this rank, with their positions at both ends of the motion.
class MovingFacets
{
public:
  MovingFacets(const Surface& surface, std::span<const double> start_x)
      : surface_(surface), start_(start_x), touching_(surface.num_facets() == 0 ? 0 : smallest()),
        tree_(swept())
  {
  }

  Crossings along(const Path& path)
  {
    Crossings out;
    Box box;
    box.include(path.start, path.start);
    box.include(path.end, path.end);
    found_.clear();
    tree_.near(box, 0, found_);
    for (std::size_t f : found_)
      cross_facet(path, f, out);
    return out;
  }

private:
  double smallest() const
  {
    const auto& size = surface_.facets().size;
    return touch_tolerance * *std::min_element(size.begin(), size.end());
  }

  std::span<const double> start_x(std::size_t f) const
  {
    const std::size_t width = 3 * static_cast<std::size_t>(surface_.num_vertices());
    return start_.subspan(f * width, width);
  }

  std::vector<Box> swept() const
  {
    std::vector<Box> out;
    for (std::size_t f = 0; f < surface_.num_facets(); ++f)
    {
      Box box = box_of(surface_.facet_x(f));
      const Box start = box_of(start_x(f));
      box.include(start.low, start.high);
      out.push_back(box);
    }
    return out;
  }

  Moving vertex(std::size_t f, int i) const
  {
    return between(facet_vertex(start_x(f), i), facet_vertex(surface_.facet_x(f), i));
  }

  void cross_facet(const Path& path, std::size_t f, Crossings& out) const
  {
    if (closest_point(surface_.type(), start_x(f), path.start).distance <= touching_)
      return;
    if (surface_.type() == FacetType::interval)
    {
      const Vec3 up{0, 0, 1};
      cross_part(path, f, vertex(f, 0), vertex(f, 1),
                 {vertex(f, 0).start + up, vertex(f, 0).change}, out);
      return;
    }
    cross_part(path, f, vertex(f, 0), vertex(f, 1), vertex(f, 2), out);
    if (surface_.type() == FacetType::quadrilateral)
      cross_part(path, f, vertex(f, 3), vertex(f, 2), vertex(f, 1), out);
  }

  /// Crossings of a triangle, or, in 2D, of the strip along a and b.
  void cross_part(const Path& path, std::size_t f, const Moving& a, const Moving& b,
                  const Moving& c, Crossings& out) const
  {
    const Moving e = difference(b, a), g = difference(c, a),
                 r = difference(between(path.start, path.end), a);
    const Cubic above = volume(e, g, r);
    for (double s : sign_changes(above))
    {
      const Vec3 normal = cross(e.at(s), g.at(s));
      if (!within(e.at(s), g.at(s), r.at(s), normal))
        continue;
      const Vec3 outward = outward_at(f, s);
      const bool rises = above.at(std::max(0.0, s - 2 * root_tolerance)) < 0;
      const bool is_out = rises == (dot(normal, outward) > 0);
      Crossings here;
      if (!is_out)
        here.in = s;
      if (dot(path.normal, outward) > alike_cosine * norm(outward))
      {
        here.first = here.last = s;
        here.first_out = here.last_out = is_out;
        here.speed = norm(r.at(1) - r.at(0));
      }
      out.include(here);
    }
  }

  /// Whether r = u e + v g has u and v within the triangle, in 2D u within the edge.
  bool within(const Vec3& e, const Vec3& g, const Vec3& r, const Vec3& normal) const
  {
    const double square = dot(normal, normal);
    if (square == 0)
      return false;
    const double u = dot(cross(r, g), normal) / square;
    if (u < -seam_tolerance || u > 1 + seam_tolerance)
      return false;
    if (surface_.type() == FacetType::interval)
      return true;
    const double v = dot(cross(e, r), normal) / square;
    return v >= -seam_tolerance && u + v <= 1 + seam_tolerance;
  }

  /// Outward at the centre of a facet on its way, of any length.
  Vec3 outward_at(std::size_t f, double s) const
  {
    std::vector<double> x;
    for (int i = 0; i < surface_.num_vertices(); ++i)
    {
      const Vec3 p = vertex(f, i).at(s);
      x.insert(x.end(), p.begin(), p.end());
    }
    const FacetType type = surface_.type();
    return surface_.facets().orientation[f] * area_vector(type, x, facet_centre(type));
  }

  const Surface& surface_;
  std::span<const double> start_;
  double touching_;
  BoxTree tree_;
  std::vector<std::size_t> found_;
};

/// Box around all facets of this rank, at both ends of the motion.
Box swept_box(const Surface& surface, std::span<const double> start_x)
{
  Box out = box_of(surface.facets().x);
  const Box start = box_of(start_x);
  out.include(start.low, start.high);
  return out;
}
} // namespace

std::vector<double> qsdolfinx::passed_lengths(const Surface& surface,
                                              std::span<const double> start_x,
                                              std::span<const Path> paths)
{
  if (start_x.size() != surface.facets().x.size())
    throw std::invalid_argument("passed_lengths: one start for each vertex of each facet");
  const std::vector<Box> boxes = boxes_of_ranks(surface.comm(), swept_box(surface, start_x));
  std::vector<int> dest;
  std::vector<std::size_t> of;
  std::vector<Path> sent;
  for (std::size_t i = 0; i < paths.size(); ++i)
  {
    Box box;
    box.include(paths[i].start, paths[i].start);
    box.include(paths[i].end, paths[i].end);
    for (std::size_t r = 0; r < boxes.size(); ++r)
      if (meet(boxes[r], box))
      {
        dest.push_back(static_cast<int>(r));
        of.push_back(i);
        sent.push_back(paths[i]);
      }
  }
  const Exchange exchange(surface.comm(), dest);
  const std::vector<Path> asked = exchange.forward<Path>(sent, 1);
  MovingFacets facets(surface, start_x);
  std::vector<Crossings> found;
  found.reserve(asked.size());
  for (const Path& path : asked)
    found.push_back(facets.along(path));
  const std::vector<Crossings> told = exchange.reverse<Crossings>(found, 1);
  std::vector<Crossings> all(paths.size());
  for (std::size_t i = 0; i < told.size(); ++i)
    all[of[i]].include(told[i]);
  std::vector<double> out;
  for (std::size_t i = 0; i < paths.size(); ++i)
    out.push_back(all[i].length());
  return out;
}
