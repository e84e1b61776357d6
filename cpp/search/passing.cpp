#include "search/passing.h"
#include "geometry/projection.h"
#include "parallel/records.h"
#include "search/screen.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

using namespace qsdolfinx;

namespace
{
/// Tolerance of the bisection, as a fraction of the motion.
constexpr double root_tolerance = 1e-12;

/// A vector that changes linearly from the start to the end of a piece of the motion.
struct Moving
{
  Vec3 start, change, end;
  Vec3 at(double s) const { return start + s * change; }
};

Moving between(const Vec3& start, const Vec3& end) { return {start, end - start, end}; }

Moving difference(const Moving& a, const Moving& b)
{
  return {a.start - b.start, a.change - b.change, a.end - b.end};
}

/// A polynomial of degree 3 of s.
struct Cubic
{
  std::array<double, 4> c;
  double end; ///< its value at 1, exactly the value at 0 of the next piece
  double at(double s) const { return c[0] + s * (c[1] + s * (c[2] + s * c[3])); }
};

/// Six times the volume spanned by e, g and r.
Cubic volume(const Moving& e, const Moving& g, const Moving& r)
{
  const Vec3 n0 = cross(e.start, g.start), n1 = cross(e.start, g.change) + cross(e.change, g.start),
             n2 = cross(e.change, g.change);
  return {{dot(r.start, n0), dot(r.start, n1) + dot(r.change, n0),
           dot(r.start, n2) + dot(r.change, n1), dot(r.change, n2)},
          dot(r.end, cross(e.end, g.end))};
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

/// Place where a cubic changes its sign, and whether it was negative before.
struct SignChange
{
  double s;
  bool rises;
};

/// Sign changes within (0, 1].
std::vector<SignChange> sign_changes(const Cubic& f)
{
  std::vector<SignChange> out;
  const std::vector<double> ends = monotonic(f);
  const auto is_negative = [&](double s) { return (s == 1 ? f.end : f.at(s)) < 0; };
  for (std::size_t i = 1; i < ends.size(); ++i)
  {
    double low = ends[i - 1], high = ends[i];
    const bool first = is_negative(low);
    if (first == is_negative(high))
      continue;
    while (high - low > root_tolerance)
    {
      const double middle = 0.5 * (low + high);
      ((f.at(middle) < 0) == first ? low : high) = middle;
    }
    out.push_back({high, first});
  }
  return out;
}

/// What the crossings of one path tell; ranks with other facets have other ones.
struct Crossings
{
  static constexpr double never = std::numeric_limits<double>::infinity();
  double in = never;               ///< where it first goes into a body, in pieces of the motion
  double sine_in = 1;              ///< of the angle between path and face there
  double touched = 0;              ///< the same for the face that it goes into from its start
  double first = never, last = -1; ///< first and last crossing of faces that look as the point
  double speed = 0;                ///< motion in a piece relative to the last of these faces
  double sine_out = 0;             ///< of the angle between path and the last of these faces
  int first_out = 0, last_out = 0; ///< whether the point comes out there

  void include(const Crossings& other)
  {
    touched = std::max(touched, other.touched);
    if (other.in < in)
    {
      in = other.in;
      sine_in = other.sine_in;
    }
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
      sine_out = other.sine_out;
    }
  }
  /// Depth to which the path is within bodies that the point has passed through, 0 if it has not.
  double depth() const
  {
    if (!first_out || !last_out)
      return 0;
    const bool enters = in < last;
    const double sine = std::min(enters ? sine_in : (touched > 0 ? touched : 1.0), sine_out);
    return sine > grazing_sine ? sine * speed * (last - (enters ? in : 0.0)) : 0.0;
  }
};

/// Part of the path of a point, straight and at constant speed.
struct Piece
{
  Vec3 start, end;
  Vec3 normal; ///< outward unit normal at the point, at the end of the piece
  Vec3 origin; ///< where the whole path starts
};

/// Facets of this rank, with their positions at both ends of a piece of the motion.
class MovingFacets
{
public:
  /// @param origin vertices at the start of the motion, [facet][vertex][3]
  /// @param start, end those at the ends of the piece
  /// @param number of the piece
  MovingFacets(const Surface& surface, std::span<const double> origin,
               std::span<const double> start, std::span<const double> end, double number)
      : surface_(surface), origin_(origin), start_(start), end_(end), number_(number),
        touching_(surface.num_facets() == 0 ? 0 : smallest()), tree_(swept())
  {
  }

  Crossings along(const Piece& path)
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

  /// Vertices of a facet.
  std::span<const double> of(std::span<const double> x, std::size_t f) const
  {
    const std::size_t width = 3 * static_cast<std::size_t>(surface_.num_vertices());
    return x.subspan(f * width, width);
  }

  std::vector<Box> swept() const
  {
    std::vector<Box> out;
    for (std::size_t f = 0; f < surface_.num_facets(); ++f)
    {
      Box box = box_of(of(end_, f));
      const Box start = box_of(of(start_, f));
      box.include(start.low, start.high);
      out.push_back(box);
    }
    return out;
  }

  Moving vertex(std::size_t f, int i) const
  {
    return between(facet_vertex(of(start_, f), i), facet_vertex(of(end_, f), i));
  }

  void cross_facet(const Piece& path, std::size_t f, Crossings& out) const
  {
    if (closest_point(surface_.type(), of(origin_, f), path.origin).distance <= touching_)
      return touch_facet(path, f, out);
    if (surface_.type() == FacetType::interval)
    {
      const Vec3 up{0, 0, 1};
      const Moving a = vertex(f, 0);
      cross_part(path, f, a, vertex(f, 1), {a.start + up, a.change, a.end + up}, out);
      return;
    }
    cross_part(path, f, vertex(f, 0), vertex(f, 1), vertex(f, 2), out);
    if (surface_.type() == FacetType::quadrilateral)
      cross_part(path, f, vertex(f, 3), vertex(f, 2), vertex(f, 1), out);
  }

  /// A path that starts on a facet may go into the body there.
  void touch_facet(const Piece& path, std::size_t f, Crossings& out) const
  {
    if (number_ > 0)
      return;
    Vec3 way = path.end - path.start;
    for (int i = 0; i < surface_.num_vertices(); ++i)
      way = way - (1.0 / surface_.num_vertices()) * vertex(f, i).change;
    out.touched = std::max(out.touched, -sine(way, outward_at(f, 0)));
  }

  /// Sine of the angle between a way and a face, positive outwards.
  static double sine(const Vec3& way, const Vec3& outward)
  {
    const double lengths = norm(way) * norm(outward);
    return lengths > 0 ? dot(way, outward) / lengths : 0.0;
  }

  /// Crossings of a triangle, or, in 2D, of the strip along a and b.
  void cross_part(const Piece& path, std::size_t f, const Moving& a, const Moving& b,
                  const Moving& c, Crossings& out) const
  {
    const Moving e = difference(b, a), g = difference(c, a),
                 r = difference(between(path.start, path.end), a);
    const Cubic above = volume(e, g, r);
    for (const auto& [s, rises] : sign_changes(above))
    {
      const Vec3 normal = cross(e.at(s), g.at(s));
      if (!within(e.at(s), g.at(s), r.at(s), normal))
        continue;
      const Vec3 outward = outward_at(f, s);
      const bool is_out = rises == (dot(normal, outward) > 0);
      const double angle = std::abs(sine(r.at(1) - r.at(0), outward));
      Crossings here;
      if (!is_out)
      {
        here.in = number_ + s;
        here.sine_in = angle;
      }
      if (dot(path.normal, outward) > alike_cosine * norm(outward))
      {
        here.first = here.last = number_ + s;
        here.first_out = here.last_out = is_out;
        here.speed = norm(r.at(1) - r.at(0));
        here.sine_out = angle;
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
  std::span<const double> origin_, start_, end_;
  double number_, touching_;
  BoxTree tree_;
  std::vector<std::size_t> found_;
};

/// Box around positions of all facets of this rank at two times.
Box swept_box(std::span<const double> start, std::span<const double> end)
{
  Box out = box_of(end);
  const Box first = box_of(start);
  out.include(first.low, first.high);
  return out;
}

/// Add the crossings of all points in a piece of the motion, [point]. Collective.
void add_crossings(const Surface& surface, MovingFacets& facets, const Box& swept,
                   const std::vector<Piece>& pieces, std::vector<Crossings>& to)
{
  const std::vector<Box> boxes = boxes_of_ranks(surface.comm(), swept);
  std::vector<int> dest;
  std::vector<std::size_t> of;
  std::vector<Piece> sent;
  for (std::size_t i = 0; i < pieces.size(); ++i)
  {
    Box box;
    box.include(pieces[i].start, pieces[i].start);
    box.include(pieces[i].end, pieces[i].end);
    for (std::size_t r = 0; r < boxes.size(); ++r)
      if (meet(boxes[r], box))
      {
        dest.push_back(static_cast<int>(r));
        of.push_back(i);
        sent.push_back(pieces[i]);
      }
  }
  const Exchange exchange(surface.comm(), dest);
  std::vector<Crossings> found;
  for (const Piece& piece : exchange.forward<Piece>(sent, 1))
    found.push_back(facets.along(piece));
  const std::vector<Crossings> told = exchange.reverse<Crossings>(found, 1);
  for (std::size_t i = 0; i < told.size(); ++i)
    to[of[i]].include(told[i]);
}
} // namespace

std::vector<double> qsdolfinx::passed_depths(const Surface& surface, const Paths& paths)
{
  const std::size_t n = paths.num_pieces, width = surface.facets().x.size();
  if (n == 0 || paths.facet_x.size() != (n + 1) * width)
    throw std::invalid_argument("passed_depths: vertices of each facet at each time");
  if (paths.x.size() % (3 * (n + 1)) != 0 || paths.normal.size() != paths.x.size())
    throw std::invalid_argument("passed_depths: a point and a normal for each path at each time");
  const std::size_t size = paths.x.size() / (n + 1);
  const auto point = [&](std::span<const double> x, std::size_t k, std::size_t i)
  { return facet_vertex(x.subspan(k * size, size), static_cast<int>(i)); };
  std::vector<Crossings> all(size / 3);
  for (std::size_t k = 0; k < n; ++k)
  {
    const std::span<const double> start = paths.facet_x.subspan(k * width, width),
                                  end = paths.facet_x.subspan((k + 1) * width, width);
    std::vector<Piece> pieces;
    for (std::size_t i = 0; i < all.size(); ++i)
      pieces.push_back({point(paths.x, k, i), point(paths.x, k + 1, i),
                        point(paths.normal, k + 1, i), point(paths.x, 0, i)});
    MovingFacets facets(surface, paths.facet_x.subspan(0, width), start, end,
                        static_cast<double>(k));
    add_crossings(surface, facets, swept_box(start, end), pieces, all);
  }
  std::vector<double> out;
  for (const Crossings& crossings : all)
    out.push_back(crossings.depth());
  return out;
}
