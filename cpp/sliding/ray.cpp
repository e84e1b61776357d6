#include "sliding/ray.h"
#include "geometry/processors.h"
#include "sliding/forms.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

using namespace qsdolfinx;
using namespace qsdolfinx::forms;

namespace
{
/// Solve for the end of a ray by Newton's method, in one step if the other facet is flat and
/// straight. The error after the last step is of the order of the square of this step.
bool solve(const RayPair& pair, const Vec3& n, RayPoint& point)
{
  constexpr int most = 20;
  constexpr double last = 1e-9;
  const RayFacet& z = pair.other;
  const bool plane = z.type == FacetType::interval;
  const bool affine = z.degree == 1 && z.type != FacetType::quadrilateral;
  const Vec3 origin = facet_vertex(pair.cut.x, 0);
  const Vec3 p = point_of(pair.cut, origin, point.xi);
  Vec2 zeta = point.zeta;
  for (int i = 0; i < most; ++i)
  {
    const Inverse A(n, tangents(z, origin, trace_gradients(z.type, z.degree, zeta)), plane);
    const Vec3 v = p - point_of(z, origin, zeta);
    const double t = dot(A.t, v);
    const Vec2 step{dot(A.zeta[0], v), dot(A.zeta[1], v)};
    zeta = {zeta[0] + step[0], zeta[1] + step[1]};
    const double length = std::hypot(step[0], step[1]);
    if (!std::isfinite(length + t))
      break;
    if (affine || length < last)
    {
      point.zeta = zeta;
      point.t = t;
      return true;
    }
  }
  point.t = std::numeric_limits<double>::quiet_NaN();
  return false;
}

} // namespace

bool qsdolfinx::solve_rays(const RayPair& pair, std::span<RayPoint> points)
{
  const Vec3 n = Normal(pair.along()).n();
  bool found = true;
  for (RayPoint& point : points)
    found = solve(pair, n, point) && found;
  return found;
}

Vec3 qsdolfinx::normal_of(const RayPair& pair)
{
  return (pair.cut_is_slave ? 1.0 : -1.0) * Normal(pair.along()).n();
}

void qsdolfinx::normal_gradient(const RayPair& pair, std::span<double> out)
{
  const Normal normal(pair.along());
  const Columns columns(pair);
  const auto size = static_cast<std::size_t>(columns.size());
  std::ranges::fill(out, 0.0);
  for (std::size_t r = 0; r < 3; ++r)
  {
    Vec3 axis{};
    axis[r] = pair.cut_is_slave ? 1 : -1;
    normal.add_to(axis, &out[r * size + 3 * static_cast<std::size_t>(columns.along)]);
  }
}

QSDOLFINX_FOR_PROCESSORS
void qsdolfinx::gap_gradients(const Rays& rays, std::span<double> out)
{
  const auto& [pair, points, normal, columns, all] = rays;
  const auto size = static_cast<std::size_t>(columns.size());
  std::ranges::fill(out, 0.0);
  for (std::size_t p = 0; p < points.size(); ++p)
  {
    const Vec2 slope = lift_of(pair, points[p].zeta).slope;
    all[p].add_form(columns, normal, all[p].of_gap(1, slope), &out[p * size]);
  }
}

namespace
{
/// Unit vectors e₁ along the first edge of a facet, and e₂ = n × e₁.
struct Frame
{
  Frame(const RayFacet& facet, const Vec3& normal)
      : n(normal), edge(facet_vertex(facet.x, 1) - facet_vertex(facet.x, 0)), length(norm(edge)),
        e{1 / length * edge, cross(normal, 1 / length * edge)}
  {
  }

  /// Add the gradient of c·(s₁ e₁ + s₂ e₂) by the nodes of the facet, s constant.
  void add_to(const Normal& normal, const Vec3& c, const Vec2& s, double* row) const
  {
    // c·δe₁ = k·δd₁ with k = (c − e₁ (e₁·c))/|d₁|, and c·δe₂ = c·(δn × e₁) + c·(n × δe₁).
    const Vec3 with_first = s[0] * c + s[1] * cross(c, n);
    const Vec3 k = 1 / length * (with_first - dot(e[0], with_first) * e[0]);
    add(row, -1, k);
    add(row + 3, 1, k);
    normal.add_to(s[1] * cross(e[0], c), row);
  }

  Vec3 n, edge;
  double length;
  std::array<Vec3, 2> e;
};

/// Unit vectors along the first edge of a facet in its plane, and across it.
struct PlaneFrame
{
  explicit PlaneFrame(const RayFacet& facet, const Vec3& normal)
      : n(normal), edge(facet_vertex(facet.x, 1) - facet_vertex(facet.x, 0)), rise(dot(n, edge)),
        length(norm(edge - rise * n)), first(1 / length * (edge - rise * n)),
        second(cross(n, first))
  {
  }

  Vec3 n, edge;
  double rise, length; ///< of the edge along n, and in the plane
  Vec3 first, second;
};

/// Vectors in the plane of a facet across its normal n, rotated to the tangent plane at one of its
/// points. Gaps along the normal m there are then no slip, on curved facets, too.
struct Across
{
  Across(const std::array<Vec3, 2>& in_plane, const Vec3& n, const RayFacet& facet, const Vec2& at)
      : e(in_plane)
  {
    if (facet.degree == 1 && facet.type != FacetType::quadrilateral)
      return; // m = n
    const Vec3 origin = facet_vertex(facet.x, 0);
    const auto a = tangents_at(facet, at);
    const Vec3 area = facet.orientation * cross(a[0], a[1]);
    const Vec3 m = 1 / norm(area) * area, sum = n + m;
    const double both = 1 + dot(n, m);
    for (int k = 0; k < 2; ++k)
      e[k] = in_plane[k] - dot(in_plane[k], m) / both * sum;
    const auto ddM = trace_curvatures(facet.type, facet.degree, at);
    std::array<Vec3, 3> bent{}; // [∂₁∂₁, ∂₁∂₂, ∂₂∂₂]
    for (int j = 0; j < facet.num_nodes(); ++j)
      for (int k = 0; k < 3; ++k)
        add(bent[k].data(), ddM[j][k], facet_vertex(facet.x, j) - origin);
    for (int alpha = 0; alpha < 2; ++alpha)
    {
      const Vec3 change = facet.orientation / norm(area)
                          * (cross(bent[alpha], a[1]) + cross(a[0], bent[alpha + 1]));
      const Vec3 dm = change - dot(m, change) * m;
      for (int k = 0; k < 2; ++k)
      {
        const double part = dot(in_plane[k], m) / both;
        slope[alpha][k] = (part * dot(n, dm) - dot(in_plane[k], dm)) / both * sum - part * dm;
      }
    }
  }

  std::array<Vec3, 2> e;
  std::array<std::array<Vec3, 2>, 2> slope{}; ///< derivatives by the coordinates on the facet, [α]
};

RayFacet moved_to(const RayFacet& facet, std::span<const double> x)
{
  return {facet.type, facet.degree, x, facet.orientation};
}

/// Largest angle of rotation; larger ones cannot be distinguished from rotations in the other
/// direction.
constexpr double most_turned = 2.6;

/// θ/sin θ for facets that have rotated against each other by θ. This angle is found from the
/// normal of one facet in the frame of the other facet, when slip began and now.
double arc_of_turn(const Frame& then, const Vec3& other_then, const Frame& now,
                   const Vec3& other_now)
{
  const double c = dot(then.e[0], other_then) * dot(now.e[0], other_now)
                   + dot(then.e[1], other_then) * dot(now.e[1], other_now)
                   + dot(then.n, other_then) * dot(now.n, other_now);
  const double theta = std::min(std::acos(std::clamp(c, -1.0, 1.0)), most_turned);
  return theta > 1e-4 ? theta / std::sin(theta) : 1.0;
}
} // namespace

void qsdolfinx::slip_of_points(const Rays& rays, const RayStart& start, const RaySlip& out)
{
  const auto& [pair, points, normal, columns, all] = rays;
  const RayFacet cut = moved_to(pair.cut, start.cut), other = moved_to(pair.other, start.other);
  const RayFacet along = moved_to(pair.along(), pair.along_other ? start.other : start.cut);
  const Vec3 n_then = Normal(along).n();
  const Frame now(pair.along(), normal.n()), then(along, n_then);
  // Edges of facets that are not flat have components along n; they are removed, since gaps are no
  // slip.
  const std::array<Vec3, 2> in_plane{then.e[0] - dot(then.e[0], n_then) * n_then,
                                     then.e[1] - dot(then.e[1], n_then) * n_then};
  const int dim = pair.other.type == FacetType::interval ? 1 : 2;
  const double sign = pair.cut_is_slave ? 1 : -1;
  const Vec3 origin = facet_vertex(cut.x, 0);
  // A vertex slides along the facet whose frame is used.
  std::ranges::fill(
      out.arc,
      pair.along_other ? 1.0 : arc_of_turn(then, Normal(other).n(), now, Normal(pair.other).n()));
  for (std::size_t p = 0; p < points.size(); ++p)
  {
    const RayPoint& point = points[p];
    const Ray& ray = all[p];
    const Vec3 d = point_of(cut, origin, point.xi) - point_of(other, origin, point.zeta);
    const Across across(in_plane, n_then, along, pair.along_other ? point.zeta : point.xi);
    // The ray itself is no slip: s_a = −sign E_a·way, which is 0 if nothing has moved.
    const Vec3 way = d + ray.t * n_then;
    const Vec2 s{-sign * dot(across.e[0], way), dim == 2 ? -sign * dot(across.e[1], way) : 0.0};
    const Vec3 slip = s[0] * now.e[0] + s[1] * now.e[1], n = sign * normal.n();
    std::copy_n(slip.begin(), 3, out.slip.subspan(3 * p).begin());
    std::copy_n(n.begin(), 3, out.normal.subspan(3 * p).begin());
    out.gap[p] = dot(n_then, d);
    // Derivatives of s_a by t, by the place on the facet with the frame, by ζ, and by ξ with fixed
    // ζ and t.
    const auto by_t = [&](int a) { return -sign * dot(across.e[a], n_then); };
    const auto by_place
        = [&](int a, int alpha) { return -sign * dot(across.slope[alpha][a], way); };
    const auto a0 = tangents(other, origin, ray.dM);
    const auto by_zeta = [&](int a, int alpha)
    { return sign * dot(across.e[a], a0[alpha]) + (pair.along_other ? by_place(a, alpha) : 0.0); };
    const RayLift lift = lift_of(pair, point.zeta);
    const Vec3 rises = lift.slope[0] * ray.A.zeta[0] + lift.slope[1] * ray.A.zeta[1];
    const auto dT = trace_gradients(cut.type, cut.degree, point.xi);
    const auto a_cut = tangents(cut, origin, dT),
               a_now = tangents(pair.cut, facet_vertex(pair.cut.x, 0), dT);
    const auto by_xi = [&](int a, int alpha)
    {
      return -sign * dot(across.e[a], a_cut[alpha]) + (pair.along_other ? 0.0 : by_place(a, alpha));
    };
    for (int alpha = 0; alpha < dim; ++alpha)
    {
      Vec3 change{};
      for (int a = 0; a < dim; ++a)
      {
        double of_edge = by_xi(a, alpha) + by_t(a) * dot(ray.A.t, a_now[alpha]);
        for (int b = 0; b < dim; ++b)
          of_edge += by_zeta(a, b) * dot(ray.A.zeta[b], a_now[alpha]);
        change = change + of_edge * now.e[a];
      }
      std::copy_n(change.begin(), 3, out.slope.subspan(6 * p + 3 * alpha).begin());
    }
    std::array<Vec3, 3> slides{}, works{}; // forms c·v of each component
    Vec3 rising{};
    for (int a = 0; a < dim; ++a)
      rising = rising + by_t(a) * now.e[a];
    for (int r = 0; r < 3; ++r)
    {
      slides[r] = rising[r] * ray.A.t;
      works[r] = sign * rises[r] * ray.A.t; // tractions lie in the curved surface
    }
    for (int alpha = 0; alpha < dim; ++alpha)
    {
      Vec3 along_facet{};
      for (int b = 0; b < dim; ++b)
        along_facet = along_facet + by_zeta(b, alpha) * now.e[b];
      for (int r = 0; r < 3; ++r)
      {
        slides[r] = slides[r] + along_facet[r] * ray.A.zeta[alpha];
        works[r] = works[r] + sign * ray.a[alpha][r] * ray.A.zeta[alpha];
      }
    }
    std::ranges::copy(s, out.chord.subspan(2 * p).begin());
    for (std::size_t r = 0; r < 3; ++r)
    {
      std::ranges::copy(slides[r], out.slides.subspan(9 * p + 3 * r).begin());
      std::ranges::copy(works[r], out.works.subspan(9 * p + 3 * r).begin());
    }
  }
}

QSDOLFINX_FOR_PROCESSORS
void qsdolfinx::slip_rows(const Rays& rays, std::size_t point, std::span<const double> slides,
                          std::span<const double> chord, std::span<double> out)
{
  const auto& [pair, points, normal, columns, all] = rays;
  const auto n = static_cast<std::size_t>(columns.size());
  std::ranges::fill(out, 0.0);
  for (std::size_t r = 0; r < 3; ++r)
    all[point].add_form(columns, normal, facet_vertex(slides, static_cast<int>(r)), &out[r * n]);
  if (chord.empty())
    return;
  const Frame frame(pair.along(), normal.n());
  for (std::size_t r = 0; r < 3; ++r)
  {
    Vec3 axis{};
    axis[r] = 1;
    frame.add_to(normal, axis, {chord[0], chord[1]}, &out[r * n + 3 * columns.along]);
  }
}

void qsdolfinx::turn_since(const RayPair& pair, const RayStart& start, std::span<double> out)
{
  const RayFacet facet = pair.along(),
                 before = moved_to(facet, pair.along_other ? start.other : start.cut);
  const PlaneFrame now(facet, Normal(facet).n()), then(before, Normal(before).n());
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c)
      out[3 * r + c]
          = now.n[r] * then.n[c] + now.first[r] * then.first[c] + now.second[r] * then.second[c];
}

void qsdolfinx::spin_gradient(const RayPair& pair, std::span<double> out)
{
  const Normal normal(pair.along());
  const PlaneFrame frame(pair.along(), normal.n());
  const Vec3 by_edge = 1 / frame.length * frame.second;
  std::ranges::fill(out, 0.0);
  double* row = &out[3 * static_cast<std::size_t>(Columns(pair).along)];
  add(row, -1, by_edge);
  add(row + 3, 1, by_edge);
  normal.add_to(-frame.rise * by_edge, row);
}
