#include "geometry/planar.h"

#include <algorithm>
#include <numeric>

using namespace qsdolfinx;

namespace
{
constexpr double inverse_tolerance = 1e-16; // error after Newton's method, relative to the facet
constexpr int inverse_max_iterations = 30;
constexpr double line_tolerance = 1e-9;     // distance at which a point is on a side, per length
constexpr double outside_tolerance = 1e-12; // part of a side's length
constexpr double fold_tolerance = 1e-6;     // smallest Jacobian over the largest

/// Square of a polygon's longest side.
double squared_size(const Polygon& p)
{
  double out = 0;
  for (std::size_t i = 0; i < p.size(); ++i)
  {
    const Vec2 t = p[i + 1 < p.size() ? i + 1 : 0] - p[i];
    out = std::max(out, t[0] * t[0] + t[1] * t[1]);
  }
  return out;
}

/// Whether a point is beyond the side of a polygon from a to b by more than rounding.
bool is_beyond(const Polygon& p, const Vec2& a, const Vec2& b, const Vec2& q)
{
  const Vec2 t = b - a;
  const double c = cross(t, q - a);
  return c < 0
         && c * c > seam_tolerance * seam_tolerance * squared_size(p) * (t[0] * t[0] + t[1] * t[1]);
}

bool is_interval(const Polygon& p) { return p.size() == 2; }

/// Distance of a point to the left of the line from a to b, times its length. A point next to the
/// line counts as on it: sides that coincide up to rounding would otherwise cross anywhere, and the
/// quadrature points beside them would move with the crossing.
struct Beside
{
  Beside(const Vec2& a, const Vec2& b)
      : a(a), t(b - a), least(line_tolerance * (t[0] * t[0] + t[1] * t[1]))
  {
  }

  double operator()(const Vec2& p) const
  {
    const double c = cross(t, p - a);
    return std::abs(c) <= least ? 0.0 : c;
  }

  Vec2 a, t;
  double least;
};

/// Keep the part of `in` to the left of the line from a to b.
void clip_by_line(const Polygon& in, const Vec2& a, const Vec2& b, Polygon& out)
{
  out.clear();
  const Beside beside(a, b);
  for (std::size_t i = 0; i < in.size(); ++i)
  {
    const Vec2 &p = in[i], &q = in[i + 1 < in.size() ? i + 1 : 0];
    const double dp = beside(p), dq = beside(q);
    if (dp >= 0)
      out.push_back(p);
    if ((dp > 0 && dq < 0) || (dp < 0 && dq > 0))
      out.push_back(p + (dp / (dp - dq)) * (q - p));
  }
}
} // namespace

double qsdolfinx::measure(const Polygon& p)
{
  if (p.size() < 2)
    return 0;
  if (is_interval(p))
    return p[1][0] - p[0][0];
  double twice = 0;
  for (std::size_t i = 1; i + 1 < p.size(); ++i)
    twice += cross(p[i] - p[0], p[i + 1] - p[0]);
  return 0.5 * twice;
}

void qsdolfinx::intersect(const Polygon& a, const Polygon& b, Polygon& out)
{
  if (is_interval(b))
  {
    const double low = std::max(a[0][0], b[0][0]), high = std::min(a[1][0], b[1][0]);
    out.clear();
    if (low < high)
      out = {{low, 0}, {high, 0}};
    return;
  }
  // Two polygons alternate: one is clipped, the other receives the result.
  Polygon first = a, second;
  Polygon *in = &first, *cut = &second;
  for (std::size_t i = 0; i < b.size() && !in->empty(); ++i)
  {
    clip_by_line(*in, b[i], b[(i + 1) % b.size()], *cut);
    std::swap(in, cut);
  }
  out = *in;
  if (out.size() < 3)
    out.clear();
}

bool qsdolfinx::contains(const Polygon& p, const Vec2& q)
{
  if (is_interval(p))
  {
    const double tolerance = seam_tolerance * (p[1][0] - p[0][0]);
    return p[0][0] - tolerance <= q[0] && q[0] <= p[1][0] + tolerance;
  }
  for (std::size_t i = 0; i < p.size(); ++i)
    if (is_beyond(p, p[i], p[i + 1 < p.size() ? i + 1 : 0], q))
      return false;
  return true;
}

bool qsdolfinx::has_outside(const Polygon& p, std::span<const Vec2> points)
{
  if (is_interval(p))
  {
    const double tolerance = outside_tolerance * (p[1][0] - p[0][0]);
    const double low = p[0][0] + tolerance, high = p[1][0] - tolerance;
    return std::ranges::all_of(points, [&](const Vec2& q) { return q[0] <= low; })
           || std::ranges::all_of(points, [&](const Vec2& q) { return q[0] >= high; });
  }
  for (std::size_t i = 0; i < p.size(); ++i)
  {
    const Vec2 &a = p[i], t = p[i + 1 < p.size() ? i + 1 : 0] - a;
    const double tolerance = outside_tolerance * (t[0] * t[0] + t[1] * t[1]);
    if (std::ranges::all_of(points, [&](const Vec2& q) { return cross(t, q - a) <= tolerance; }))
      return true;
  }
  return false;
}

Frame::Frame(FacetType type, std::span<const double> v)
{
  const Vec3 area = area_vector(type, v, facet_centre(type));
  normal = (1 / norm(area)) * area;
  origin = facet_point(type, v, facet_centre(type));
  const Vec3 t = facet_vertex(v, 1) - facet_vertex(v, 0);
  const Vec3 across = t - dot(t, normal) * normal;
  e0 = (1 / norm(across)) * across;
  e1 = type == FacetType::interval ? Vec3{0, 0, 0} : cross(normal, e0);
}

Vec2 Frame::project(const Vec3& x) const { return {dot(e0, x - origin), dot(e1, x - origin)}; }

Triangles::Triangles(const Polygon& p, bool from_middle)
{
  using Corner = std::uint8_t;
  around.resize(p.size());
  std::iota(around.begin(), around.end(), Corner{0});
  if (is_interval(p))
  {
    corner.push_back({0, 1, 0});
    return;
  }
  const auto area
      = [&](Corner a, Corner b, Corner c) { return 0.5 * cross(p[b] - p[a], p[c] - p[a]); };
  const double least = ear_area * measure(p);
  while (around.size() > 3)
  {
    const std::size_t n = around.size();
    std::array<Corner, 3> smallest{};
    double smallest_area = least;
    for (std::size_t k = 0; k < n; ++k)
    {
      const std::array<Corner, 3> ear{around[(k + n - 1) % n], around[k], around[(k + 1) % n]};
      if (const double a = area(ear[0], ear[1], ear[2]); a < smallest_area)
      {
        smallest_area = a;
        smallest = ear;
      }
    }
    if (smallest_area >= least)
      break;
    if (smallest_area > 0) // otherwise vertices coincide up to rounding
      corner.push_back(smallest);
    around.erase(std::ranges::find(around, smallest[1]));
  }
  double whole = 0;
  for (std::size_t k = 1; k + 1 < around.size(); ++k)
  {
    const std::array<Corner, 3> part{around[0], around[k], around[k + 1]};
    const double a = area(part[0], part[1], part[2]);
    middle = middle + (a / 3) * (p[part[0]] + p[part[1]] + p[part[2]]);
    whole += a;
    if (!from_middle && a > 0)
      corner.push_back(part);
  }
  if (whole <= 0)
    return;
  middle = (1 / whole) * middle;
  const auto last = static_cast<Corner>(p.size());
  for (std::size_t k = 0; from_middle && k < around.size(); ++k)
  {
    const Corner b = around[k], c = around[(k + 1) % around.size()];
    if (cross(p[b] - middle, p[c] - middle) > 0)
      corner.push_back({last, b, c});
  }
}

void qsdolfinx::append_points_from_middle(const Polygon& p, const Rule& rule, std::vector<Vec2>& x,
                                          std::vector<double>& w)
{
  if (is_interval(p))
    return append_points(p, rule, x, w);
  Vec2 middle{0, 0}; // centroid of the area: coinciding corners may appear or vanish
  double area = 0;
  for (std::size_t k = 1; k + 1 < p.size(); ++k)
  {
    const double part = 0.5 * cross(p[k] - p[0], p[k + 1] - p[0]);
    middle = middle + (part / 3) * (p[0] + p[k] + p[k + 1]);
    area += part;
  }
  if (area <= 0)
    return;
  middle = (1 / area) * middle;
  for (std::size_t k = 0; k < p.size(); ++k)
    append_points(Polygon{middle, p[k], p[(k + 1) % p.size()]}, rule, x, w);
}

void qsdolfinx::append_points(const Polygon& p, const Rule& rule, std::vector<Vec2>& x,
                              std::vector<double>& w)
{
  if (is_interval(p))
  {
    const Vec2 t = p[1] - p[0];
    for (std::size_t i = 0; i < rule.w.size(); ++i)
    {
      x.push_back(p[0] + rule.x[i][0] * t);
      w.push_back(rule.w[i] * t[0]);
    }
    return;
  }
  for (std::size_t k = 1; k + 1 < p.size(); ++k)
  {
    const Vec2 s = p[k] - p[0], t = p[k + 1] - p[0];
    const double area = 0.5 * cross(s, t);
    if (area <= 0) // vertices that coincide but for rounding
      continue;
    for (std::size_t i = 0; i < rule.w.size(); ++i)
    {
      x.push_back(p[0] + rule.x[i][0] * s + rule.x[i][1] * t);
      w.push_back(rule.w[i] * area);
    }
  }
}

PlanarFacet::PlanarFacet(FacetType type, std::span<const double> v, const Frame& frame)
    : type_(type)
{
  const int nv = static_cast<int>(type);
  std::array<Vec2, 4> q{};
  for (int i = 0; i < nv; ++i)
    q[i] = frame.project(facet_vertex(v, i));
  x0_ = q[0];
  a_ = q[1] - q[0];
  if (type == FacetType::interval)
  {
    polygon_ = {q[0], q[1]};
    reversed_ = a_[0] < 0;
    if (reversed_)
      std::swap(polygon_[0], polygon_[1]);
    polygon_[0][1] = polygon_[1][1] = 0;
    return;
  }
  b_ = q[2] - q[0];
  if (type == FacetType::triangle)
    polygon_ = {q[0], q[1], q[2]};
  else
  {
    c_ = q[3] - q[1] - q[2] + q[0];
    const double size = std::max(std::abs(cross(q[3] - q[0], q[2] - q[1])), 1e-300);
    affine_ = c_[0] * c_[0] + c_[1] * c_[1] <= 1e-26 * size;
    if (affine_)
      c_ = {0, 0};
    polygon_ = {q[0], q[1], q[3], q[2]};
    // The Jacobian is linear in ξ and in η, so that its extreme values are at the corners.
    const auto [low, high] = std::minmax(
        {cross(a_, b_), cross(a_, b_ + c_), cross(a_ + c_, b_), cross(a_ + c_, b_ + c_)});
    unfolded_ = low > fold_tolerance * high || high < fold_tolerance * low;
  }
  reversed_ = measure(polygon_) < 0;
  if (reversed_)
    polygon_.reverse();
}

std::int8_t PlanarFacet::vertex(std::size_t corner) const
{
  constexpr std::array<std::int8_t, 4> of_quadrilateral{0, 1, 3, 2};
  const std::size_t at = reversed_ ? polygon_.size() - 1 - corner : corner;
  return type_ == FacetType::quadrilateral ? of_quadrilateral[at] : static_cast<std::int8_t>(at);
}

namespace
{
/// Side of a clipped polygon: a side of the clipped facet a, or of the clipping facet b.
struct Side
{
  bool of_b;
  std::size_t number;
};

/// A corner, and the side that starts at it.
struct Clipped
{
  CornerSource corner;
  Side side;
};

/// Intersection of a side with a side of b. @param p position of the intersection
CornerSource crossing(const PlanarFacet& a, const PlanarFacet& b, const Side& side,
                      std::size_t line, const Vec2& p)
{
  const std::size_t n = b.polygon().size(), next = (line + 1) % n;
  CornerSource out{p};
  if (!side.of_b)
  {
    const std::size_t m = a.polygon().size();
    out.a = {a.vertex(side.number), a.vertex((side.number + 1) % m)};
    out.b = {b.vertex(line), b.vertex(next)};
    return out;
  }
  const std::int8_t vertex = b.vertex(side.number == next ? next : line); // common vertex
  out.b = {vertex, vertex};
  return out;
}
} // namespace

void qsdolfinx::sources_of_intersection(const PlanarFacet& a, const PlanarFacet& b, bool b_first,
                                        std::vector<CornerSource>& out)
{
  const Polygon &first = a.polygon(), &second = b.polygon();
  const auto of_a
      = [&](std::size_t i) -> CornerSource { return {first[i], {a.vertex(i), a.vertex(i)}}; };
  out.clear();
  if (is_interval(second))
  {
    const auto of_b = [&](std::size_t i) -> CornerSource
    { return {second[i], {-1, -1}, {b.vertex(i), b.vertex(i)}}; };
    for (std::size_t i : {0, 1})
    {
      const double within = (i == 0 ? 1 : -1) * (second[i][0] - first[i][0]);
      out.push_back(within > 0 || (within == 0 && b_first) ? of_b(i) : of_a(i));
    }
    return;
  }
  std::vector<Clipped> in, cut;
  for (std::size_t i = 0; i < first.size(); ++i)
    in.push_back({of_a(i), {false, i}});
  for (std::size_t line = 0; line < second.size() && !in.empty(); ++line)
  {
    const Beside beside(second[line], second[(line + 1) % second.size()]);
    const Side along{true, line};
    cut.clear();
    for (std::size_t i = 0; i < in.size(); ++i)
    {
      const Clipped &p = in[i], &q = in[i + 1 < in.size() ? i + 1 : 0];
      const double dp = beside(p.corner.q), dq = beside(q.corner.q);
      if (dp >= 0)
        cut.push_back({p.corner, dp == 0 && dq < 0 ? along : p.side});
      if ((dp > 0 && dq < 0) || (dp < 0 && dq > 0))
      {
        const Vec2 at = p.corner.q + (dp / (dp - dq)) * (q.corner.q - p.corner.q);
        cut.push_back({crossing(a, b, p.side, line, at), dq < 0 ? along : p.side});
      }
    }
    std::swap(in, cut);
  }
  for (const Clipped& each : in)
    out.push_back(each.corner);
}

Vec2 PlanarFacet::invert(const Vec2& q) const
{
  if (type_ == FacetType::interval)
    return {(q[0] - x0_[0]) / a_[0], 0};
  const Vec2 d = q - x0_;
  Vec2 xi{0.5, 0.5};
  for (int i = 0; i < inverse_max_iterations; ++i)
  {
    const Vec2 r = d - xi[0] * a_ - xi[1] * b_ - (xi[0] * xi[1]) * c_;
    const Vec2 s = a_ + xi[1] * c_, t = b_ + xi[0] * c_;
    const double det = cross(s, t);
    const Vec2 step{cross(r, t) / det, cross(s, r) / det};
    xi = xi + step;
    if (affine_ || std::abs(step[0] * step[1]) < inverse_tolerance) // times c: the error
      break;
  }
  return xi;
}

double PlanarFacet::jacobian(const Vec2& xi) const
{
  if (type_ == FacetType::interval)
    return std::abs(a_[0]);
  return std::abs(cross(a_ + xi[1] * c_, b_ + xi[0] * c_));
}

std::array<double, 4> PlanarFacet::integrals(const Polygon& p, const Rule& edge) const
{
  // N_i J = f(ξ) g(η) (j0 + j1 ξ + j2 η); the integral over ξ from 0 is a polynomial, and the
  // integral of this polynomial over η along the boundary is the result.
  const double j0 = cross(a_, b_), j1 = cross(a_, c_), j2 = cross(c_, b_);
  std::array<double, 4> out{};
  for (std::size_t k = 0; k < p.size(); ++k)
  {
    const Vec2 t = p[(k + 1) % p.size()] - p[k];
    for (std::size_t i = 0; i < edge.w.size(); ++i)
    {
      const auto [s, e] = invert(p[k] + edge.x[i][0] * t);
      const double j = j0 + j1 * s + j2 * e;
      const double deta = edge.w[i] * cross(a_ + e * c_, t) / j;
      const double h = j0 + j2 * e, s2 = s * s / 2, s3 = s * s * s / 3;
      const double f0 = h * (s - s2) + j1 * (s2 - s3), f1 = h * s2 + j1 * s3;
      out[0] += deta * f0 * (1 - e);
      out[1] += deta * f1 * (1 - e);
      out[2] += deta * f0 * e;
      out[3] += deta * f1 * e;
    }
  }
  // If the map reverses the orientation, the boundary runs in the other direction and J is -|J|:
  // the result does not change.
  return out;
}
