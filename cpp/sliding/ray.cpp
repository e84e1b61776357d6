#include "sliding/ray.h"
#include "geometry/outer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

using namespace qsdolfinx;

// With p = x_y(ξ) on the facet y that is cut, and z the other one, a ray is x_z(ζ) = p + t n. Its
// variation is J (δt, δζ) = v with J = [−n, a₁, a₂], a_α = ∂x_z/∂ζ_α, and
//
//   v = Σ T_i δy_i + t δn − Σ M_j δz_j,
//
// which vanishes for rigid motions. All first variations are linear forms c·v of v.

namespace
{
using Vec2 = std::array<double, 2>;

constexpr int max_columns = 2 * 3 * max_trace;

/// A linear form in the components of all nodes, which come first.
using Row = std::array<double, max_columns>;

void add(double* to, double s, const Vec3& a)
{
  for (int i = 0; i < 3; ++i)
    to[i] += s * a[i];
}

/// Where the columns of both facets are.
struct Columns
{
  explicit Columns(const RayPair& pair)
      : num_cut(pair.cut.num_nodes()), num_other(pair.other.num_nodes()),
        cut(pair.cut_is_slave ? 0 : num_other), other(pair.cut_is_slave ? num_cut : 0),
        along(pair.along_other ? other : cut)
  {
  }
  int size() const { return 3 * (num_cut + num_other); }

  int num_cut, num_other; ///< nodes
  int cut, other;         ///< the first node of each
  int along;              ///< of the one whose normal rays go along
};

/// Unit normal n = s/|s| of a facet, s = f d₁ × d₂, where d₁ and d₂ are sums of its vertices. In 2D
/// d₂ is the third axis.
class Normal
{
public:
  explicit Normal(const RayFacet& facet) : num_vertices_(facet.num_vertices())
  {
    const auto vertex = [&](int i) { return facet_vertex(facet.x, i); };
    const auto difference = [&](std::array<double, 4>& signs, int a, int b)
    {
      signs[a] = -1;
      signs[b] = 1;
      return vertex(b) - vertex(a);
    };
    const bool quadrilateral = facet.type == FacetType::quadrilateral;
    factor_ = quadrilateral ? 0.5 * facet.orientation : facet.orientation;
    d1_ = difference(signs1_, 0, quadrilateral ? 3 : 1);
    if (facet.type != FacetType::interval)
      d2_ = difference(signs2_, quadrilateral ? 1 : 0, 2);
    const Vec3 s = factor_ * cross(d1_, d2_);
    length_ = norm(s);
    n_ = 1 / length_ * s;
  }

  int num_vertices() const { return num_vertices_; }
  double length() const { return length_; }
  const Vec3& n() const { return n_; }

  /// (c − n (n·c)) / |s|: c·δn is its product with δs.
  Vec3 across(const Vec3& c) const { return 1 / length_ * (c - dot(n_, c) * n_); }

  /// Add the gradient of k·s for a constant k. @param to first vertex @param stride to the next one
  void add_area(const Vec3& k, double* to, int stride = 3) const
  {
    const Vec3 first = factor_ * cross(d2_, k), second = factor_ * cross(k, d1_);
    for (int i = 0; i < num_vertices_; ++i)
    {
      add(to + i * stride, signs1_[i], first);
      add(to + i * stride, signs2_[i], second);
    }
  }

  /// Add the gradient of c·n for a constant c.
  void add_to(const Vec3& c, double* to, int stride = 3) const { add_area(across(c), to, stride); }

  /// Add a matrix whose sum with its transpose is that of k·∂²s. @param to first vertex, first
  /// column @param size length of a row
  void add_half_curvature(const Vec3& k, double* to, int size) const
  {
    const Vec3 scaled = factor_ * k;
    const auto [x, y, z] = scaled;
    const std::array<Vec3, 3> K{{{0, z, -y}, {-z, 0, x}, {y, -x, 0}}};
    for (int i = 0; i < num_vertices_; ++i)
      for (int j = 0; j < num_vertices_; ++j)
        for (int r = 0; r < 3; ++r)
          add(to + (3 * i + r) * size + 3 * j, signs1_[i] * signs2_[j], K[r]);
  }

private:
  int num_vertices_;
  double factor_, length_;
  std::array<double, 4> signs1_{}, signs2_{};
  Vec3 d1_, d2_{0, 0, 1}, n_;
};

/// Rows of J⁻¹. In 2D nothing moves along the third axis: its ζ is left out.
struct Inverse
{
  Inverse(const Vec3& n, const std::array<Vec3, 2>& a, bool plane)
  {
    const Vec3 area = cross(a[0], a[1]);
    const double scale = -1 / dot(n, area);
    t = scale * area;
    zeta[0] = scale * cross(n, a[1]);
    if (!plane)
      zeta[1] = scale * cross(a[0], n);
  }

  Vec3 t;
  std::array<Vec3, 2> zeta{};
};

/// Tangents of a facet, in 2D the second one along the third axis.
std::array<Vec3, 2> tangents(const RayFacet& facet, const Vec3& origin,
                             const std::array<Vec2, max_trace>& gradients)
{
  std::array<Vec3, 2> a{};
  for (int j = 0; j < facet.num_nodes(); ++j)
  {
    const Vec3 x = facet_vertex(facet.x, j) - origin;
    for (int d = 0; d < 2; ++d)
      add(a[d].data(), gradients[j][d], x);
  }
  if (facet.type == FacetType::interval)
    a[1] = {0, 0, 1};
  return a;
}

Vec3 point_of(const RayFacet& facet, const Vec3& origin, const Vec2& xi)
{
  const auto N = trace_functions(facet.type, facet.degree, xi);
  Vec3 x{};
  for (int i = 0; i < facet.num_nodes(); ++i)
    add(x.data(), N[i], facet_vertex(facet.x, i) - origin);
  return x;
}

/// Newton's method; one step where the other facet is flat and straight. The last step leaves its
/// square behind.
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

/// What is needed at a ray that has been found.
struct Ray
{
  Ray(const RayPair& pair, const Normal& normal, const RayPoint& point)
      : T(trace_functions(pair.cut.type, pair.cut.degree, point.xi)),
        M(trace_functions(pair.other.type, pair.other.degree, point.zeta)),
        dM(trace_gradients(pair.other.type, pair.other.degree, point.zeta)),
        a(tangents(pair.other, facet_vertex(pair.other.x, 0), dM)),
        A(normal.n(), a, pair.other.type == FacetType::interval), t(point.t), weight(point.weight)
  {
  }

  /// The c of w p ∂g = c·v. @param pressure w p @param slope of w p h by ζ, see Pressure
  Vec3 of_gap(double pressure, const Vec2& slope) const
  {
    return slope[0] * A.zeta[0] + slope[1] * A.zeta[1] - pressure * A.t;
  }

  /// Add the form c·v but for the turning of the normal, which adds t c·δn.
  void add_to(const Columns& columns, const Vec3& c, double* row, int stride = 3) const
  {
    for (int i = 0; i < columns.num_cut; ++i)
      add(row + (columns.cut + i) * stride, T[i], c);
    for (int j = 0; j < columns.num_other; ++j)
      add(row + (columns.other + j) * stride, -M[j], c);
  }

  /// The form c·v.
  Row form(const Columns& columns, const Normal& normal, const Vec3& c) const
  {
    Row row;
    std::fill_n(row.begin(), columns.size(), 0.0);
    add_to(columns, c, row.data());
    normal.add_to(t * c, &row[3 * columns.along]);
    return row;
  }

  std::array<double, max_trace> T, M;
  std::array<Vec2, max_trace> dM;
  std::array<Vec3, 2> a;
  Inverse A;
  double t, weight;
};

/// The slave's vertex functions at a ray and their derivatives by ζ: none if the slave is cut.
struct Multipliers
{
  Multipliers(const RayPair& pair, const RayPoint& point)
      : N(shape_functions(pair.slave().type, pair.cut_is_slave ? point.xi : point.zeta))
  {
    if (!pair.cut_is_slave)
      dN = trace_gradients(pair.other.type, 1, point.zeta);
  }

  std::array<double, 4> N;
  std::array<Vec2, max_trace> dN{};
};

/// w p at a ray, and of a ray to a curved surface w p h with the derivatives of h by ζ.
struct Pressure
{
  explicit Pressure(double constant) : value(constant) {}

  Pressure(double constant, const RayLift& lift)
      : value(constant), slope{constant * lift.slope[0], constant * lift.slope[1]},
        mixed(constant * lift.bending[1]),
        bent{constant * lift.bending[0], constant * lift.bending[2]}
  {
  }

  double value = 0;
  Vec2 slope{};
  double mixed = 0; ///< second derivative by ζ₁ and ζ₂
  Vec2 bent{};      ///< those by ζ₁ and by ζ₂
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

/// Of a ray: variations of its length, and of where it ends.
struct RayForms
{
  RayForms(const Ray& ray, const Columns& columns, const Normal& normal, int dim)
      : dt(ray.form(columns, normal, ray.A.t)), first(ray.form(columns, normal, ray.A.zeta[0])),
        second(dim == 2 ? ray.form(columns, normal, ray.A.zeta[1]) : Row{})
  {
  }

  Row dt, first, second;
};

/// Friction's virtual work at a ray, Σ_α s_α δζ_α: tractions on what the end slides by.
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

/// Second derivatives are gathered as a matrix whose sum with its transpose they are.
class HalfHessian
{
public:
  /// @param points how many there may be
  HalfHessian(const RayPair& pair, std::size_t points)
      : pair_(pair), normal_(pair.along()), columns_(pair), n_(columns_.size()),
        dim_(pair.other.type == FacetType::interval ? 1 : 2)
  {
    std::fill_n(half_.begin(), n_ * n_, 0.0);
    for (auto* rows : {&left_, &right_})
      rows->reserve(points * static_cast<std::size_t>(dim_ * n_));
  }

  /// The terms with δζ of w p g, and the sums that those with δn need.
  void add_point(const RayPoint& point, const Pressure& L)
  {
    const Ray ray(pair_, normal_, point);
    const RayForms forms(ray, columns_, normal_, dim_);
    add_second_variation(ray, point.zeta, forms, ray.of_gap(L.value, L.slope), L);
  }

  /// The same of Σ_α s_α δζ_α + s_t δt for constant factors.
  void add_point(const RayPoint& point, const Ray& ray, const RayForms& forms, const Vec2& s,
                 double s_t = 0)
  {
    const Vec3 c = s[0] * ray.A.zeta[0] + s[1] * ray.A.zeta[1] + s_t * ray.A.t;
    add_second_variation(ray, point.zeta, forms, c, Pressure(0));
  }

  /// Sum up the points, with the terms with δn and ∂²n, which all of them share: with C = Σ t c,
  /// C·∂²n = (C − n (n·C))·∂²s/|s| − ((C·δn)(n·Δs) + (C·Δn)(n·δs))/|s| − (C·n) δn·Δn.
  void add_sums()
  {
    const auto n = static_cast<std::size_t>(n_);
    add_outer_products(left_, right_, {}, n, n, half_.data());
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
  /// @param L what else varies with ζ: mixed and bent of δζ_α δζ_β
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

  /// Keep a product until all points are known.
  void add_product(const Row& left, const Row& right)
  {
    left_.insert(left_.end(), left.begin(), left.begin() + n_);
    right_.insert(right_.end(), right.begin(), right.begin() + n_);
  }

  const RayPair& pair_;
  Normal normal_;
  Columns columns_;
  int n_, dim_;
  Vec3 lever_{};
  std::array<Row, 3> with_normal_{};
  std::array<double, max_columns * max_columns> half_;
  std::vector<double> left_, right_; ///< products of points
};
} // namespace

namespace
{
/// The facet of degree 1 with the same vertices.
RayFacet chord_of(const RayFacet& facet)
{
  const auto size = 3 * static_cast<std::size_t>(facet.num_vertices());
  return {facet.type, 1, facet.x.first(size), facet.orientation};
}

void add_outer(const Row& rows, const Row& columns, int n, std::span<double> matrix)
{
  for (int a = 0; a < n; ++a)
    for (int b = 0; b < n; ++b)
      matrix[a * n + b] += rows[a] * columns[b];
}

/// How a point of the rim moves outward; none where its ray meets no point.
std::optional<Row> motion_of(const RayPair& pair, const Normal& normal, const Columns& columns,
                             const RimPoint& at)
{
  const RayPair chords{chord_of(pair.cut), chord_of(pair.other), pair.cut_is_slave};
  RayPoint on_chord = at.point; // facets are cut as their vertices have it
  if (!solve(chords, normal.n(), on_chord))
    return {};
  return Ray(chords, normal, on_chord).form(columns, normal, -1 * at.outward);
}

/// Add the products of forces at the rim and its motions.
/// @param force the c of a force c·v at a ray, its point and the normal
template <typename F>
void add_rim_of(const RayPair& pair, std::span<const RimPoint> rim, std::span<double> hessian,
                F force)
{
  const Normal normal(pair.along());
  const Columns columns(pair);
  for (const RimPoint& at : rim)
    if (const auto motion = motion_of(pair, normal, columns, at))
    {
      const Ray ray(pair, normal, at.point);
      add_outer(ray.form(columns, normal, force(ray, at.point, normal.n())), *motion,
                columns.size(), hessian);
    }
}
} // namespace

RayLift qsdolfinx::lift_of(const RayPair& pair, const std::array<double, 2>& zeta)
{
  RayLift out;
  if (pair.rise.empty())
    return out;
  constexpr std::array<double, 4> corners{1, -1, -1, 1};
  const FacetType type = pair.other.type;
  const auto N = shape_functions(type, zeta);
  const auto dN = trace_gradients(type, 1, zeta);
  const int n = pair.other.num_vertices();
  const auto second = [&](int i, int a, int b)
  { return type == FacetType::quadrilateral && a != b ? corners[i] : 0.0; };
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
    {
      const double s = pair.rise[i * n + j];
      if (s == 0)
        continue;
      out.height += s * N[i] * N[i] * N[j];
      for (int a = 0; a < 2; ++a)
        out.slope[a] += s * N[i] * (2 * dN[i][a] * N[j] + N[i] * dN[j][a]);
      for (int k = 0; k < 3; ++k)
      {
        const int a = k / 2, b = (k + 1) / 2;
        out.bending[k] += s
                          * (2 * (dN[i][a] * dN[i][b] + N[i] * second(i, a, b)) * N[j]
                             + 2 * N[i] * (dN[i][a] * dN[j][b] + dN[i][b] * dN[j][a])
                             + N[i] * N[i] * second(j, a, b));
      }
    }
  return out;
}

bool qsdolfinx::solve_rays(const RayPair& pair, std::span<RayPoint> points)
{
  const Vec3 n = Normal(pair.along()).n();
  bool found = true;
  for (RayPoint& point : points)
    found = solve(pair, n, point) && found;
  return found;
}

void qsdolfinx::gap_gradients(const RayPair& pair, std::span<const RayPoint> points,
                              std::span<double> out)
{
  const Normal normal(pair.along());
  const Columns columns(pair);
  const auto size = static_cast<std::size_t>(columns.size());
  for (std::size_t p = 0; p < points.size(); ++p)
  {
    const Ray ray(pair, normal, points[p]);
    const Row row = ray.form(columns, normal, ray.of_gap(1, lift_of(pair, points[p].zeta).slope));
    std::copy_n(row.begin(), size, out.subspan(p * size).begin());
  }
}

void qsdolfinx::function_gradients(const RayPair& pair, std::span<const RayPoint> points,
                                   std::span<double> out)
{
  const Normal normal(pair.along());
  const Columns columns(pair);
  const auto size = static_cast<std::size_t>(columns.size()),
             nk = static_cast<std::size_t>(pair.slave().num_vertices());
  std::ranges::fill(out, 0.0);
  for (std::size_t p = 0; p < points.size() && !pair.cut_is_slave; ++p)
  {
    const Ray ray(pair, normal, points[p]);
    const Multipliers multipliers(pair, points[p]);
    for (std::size_t k = 0; k < nk; ++k)
    {
      const auto& [first, second] = multipliers.dN[k];
      const Row row = ray.form(columns, normal, first * ray.A.zeta[0] + second * ray.A.zeta[1]);
      std::copy_n(row.begin(), size, out.subspan((p * nk + k) * size).begin());
    }
  }
}

void qsdolfinx::rim_motions(const RayPair& pair, std::span<const RimPoint> rim,
                            std::span<double> out)
{
  const Normal normal(pair.along());
  const Columns columns(pair);
  const auto size = static_cast<std::size_t>(columns.size());
  std::ranges::fill(out, 0.0);
  for (std::size_t p = 0; p < rim.size(); ++p)
    if (const auto motion = motion_of(pair, normal, columns, rim[p]))
      std::copy_n(motion->begin(), size, out.subspan(p * size).begin());
}

void qsdolfinx::add_curvature_of_points(const RayPair& pair, std::span<const RayPoint> points,
                                        std::span<const double> pressure, std::span<double> hessian)
{
  HalfHessian half(pair, points.size());
  for (std::size_t p = 0; p < points.size(); ++p)
    if (pressure[p] != 0)
      half.add_point(points[p], {points[p].weight * pressure[p], lift_of(pair, points[p].zeta)});
  half.add_sums();
  half.add_to(hessian);
}

void qsdolfinx::add_rim_of_points(const RayPair& pair, std::span<const RimPoint> rim,
                                  std::span<const double> pressure, std::span<double> hessian)
{
  const double* next = pressure.data();
  for (const RimPoint& at : rim)
    if (const double p = *next++; p != 0)
      add_rim_of(pair, std::span(&at, 1), hessian,
                 [p](const Ray& ray, const RayPoint& point, const Vec3&)
                 { return ray.of_gap(point.weight * p, {0, 0}); });
}

void qsdolfinx::add_slip_rim_of_points(const RayPair& pair, std::span<const RimPoint> rim,
                                       std::span<const double> traction, std::span<double> hessian)
{
  for (std::size_t i = 0; i < rim.size(); ++i)
  {
    const Vec3 tau = facet_vertex(traction, static_cast<int>(i));
    if (dot(tau, tau) == 0)
      continue;
    add_rim_of(pair, rim.subspan(i, 1), hessian,
               [&](const Ray& ray, const RayPoint&, const Vec3&)
               {
                 const Vec2 s = Sliding(pair, ray, tau).s;
                 return s[0] * ray.A.zeta[0] + s[1] * ray.A.zeta[1];
               });
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
  void add_to(const Normal& normal, const Vec3& c, const Vec2& s, double* row, int stride) const
  {
    // c·δe₁ = k·δd₁ with k = (c − e₁ (e₁·c))/|d₁|, and c·δe₂ = c·(δn × e₁) + c·(n × δe₁).
    const Vec3 with_first = s[0] * c + s[1] * cross(c, n);
    const Vec3 k = 1 / length * (with_first - dot(e[0], with_first) * e[0]);
    add(row, -1, k);
    add(row + stride, 1, k);
    normal.add_to(s[1] * cross(e[0], c), row, stride);
  }

  Vec3 n, edge;
  double length;
  std::array<Vec3, 2> e;
};

RayFacet moved_to(const RayFacet& facet, std::span<const double> x)
{
  return {facet.type, facet.degree, x, facet.orientation};
}

/// Turns by more than this are not told from those the other way round.
constexpr double most_turned = 2.6;

/// θ/sin θ of facets that have turned against each other by θ, as their normals say: where one of
/// them is in the frame of the other one, then and now.
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

void qsdolfinx::slip_of_points(const RayPair& pair, const RayStart& start,
                               std::span<const RayPoint> points, const RaySlip& out)
{
  const Normal normal(pair.along());
  const Columns columns(pair);
  const RayFacet cut = moved_to(pair.cut, start.cut), other = moved_to(pair.other, start.other);
  const RayFacet along = moved_to(pair.along(), pair.along_other ? start.other : start.cut);
  const Vec3 n_then = Normal(along).n();
  const Frame now(pair.along(), normal.n()), then(along, n_then);
  // Edges of facets that are not flat lead out of the plane across n: gaps are no slip.
  const std::array<Vec3, 2> across{then.e[0] - dot(then.e[0], n_then) * n_then,
                                   then.e[1] - dot(then.e[1], n_then) * n_then};
  const int dim = pair.other.type == FacetType::interval ? 1 : 2;
  const double sign = pair.cut_is_slave ? 1 : -1;
  const Vec3 origin = facet_vertex(cut.x, 0);
  const auto size = static_cast<std::size_t>(3 * columns.size());
  // A vertex goes along the facet whose frame it has.
  std::ranges::fill(
      out.arc,
      pair.along_other ? 1.0 : arc_of_turn(then, Normal(other).n(), now, Normal(pair.other).n()));
  for (std::size_t p = 0; p < points.size(); ++p)
  {
    const RayPoint& point = points[p];
    const Ray ray(pair, normal, point);
    const Vec3 d = point_of(cut, origin, point.xi) - point_of(other, origin, point.zeta);
    const Vec2 s{-sign * dot(across[0], d), dim == 2 ? -sign * dot(across[1], d) : 0.0};
    const Vec3 slip = s[0] * now.e[0] + s[1] * now.e[1], n = sign * normal.n();
    std::copy_n(slip.begin(), 3, out.slip.subspan(3 * p).begin());
    std::copy_n(n.begin(), 3, out.normal.subspan(3 * p).begin());
    out.gap[p] = dot(n_then, d);
    // ∂s_a/∂ζ_α = sign E_a·∂x_other₀/∂ζ_α, E_a being those of then across n
    const auto a0 = tangents(other, origin, ray.dM);
    const RayLift lift = lift_of(pair, point.zeta);
    const Vec3 rises = lift.slope[0] * ray.A.zeta[0] + lift.slope[1] * ray.A.zeta[1];
    std::array<Vec3, 3> slides{}, works{}; // forms c·v of each component
    for (int r = 0; r < 3; ++r)
      works[r] = sign * rises[r] * ray.A.t; // tractions lie in the curved surface
    for (int alpha = 0; alpha < dim; ++alpha)
    {
      Vec3 along{};
      for (int b = 0; b < dim; ++b)
        along = along + sign * dot(across[b], a0[alpha]) * now.e[b];
      for (int r = 0; r < 3; ++r)
      {
        slides[r] = slides[r] + along[r] * ray.A.zeta[alpha];
        works[r] = works[r] + sign * ray.a[alpha][r] * ray.A.zeta[alpha];
      }
    }
    double *gradient = &out.gradient[p * size], *work = &out.works[p * size];
    for (int r = 0; r < 3; ++r)
    {
      Vec3 axis{};
      axis[r] = 1;
      ray.add_to(columns, slides[r], gradient + 3 * r, 9);
      normal.add_to(ray.t * slides[r], gradient + 9 * columns.along + 3 * r, 9);
      now.add_to(normal, axis, s, gradient + 9 * columns.along + 3 * r, 9);
      ray.add_to(columns, works[r], work + 3 * r, 9);
      normal.add_to(ray.t * works[r], work + 9 * columns.along + 3 * r, 9);
    }
  }
}

void qsdolfinx::add_slip_curvature_of_points(const RayPair& pair, std::span<const RayPoint> points,
                                             std::span<const double> traction,
                                             std::span<double> hessian)
{
  const Normal normal(pair.along());
  const Columns columns(pair);
  const int dim = pair.other.type == FacetType::interval ? 1 : 2, n = columns.size();
  HalfHessian half(pair, points.size());
  for (std::size_t p = 0; p < points.size(); ++p)
  {
    const Vec3 tau = facet_vertex(traction, static_cast<int>(p));
    if (dot(tau, tau) == 0)
      continue;
    const RayPoint& point = points[p];
    const Ray ray(pair, normal, point);
    const RayForms forms(ray, columns, normal, dim);
    const Sliding sliding(pair, ray, tau);
    const RayLift lift = lift_of(pair, point.zeta);
    const double w = (pair.cut_is_slave ? 1 : -1) * ray.weight;
    const Vec2 up{w * dot(tau, ray.A.zeta[0]), w * dot(tau, ray.A.zeta[1])};
    half.add_point(point, ray, forms, sliding.s, up[0] * lift.slope[0] + up[1] * lift.slope[1]);
    if (!pair.rise.empty())
    {
      const auto [b11, b12, b22] = lift.bending;
      Row steeper{};
      for (int b = 0; b < n; ++b)
        steeper[b] = (up[0] * b11 + up[1] * b12) * forms.first[b]
                     + (up[0] * b12 + up[1] * b22) * forms.second[b];
      add_outer(forms.dt, steeper, n, hessian);
    }
    for (int alpha = 0; alpha < dim; ++alpha)
      add_outer(alpha == 0 ? forms.first : forms.second,
                sliding.variation(alpha, pair, ray, point, forms, columns), n, hessian);
  }
  half.add_sums();
  half.add_to(hessian);
}
