// Linear forms at rays, of which all derivatives of gaps and slips consist. No MPI.
#pragma once

#include "geometry/facet.h"
#include "sliding/ray.h"

#include <algorithm>
#include <array>
#include <span>
#include <vector>

namespace qsdolfinx::forms
{

// Let p = x_y(ξ) be a point on the facet y that is cut, and z the other facet. A ray is
// x_z(ζ) = p + t n. Its variation is J (δt, δζ) = v with J = [−n, a₁, a₂], a_α = ∂x_z/∂ζ_α, and
//
//   v = Σ T_i δy_i + t δn − Σ M_j δz_j,
//
// which vanishes for rigid motions. All first variations are linear forms c·v of v.

using Vec2 = std::array<double, 2>;

inline constexpr int max_columns = 2 * 3 * max_trace;

/// A linear form in the components of all nodes.
using Row = std::array<double, max_columns>;

inline void add(double* to, double s, const Vec3& a)
{
  for (int i = 0; i < 3; ++i)
    to[i] += s * a[i];
}

/// to += Σ_k factor_k row_k
template <std::size_t count>
[[gnu::always_inline]] inline void add_rows(double* __restrict to, std::size_t n,
                                            const std::array<double, count>& factors,
                                            const std::array<const double*, count>& rows)
{
  for (std::size_t i = 0; i < n; ++i)
  {
    double sum = to[i];
    for (std::size_t k = 0; k < count; ++k)
      sum += factors[k] * rows[k][i];
    to[i] = sum;
  }
}

/// to = Σ_k factor_k row_k
template <std::size_t count>
[[gnu::always_inline]] inline void set_rows(double* __restrict to, std::size_t n,
                                            const std::array<double, count>& factors,
                                            const std::array<const double*, count>& rows)
{
  for (std::size_t i = 0; i < n; ++i)
  {
    double sum = factors[0] * rows[0][i];
    for (std::size_t k = 1; k < count; ++k)
      sum += factors[k] * rows[k][i];
    to[i] = sum;
  }
}

/// Positions of the columns of both facets.
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
  int cut, other;         ///< first node of each facet
  int along;              ///< first node of the facet whose normal is the direction of the rays
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
    for (int r = 0; r < 3; ++r)
    {
      Vec3 axis{};
      axis[r] = 1;
      add_area(across(axis), gradient_[r].data());
    }
  }

  int num_vertices() const { return num_vertices_; }
  double length() const { return length_; }
  const Vec3& n() const { return n_; }
  /// Gradient of a component of n, [vertex][3].
  const std::array<double, 12>& gradient(int component) const { return gradient_[component]; }

  /// Return k = (c − n (n·c)) / |s|, for which c·δn = k·δs.
  Vec3 across(const Vec3& c) const { return 1 / length_ * (c - dot(n_, c) * n_); }

  /// Add the gradient of k·s for a constant k. @param to first vertex
  void add_area(const Vec3& k, double* to) const
  {
    const Vec3 first = factor_ * cross(d2_, k), second = factor_ * cross(k, d1_);
    for (int i = 0; i < num_vertices_; ++i)
    {
      add(to + 3 * i, signs1_[i], first);
      add(to + 3 * i, signs2_[i], second);
    }
  }

  /// Add the gradient of c·n for a constant c.
  void add_to(const Vec3& c, double* to) const
  {
    for (int i = 0; i < 3 * num_vertices_; ++i)
      to[i] += c[0] * gradient_[0][i] + c[1] * gradient_[1][i] + c[2] * gradient_[2][i];
  }

  /// Add a matrix whose sum with its transpose is the matrix of k·∂²s. @param to first vertex,
  /// first column @param size length of a row
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
  std::array<std::array<double, 12>, 3>
      gradient_{}; ///< of the components of n, [component][vertex][3]
};

/// Rows of J⁻¹. In 2D nothing moves along the third axis, and the second ζ is left out.
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

/// Tangents of a facet. In 2D the second tangent is the third axis.
inline std::array<Vec3, 2> tangents(const RayFacet& facet, const Vec3& origin,
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

inline std::array<Vec3, 2> tangents_at(const RayFacet& facet, const Vec2& xi)
{
  return tangents(facet, facet_vertex(facet.x, 0), trace_gradients(facet.type, facet.degree, xi));
}

inline Vec3 point_of(const RayFacet& facet, const Vec3& origin, const Vec2& xi)
{
  const auto N = trace_functions(facet.type, facet.degree, xi);
  Vec3 x{};
  for (int i = 0; i < facet.num_nodes(); ++i)
    add(x.data(), N[i], facet_vertex(facet.x, i) - origin);
  return x;
}

/// Shape functions, tangents and inverse Jacobian at a ray that has been solved for.
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

  /// Return the c for which w p ∂g = c·v. @param pressure w p @param slope of w p h by ζ, see
  /// Pressure
  Vec3 of_gap(double pressure, const Vec2& slope) const
  {
    return slope[0] * A.zeta[0] + slope[1] * A.zeta[1] - pressure * A.t;
  }

  /// Add the form c·v without the term t c·δn, which comes from the rotation of the normal.
  void add_to(const Columns& columns, const Vec3& c, double* row) const
  {
    for (int i = 0; i < columns.num_cut; ++i)
      add(row + 3 * (columns.cut + i), T[i], c);
    for (int j = 0; j < columns.num_other; ++j)
      add(row + 3 * (columns.other + j), -M[j], c);
  }

  /// Return the form c·v.
  Row form(const Columns& columns, const Normal& normal, const Vec3& c) const
  {
    Row row;
    for (int i = 0; i < columns.num_cut; ++i)
      for (int d = 0; d < 3; ++d)
        row[3 * (columns.cut + i) + d] = T[i] * c[d];
    for (int j = 0; j < columns.num_other; ++j)
      for (int d = 0; d < 3; ++d)
        row[3 * (columns.other + j) + d] = -M[j] * c[d];
    normal.add_to(t * c, &row[3 * columns.along]);
    return row;
  }

  /// Add the form c·v.
  void add_form(const Columns& columns, const Normal& normal, const Vec3& c, double* row) const
  {
    add_to(columns, c, row);
    normal.add_to(t * c, row + 3 * columns.along);
  }

  std::array<double, max_trace> T, M;
  std::array<Vec2, max_trace> dM;
  std::array<Vec3, 2> a;
  Inverse A;
  double t, weight;
};

/// c·∂²x_z/∂ζ², [∂₁∂₁, ∂₁∂₂, ∂₂∂₂].
inline Vec3 bending(const RayFacet& z, const Vec2& zeta, const Vec3& c)
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

/// Number of coordinates on facets.
inline int dim_of(const RayPair& pair) { return pair.cut.type == FacetType::interval ? 1 : 2; }
} // namespace qsdolfinx::forms

struct qsdolfinx::Rays
{
  Rays(const RayPair& facets, std::span<const RayPoint> starts)
      : pair(facets), points(starts), normal(pair.along()), columns(pair)
  {
    all.reserve(points.size());
    for (const RayPoint& point : points)
      all.emplace_back(pair, normal, point);
  }

  RayPair pair;
  std::span<const RayPoint> points;
  forms::Normal normal; ///< along the rays
  forms::Columns columns;
  std::vector<forms::Ray> all; ///< [point]
};
