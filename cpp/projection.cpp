#include "projection.h"

#include <algorithm>

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

void keep_nearer(ClosestPoint& best, const ClosestPoint& other)
{
  if (other.distance < best.distance)
    best = other;
}

ClosestPoint on_triangle(std::span<const double> v, const Vec3& p)
{
  const Vec3 a = facet_vertex(v, 0), e0 = facet_vertex(v, 1) - a, e1 = facet_vertex(v, 2) - a,
             d = p - a;
  const double a00 = dot(e0, e0), a01 = dot(e0, e1), a11 = dot(e1, e1);
  const double b0 = dot(e0, d), b1 = dot(e1, d), det = a00 * a11 - a01 * a01;
  const std::array<double, 2> xi{(a11 * b0 - a01 * b1) / det, (a00 * b1 - a01 * b0) / det};
  if (xi[0] >= 0 && xi[1] >= 0 && xi[0] + xi[1] <= 1)
    return make(FacetType::triangle, v, xi, p);

  const double s = segment_parameter(a, facet_vertex(v, 1), p);
  const double t = segment_parameter(a, facet_vertex(v, 2), p);
  const double r = segment_parameter(facet_vertex(v, 1), facet_vertex(v, 2), p);
  ClosestPoint best = make(FacetType::triangle, v, {s, 0}, p);
  keep_nearer(best, make(FacetType::triangle, v, {0, t}, p));
  keep_nearer(best, make(FacetType::triangle, v, {1 - r, r}, p));
  return best;
}

/// Newton's method for the interior of a bilinear patch x(ξ,η) = x0 + ξ a + η b + ξη c.
/// Steps are held within the patch; the Gauss-Newton matrix stands in where the Hessian is
/// indefinite.
ClosestPoint newton_on_quadrilateral(std::span<const double> v, const Vec3& p, ClosestPoint start)
{
  const Vec3 x0 = facet_vertex(v, 0), a = facet_vertex(v, 1) - x0, b = facet_vertex(v, 2) - x0;
  const Vec3 c = facet_vertex(v, 3) - facet_vertex(v, 1) - facet_vertex(v, 2) + x0;
  ClosestPoint best = start;
  std::array<double, 2> xi = start.xi;
  for (int i = 0; i < projection_max_iterations; ++i)
  {
    const Vec3 xs = a + xi[1] * c, xt = b + xi[0] * c;
    const Vec3 r = x0 + xi[0] * a + xi[1] * b + (xi[0] * xi[1]) * c - p;
    const double gs = dot(r, xs), gt = dot(r, xt), h00 = dot(xs, xs), h11 = dot(xt, xt);
    double h01 = dot(xs, xt) + dot(r, c);
    if (h00 * h11 - h01 * h01 <= 1e-8 * h00 * h11)
      h01 = dot(xs, xt);
    const double det = h00 * h11 - h01 * h01;
    if (!(det > 0))
      break;
    const std::array<double, 2> next{std::clamp(xi[0] - (h11 * gs - h01 * gt) / det, 0.0, 1.0),
                                     std::clamp(xi[1] - (h00 * gt - h01 * gs) / det, 0.0, 1.0)};
    const double step = std::max(std::abs(next[0] - xi[0]), std::abs(next[1] - xi[1]));
    xi = next;
    keep_nearer(best, make(FacetType::quadrilateral, v, xi, p));
    if (step < projection_tolerance)
      break;
  }
  return best;
}

ClosestPoint on_quadrilateral(std::span<const double> v, const Vec3& p)
{
  constexpr auto type = FacetType::quadrilateral;
  const Vec3 x0 = facet_vertex(v, 0), x1 = facet_vertex(v, 1), x2 = facet_vertex(v, 2),
             x3 = facet_vertex(v, 3);
  ClosestPoint best = make(type, v, {segment_parameter(x0, x1, p), 0}, p);
  keep_nearer(best, make(type, v, {0, segment_parameter(x0, x2, p)}, p));
  keep_nearer(best, make(type, v, {1, segment_parameter(x1, x3, p)}, p));
  keep_nearer(best, make(type, v, {segment_parameter(x2, x3, p), 1}, p));

  // On a parallelogram the distance is convex and one start is enough.
  const Vec3 c = x3 - x1 - x2 + x0;
  const bool affine = norm(c) <= 1e-12 * (norm(x3 - x0) + norm(x2 - x1));
  keep_nearer(best, newton_on_quadrilateral(v, p, make(type, v, {0.5, 0.5}, p)));
  if (!affine)
  {
    for (double s : {0.25, 0.75})
      for (double t : {0.25, 0.75})
        keep_nearer(best, newton_on_quadrilateral(v, p, make(type, v, {s, t}, p)));
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
