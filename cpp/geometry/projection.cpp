#include "geometry/projection.h"

#include <algorithm>
#include <limits>

using namespace qsdolfinx;

namespace
{
/// Parameter in [0, 1] of the point of segment ab that is closest to p.
double segment_parameter(const Vec3& a, const Vec3& b, const Vec3& p)
{
  const Vec3 t = b - a;
  return std::clamp(dot(p - a, t) / dot(t, t), 0.0, 1.0);
}

ClosestPoint make(FacetType type, std::span<const double> v, std::array<double, 2> xi,
                  const Vec3& p)
{
  const Vec3 x = facet_point(type, v, xi);
  return {xi, x, norm(x - p)};
}

/// Tolerances relative to a quadrilateral's size: distances that differ by less than minima_tie are
/// equal, and points closer to each other than same_place are the same.
constexpr double minima_tie = 1e-10, same_place = 1e-3;

void keep_nearer(ClosestPoint& best, const ClosestPoint& other)
{
  if (other.distance < best.distance)
    best = other;
}

/// Keep one of two minima of a patch. If two minima are equally far but at different places, the
/// one whose coordinates come first is kept, independently of the order of the facet's vertices.
void keep_minimum(ClosestPoint& best, const ClosestPoint& other, double size)
{
  const Vec3 d = other.x - best.x;
  const bool tie = std::abs(other.distance - best.distance) <= minima_tie * size;
  if (!tie || dot(d, d) <= same_place * same_place * size * size)
    return keep_nearer(best, other);
  const double* first
      = std::ranges::find_if(d, [&](double c) { return std::abs(c) > same_place * size / 2; });
  if (first != d.end() && *first < 0)
    best = other;
}

ClosestPoint on_triangle(std::span<const double> v, const Vec3& p)
{
  constexpr auto type = FacetType::triangle;
  const Vec3 a = facet_vertex(v, 0), b = facet_vertex(v, 1), c = facet_vertex(v, 2);
  const Vec3 e0 = b - a, e1 = c - a, d = p - a;
  const double a00 = dot(e0, e0), a01 = dot(e0, e1), a11 = dot(e1, e1);
  const double b0 = dot(e0, d), b1 = dot(e1, d), det = a00 * a11 - a01 * a01;
  const std::array<double, 2> xi{(a11 * b0 - a01 * b1) / det, (a00 * b1 - a01 * b0) / det};
  if (xi[0] >= 0 && xi[1] >= 0 && xi[0] + xi[1] <= 1)
    return make(type, v, xi, p);

  // Check only edges beyond which the projection onto the plane lies.
  ClosestPoint best{{}, {}, std::numeric_limits<double>::infinity()};
  if (!(xi[1] >= 0))
    keep_nearer(best, make(type, v, {segment_parameter(a, b, p), 0}, p));
  if (!(xi[0] >= 0))
    keep_nearer(best, make(type, v, {0, segment_parameter(a, c, p)}, p));
  if (!(xi[0] + xi[1] <= 1))
  {
    const double r = segment_parameter(b, c, p);
    keep_nearer(best, make(type, v, {1 - r, r}, p));
  }
  return best;
}

/// A bilinear patch x(ξ,η) = x0 + ξ a + η b + ξη c, and f(ξ,η) = ½|x - p|².
struct Patch
{
  std::span<const double> v;
  Vec3 p, x0, x1, x2, x3, a, b, c;

  Patch(std::span<const double> vertices, const Vec3& query)
      : v(vertices), p(query), x0(facet_vertex(v, 0)), x1(facet_vertex(v, 1)),
        x2(facet_vertex(v, 2)), x3(facet_vertex(v, 3)), a(x1 - x0), b(x2 - x0), c(x3 - x1 - b)
  {
  }

  ClosestPoint at(std::array<double, 2> xi) const
  {
    return make(FacetType::quadrilateral, v, xi, p);
  }

  /// Whether f is convex on the whole patch, so that a local minimum is the only one. This is
  /// checked by a bound of the Hessian, whose diagonal entries are |x_ξ|² and |x_η|² and whose
  /// off-diagonal entry is x_ξ·x_η + (x - p)·c.
  bool is_convex() const
  {
    const double half = norm(c) / 2;
    const double s = norm(a + 0.5 * c) - half, t = norm(b + 0.5 * c) - half;
    const double ab = dot(a, b), ac = dot(a, c), bc = dot(b, c);
    const double off = std::max({std::abs(ab), std::abs(ab + ac), std::abs(ab + bc),
                                 std::abs(ab + ac + bc + 4 * half * half)});
    const double far = std::sqrt(std::max(
        {dot(x0 - p, x0 - p), dot(x1 - p, x1 - p), dot(x2 - p, x2 - p), dot(x3 - p, x3 - p)}));
    return s > 0 && t > 0 && s * t > off + 2 * half * far;
  }

  double size() const { return norm(x3 - x0) + norm(x2 - x1); }

  /// Closest point of the four edges.
  ClosestPoint on_edges() const
  {
    ClosestPoint best = at({segment_parameter(x0, x1, p), 0});
    keep_minimum(best, at({0, segment_parameter(x0, x2, p)}), size());
    keep_minimum(best, at({1, segment_parameter(x1, x3, p)}), size());
    keep_minimum(best, at({segment_parameter(x2, x3, p), 1}), size());
    return best;
  }

  /// Whether f does not fall from a point on the edges into the patch.
  bool rises_inward(const ClosestPoint& q) const
  {
    constexpr double tolerance = 1e-13;
    const Vec3 r = q.x - p;
    const auto rises = [&r](double xi, const Vec3& t)
    {
      const double slope = dot(r, t), small = tolerance * norm(r) * norm(t);
      return (xi > 0 || slope >= -small) && (xi < 1 || slope <= small);
    };
    return rises(q.xi[0], a + q.xi[1] * c) && rises(q.xi[1], b + q.xi[0] * c);
  }

  /// Newton's method from ξ. Steps are limited to the patch; the Gauss-Newton matrix is used where
  /// the Hessian is indefinite.
  /// @param[out] xi the nearest point found
  /// @return whether it ended at a stationary point inside
  bool newton(std::array<double, 2>& xi) const
  {
    std::array<double, 2> best = xi, here = xi;
    double least = std::numeric_limits<double>::infinity();
    bool inside = false;
    for (int i = 0;; ++i)
    {
      const Vec3 xs = a + here[1] * c, xt = b + here[0] * c;
      const Vec3 r = x0 - p + here[0] * a + here[1] * xt;
      // The distance is insensitive to ξ: where Newton's method has converged, its ξ is used.
      if (const double square = dot(r, r); square < (inside ? 1 + 1e-13 : 1.0) * least)
      {
        least = square;
        best = here;
      }
      if (inside || i == projection_max_iterations)
        break;
      const double gs = dot(r, xs), gt = dot(r, xt), h00 = dot(xs, xs), h11 = dot(xt, xt);
      double h01 = dot(xs, xt) + dot(r, c);
      if (h00 * h11 - h01 * h01 <= 1e-8 * h00 * h11)
        h01 = dot(xs, xt);
      const double det = h00 * h11 - h01 * h01;
      if (!(det > 0))
        break;
      const std::array<double, 2> next{std::clamp(here[0] - (h11 * gs - h01 * gt) / det, 0.0, 1.0),
                                       std::clamp(here[1] - (h00 * gt - h01 * gs) / det, 0.0, 1.0)};
      const double step = std::max(std::abs(next[0] - here[0]), std::abs(next[1] - here[1]));
      here = next;
      if (step < projection_tolerance)
      {
        inside = here[0] > 0 && here[0] < 1 && here[1] > 0 && here[1] < 1;
        if (!inside)
          break;
      }
    }
    xi = best;
    return inside;
  }
};

ClosestPoint on_quadrilateral(std::span<const double> v, const Vec3& p)
{
  const Patch patch(v, p);
  const bool convex = patch.is_convex();
  std::array<double, 2> xi{0.5, 0.5};
  if (patch.newton(xi) && convex)
    return patch.at(xi);
  ClosestPoint best = patch.on_edges();
  if (convex && patch.rises_inward(best))
    return best;
  keep_minimum(best, patch.at(xi), patch.size());
  for (double s : {0.25, 0.75})
    for (double t : {0.25, 0.75})
    {
      xi = {s, t};
      patch.newton(xi);
      keep_minimum(best, patch.at(xi), patch.size());
    }
  return best;
}
} // namespace

ClosestPoint qsdolfinx::closest_point(FacetType type, std::span<const double> v, const Vec3& p)
{
  switch (type)
  {
  case FacetType::interval:
    return make(type, v, {segment_parameter(facet_vertex(v, 0), facet_vertex(v, 1), p), 0}, p);
  case FacetType::triangle:
    return on_triangle(v, p);
  default:
    return on_quadrilateral(v, p);
  }
}
