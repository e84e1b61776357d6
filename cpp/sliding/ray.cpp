#include "sliding/ray.h"
#include "geometry/outer.h"
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

/// w p at a ray; for a ray to a curved surface also its slopes by ζ, and their derivatives, times
/// w p.
struct Pressure
{
  explicit Pressure(double constant) : value(constant) {}

  Pressure(double constant, const RayLift& lift)
      : value(constant), slope{constant * lift.slope[0], constant * lift.slope[1]},
        mixed(constant * 0.5 * (lift.bending[0][1] + lift.bending[1][0])),
        bent{constant * lift.bending[0][0], constant * lift.bending[1][1]}
  {
  }

  double value = 0;
  Vec2 slope{};
  double mixed = 0; ///< mean of both derivatives of a slope by the other coordinate
  Vec2 bent{};      ///< derivatives of the slopes by their own coordinates
};

/// c·∂²x_z/∂ζ², [∂₁∂₁, ∂₁∂₂, ∂₂∂₂].
Vec3 bending(const RayFacet& z, const Vec2& zeta, const Vec3& c)
{
  Vec3 out{};
  if (z.degree == 1 && z.type != FacetType::quadrilateral)
    return out;
  const Vec3 origin = facet_vertex(z.x, 0);
  const auto ddM = trace_curvatures(z.type, z.degree, zeta);
  for (int j = 0; j < z.num_nodes(); ++j)
    add(out.data(), dot(c, facet_vertex(z.x, j) - origin), ddM[j]);
  return out;
}

/// Variations of the length of a ray and of its end.
struct RayForms
{
  RayForms(const Ray& ray, const Columns& columns, const Normal& normal, int dim)
      : dt(ray.form(columns, normal, ray.A.t)), first(ray.form(columns, normal, ray.A.zeta[0])),
        second(dim == 2 ? ray.form(columns, normal, ray.A.zeta[1]) : Row{})
  {
  }

  Row dt, first, second;
};

/// Virtual work of friction at a ray, Σ_α s_α δζ_α: work of the tractions on the sliding of the
/// end.
struct Sliding
{
  Sliding(const RayPair& pair, const Ray& ray, const Vec3& traction)
      : weight_((pair.cut_is_slave ? 1 : -1) * ray.weight), traction_(traction)
  {
    for (int d = 0; d < 2; ++d)
      s[d] = weight_ * dot(traction_, ray.a[d]);
  }

  /// The variation of s_α.
  Row variation(int alpha, const RayPair& pair, const Ray& ray, const RayPoint& point,
                const RayForms& forms, const Columns& columns) const
  {
    const auto [h11, h12, h22] = bending(pair.other, point.zeta, traction_);
    const Vec2 by_zeta = alpha == 0 ? Vec2{h11, h12} : Vec2{h12, h22};
    Row out{};
    for (int b = 0; b < columns.size(); ++b)
      out[b] = by_zeta[0] * forms.first[b] + by_zeta[1] * forms.second[b];
    for (int j = 0; j < columns.num_other; ++j)
      add(&out[3 * (columns.other + j)], ray.dM[j][alpha], traction_);
    for (double& value : out)
      value *= weight_;
    return out;
  }

  Vec2 s{};

private:
  double weight_;
  Vec3 traction_;
};

/// Assembles second derivatives as a matrix whose sum with its transpose gives them.
class HalfHessian
{
public:
  explicit HalfHessian(const Rays& rays)
      : pair_(rays.pair), normal_(rays.normal), columns_(rays.columns), n_(columns_.size()),
        dim_(dim_of(pair_))
  {
    std::fill_n(half_.begin(), n_ * n_, 0.0);
    for (auto* rows : {&left_, &right_})
      rows->reserve(rays.points.size() * static_cast<std::size_t>(dim_ * n_));
  }

  /// Add the terms of w p g with δζ, and the sums needed for the terms with δn.
  void add_point(const RayPoint& point, const Ray& ray, const Pressure& L)
  {
    const RayForms forms(ray, columns_, normal_, dim_);
    add_second_variation(ray, point.zeta, forms, ray.of_gap(L.value, L.slope), L);
  }

  /// Add the same terms of Σ_α s_α δζ_α + s_t δt for constant factors.
  void add_point(const RayPoint& point, const Ray& ray, const RayForms& forms, const Vec2& s,
                 double s_t = 0)
  {
    const Vec3 c = s[0] * ray.A.zeta[0] + s[1] * ray.A.zeta[1] + s_t * ray.A.t;
    add_second_variation(ray, point.zeta, forms, c, Pressure(0));
  }

  /// Add the products of all points, and the terms with δn and ∂²n, which all points share: with
  /// C = Σ t c, C·∂²n = (C − n (n·C))·∂²s/|s| − ((C·δn)(n·Δs) + (C·Δn)(n·δs))/|s| − (C·n) δn·Δn.
  void add_sums()
  {
    const auto n = static_cast<std::size_t>(n_);
    add_outer_products(left_, right_, {}, n, n, half_.data(), n);
    const int first = 3 * columns_.along, count = 3 * normal_.num_vertices();
    Row area{};
    normal_.add_area(normal_.n(), &area[first]);
    for (int r = 0; r < 3; ++r)
    {
      Row dn{};
      Vec3 axis{};
      axis[r] = 1;
      normal_.add_to(axis, &dn[first]);
      const double turn = 0.5 * dot(lever_, normal_.n()), stretch = lever_[r] / normal_.length();
      for (int b = first; b < first + count; ++b)
        with_normal_[r][b] -= turn * dn[b] + stretch * area[b];
      for (int a = first; a < first + count; ++a)
        for (int b = 0; b < n_; ++b)
          half_[a * n_ + b] += dn[a] * with_normal_[r][b];
    }
    normal_.add_half_curvature(normal_.across(lever_), &half_[first * n_ + first], n_);
  }

  void add_to(std::span<double> hessian) const
  {
    for (int a = 0; a < n_; ++a)
      for (int b = 0; b < n_; ++b)
        hessian[a * n_ + b] += half_[a * n_ + b] + half_[b * n_ + a];
  }

private:
  /// @param c the first variation is c·v: (t₂, ζ₂) = A [..] enters as c·[..]
  /// @param L further dependence on ζ: `mixed` and `bent` multiply δζ_α δζ_β
  void add_second_variation(const Ray& ray, const Vec2& zeta, const RayForms& forms, const Vec3& c,
                            const Pressure& L)
  {
    const auto& [dt, first, second] = forms;
    const auto [h11, h12, h22] = bending(pair_.other, zeta, c);
    Row with_first, with_second;
    for (int b = 0; b < n_; ++b)
    {
      with_first[b] = (L.mixed - h12) * second[b] + 0.5 * (L.bent[0] - h11) * first[b];
      with_second[b] = 0.5 * (L.bent[1] - h22) * second[b];
    }
    for (int j = 0; j < columns_.num_other; ++j)
    {
      const int b = 3 * (columns_.other + j);
      add(&with_first[b], -ray.dM[j][0], c);
      add(&with_second[b], -ray.dM[j][1], c);
    }
    add_product(first, with_first);
    if (dim_ == 2)
      add_product(second, with_second);

    lever_ = lever_ + ray.t * c;
    for (int r = 0; r < 3; ++r)
      for (int b = 0; b < n_; ++b)
        with_normal_[r][b] += c[r] * dt[b];
  }

  /// Store a product until all points have been added.
  void add_product(const Row& left, const Row& right)
  {
    left_.insert(left_.end(), left.begin(), left.begin() + n_);
    right_.insert(right_.end(), right.begin(), right.begin() + n_);
  }

  const RayPair& pair_;
  const Normal& normal_;
  const Columns& columns_;
  int n_, dim_;
  Vec3 lever_{};
  std::array<Row, 3> with_normal_{};
  std::array<double, max_columns * max_columns> half_;
  std::vector<double> left_, right_; ///< products of points
};
} // namespace

namespace
{
/// The variation of Σ_α slope_α A_ζα·τ for constant slopes and τ. As A = J⁻¹, δA = −A δJ A.
Row change_along(const RayPair& pair, const Normal& normal, const Columns& columns, const Ray& ray,
                 const RayPoint& point, const RayForms& forms, const Vec2& slope, const Vec3& tau)
{
  Row out{};
  for (int alpha = 0; alpha < 2; ++alpha)
  {
    const Vec3 c = slope[alpha] * ray.A.zeta[alpha];
    const auto [h11, h12, h22] = bending(pair.other, point.zeta, c);
    const Vec2 along{dot(ray.A.zeta[0], tau), dot(ray.A.zeta[1], tau)};
    const Vec2 by_zeta{along[0] * h11 + along[1] * h12, along[0] * h12 + along[1] * h22};
    for (int b = 0; b < columns.size(); ++b)
      out[b] -= by_zeta[0] * forms.first[b] + by_zeta[1] * forms.second[b];
    for (int j = 0; j < columns.num_other; ++j)
      add(&out[3 * (columns.other + j)], -along[0] * ray.dM[j][0] - along[1] * ray.dM[j][1], c);
    normal.add_to(dot(ray.A.t, tau) * c, &out[3 * columns.along]);
  }
  return out;
}

void add_outer(const Row& rows, const Row& columns, int n, double factor, std::span<double> matrix)
{
  for (int a = 0; a < n; ++a)
    for (int b = 0; b < n; ++b)
      matrix[a * n + b] += factor * rows[a] * columns[b];
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
void qsdolfinx::gap_gradients(const Rays& rays, std::span<double> out, std::span<double> slopes,
                              bool raised)
{
  const auto& [pair, points, normal, columns, all] = rays;
  const auto size = static_cast<std::size_t>(columns.size());
  std::ranges::fill(out, 0.0);
  for (std::size_t p = 0; p < points.size(); ++p)
  {
    const Ray& ray = all[p];
    const Vec2 slope = raised ? lift_of(pair, points[p].zeta).slope : Vec2{};
    ray.add_form(columns, normal, ray.of_gap(1, slope), &out[p * size]);
    if (slopes.empty())
      continue;
    const auto along = tangents_at(pair.cut, points[p].xi);
    for (int a = 0; a < 2; ++a)
      slopes[2 * p + a] = -dot(ray.A.t, along[a]);
  }
}

void qsdolfinx::slave_places(const Rays& rays, std::span<double> gradients,
                             std::span<double> slopes)
{
  const auto& [pair, points, normal, columns, all] = rays;
  std::ranges::fill(gradients, 0.0);
  const auto size = static_cast<std::size_t>(columns.size());
  for (std::size_t p = 0; p < points.size(); ++p)
  {
    double* slope = &slopes[4 * p];
    if (pair.cut_is_slave)
    {
      std::ranges::copy(std::array<double, 4>{1, 0, 0, 1}, slope);
      continue;
    }
    const Ray& ray = all[p];
    const auto along = tangents_at(pair.cut, points[p].xi);
    for (std::size_t i = 0; i < 2; ++i)
    {
      ray.add_form(columns, normal, ray.A.zeta[i], &gradients[(2 * p + i) * size]);
      for (std::size_t a = 0; a < 2; ++a)
        slope[2 * i + a] = dot(ray.A.zeta[i], along[a]);
    }
  }
}

QSDOLFINX_FOR_PROCESSORS
void qsdolfinx::add_curvature_of_points(const Rays& rays, std::span<const double> pressure,
                                        std::span<double> hessian)
{
  HalfHessian half(rays);
  for (std::size_t p = 0; p < rays.points.size(); ++p)
  {
    const RayPoint& point = rays.points[p];
    if (pressure[p] == 0)
      continue;
    const RayLift lift = lift_of(rays.pair, point.zeta);
    half.add_point(point, rays.all[p], {point.weight * pressure[p], lift});
    const double twist = 0.5 * (lift.bending[0][1] - lift.bending[1][0]);
    if (twist == 0)
      continue;
    const int n = rays.columns.size();
    RayForms forms(rays.all[p], rays.columns, rays.normal, dim_of(rays.pair));
    add_outer(forms.first, forms.second, n, point.weight * pressure[p] * twist, hessian);
    add_outer(forms.second, forms.first, n, -point.weight * pressure[p] * twist, hessian);
  }
  half.add_sums();
  half.add_to(hessian);
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
  template <int stride>
  void add_to(const Normal& normal, const Vec3& c, const Vec2& s, double* row) const
  {
    // c·δe₁ = k·δd₁ with k = (c − e₁ (e₁·c))/|d₁|, and c·δe₂ = c·(δn × e₁) + c·(n × δe₁).
    const Vec3 with_first = s[0] * c + s[1] * cross(c, n);
    const Vec3 k = 1 / length * (with_first - dot(e[0], with_first) * e[0]);
    add(row, -1, k);
    add(row + stride, 1, k);
    normal.add_to<stride>(s[1] * cross(e[0], c), row);
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
  const auto size = static_cast<std::size_t>(3 * columns.size());
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
    double *gradient = &out.gradient[p * size], *work = &out.works[p * size];
    for (int r = 0; r < 3; ++r)
    {
      Vec3 axis{};
      axis[r] = 1;
      ray.add_to(columns, slides[r], gradient + 3 * r, 9);
      normal.add_to<9>(ray.t * slides[r], gradient + 9 * columns.along + 3 * r);
      now.add_to<9>(normal, axis, s, gradient + 9 * columns.along + 3 * r);
      ray.add_to(columns, works[r], work + 3 * r, 9);
      normal.add_to<9>(ray.t * works[r], work + 9 * columns.along + 3 * r);
    }
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

void qsdolfinx::add_slip_curvature_of_points(const Rays& rays, std::span<const double> traction,
                                             std::span<double> hessian)
{
  const auto& [pair, points, normal, columns, all] = rays;
  const int dim = dim_of(pair), n = columns.size();
  HalfHessian half(rays);
  for (std::size_t p = 0; p < points.size(); ++p)
  {
    const Vec3 tau = facet_vertex(traction, static_cast<int>(p));
    if (dot(tau, tau) == 0)
      continue;
    const RayPoint& point = points[p];
    const Ray& ray = all[p];
    const RayForms forms(ray, columns, normal, dim);
    const Sliding sliding(pair, ray, tau);
    const RayLift lift = lift_of(pair, point.zeta);
    const double w = (pair.cut_is_slave ? 1 : -1) * ray.weight;
    const Vec2 up{w * dot(tau, ray.A.zeta[0]), w * dot(tau, ray.A.zeta[1])};
    half.add_point(point, ray, forms, sliding.s, up[0] * lift.slope[0] + up[1] * lift.slope[1]);
    if (pair.is_raised())
    {
      const auto& [b1, b2] = lift.bending;
      Row steeper = change_along(pair, normal, columns, ray, point, forms, lift.slope, w * tau);
      for (int b = 0; b < n; ++b)
        steeper[b] += (up[0] * b1[0] + up[1] * b2[0]) * forms.first[b]
                      + (up[0] * b1[1] + up[1] * b2[1]) * forms.second[b];
      add_outer(forms.dt, steeper, n, 1, hessian);
    }
    for (int alpha = 0; alpha < dim; ++alpha)
      add_outer(alpha == 0 ? forms.first : forms.second,
                sliding.variation(alpha, pair, ray, point, forms, columns), n, 1, hessian);
    // τ stays in the plane of the facet: n·δτ = −τ·δn.
    const Vec2 across = Sliding(pair, ray, normal.n()).s;
    const Row works
        = ray.form(columns, normal, across[0] * ray.A.zeta[0] + across[1] * ray.A.zeta[1]);
    Row turn{};
    normal.add_to(-1 * tau, &turn[3 * columns.along]);
    add_outer(works, turn, n, 1, hessian);
  }
  half.add_sums();
  half.add_to(hessian);
}
