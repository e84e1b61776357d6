#include "sliding/rise.h"
#include "sliding/forms.h"

#include <functional>
#include <optional>
#include <vector>

using namespace qsdolfinx;
using namespace qsdolfinx::forms;

// In 2D, and on facets of degree 2, the surface rises from vertex i towards j by s = −m·e/(m·n),
// where e is the facet's tangent at i along the edge to j, m the normal of the surface at i, and n
// the normal of the facet. Between vertices its slopes are those of a height, see RayLift.
//
// On facets of degree 1 in 3D the direction of its normal is
//
//   ν(ζ) = Σ_i N_i m_i − 3 Σ_ij N_i N_j ((m_i + m_j)·e/e·e) e,   e = x_j − x_i,
//
// the second sum over the edges ij, with m_i = n at vertices without a normal, and its slopes are
// −ν·a_α/(ν·n). On an edge ν depends on the edge and the normals at its ends only, so that facets
// that share it have one normal there. Along an edge the mean slope is 0, as that of the height.

namespace
{
/// Slopes by ζ at a point, and their derivatives by nodes of the facets and by normals.
struct SlopeChanges
{
  std::array<Row, 2> by_nodes{};
  std::array<std::array<Vec3, 4>, 2> by_normals{}; ///< [slope][vertex]
};

/// The slope from a vertex to another one, and its derivatives.
struct EdgeSlope
{
  int from, to;
  double rise;
  Row by_nodes;
  Vec3 by_normal;
};

std::vector<EdgeSlope> edge_slopes_of(const RayPair& pair, const Normal& normal,
                                      const Columns& columns)
{
  std::vector<EdgeSlope> out;
  const int count = pair.other.num_vertices();
  for (int i = 0; i < count; ++i)
    for (int j = 0; j < count; ++j)
    {
      const Vec3 m = facet_vertex(pair.rise_normal, i);
      const double along = dot(m, normal.n());
      if (i == j || (count == 4 && i + j == 3) || along == 0) // along edges
        continue;
      const Vec3 e = along_edge(pair.other.type, pair.other.degree, pair.other.x, i, j);
      const double rise = dot(m, e) / (along * along);
      EdgeSlope slope{i, j, -dot(m, e) / along, {}, rise * normal.n() - 1 / along * e};
      const auto factors = edge_tangent(pair.other.type, pair.other.degree, i, j);
      for (int k = 0; k < columns.num_other; ++k)
        add(&slope.by_nodes[3 * (columns.other + k)], -factors[k] / along, m);
      normal.add_to(rise * m, &slope.by_nodes[3 * columns.other]);
      out.push_back(slope);
    }
  return out;
}

/// Slopes of the height Σ_ij s_ij N_i² N_j.
class Heights
{
public:
  Heights(const RayPair& pair, const Normal& normal, const Columns& columns)
      : pair_(pair), n_(columns.size()), slopes_(edge_slopes_of(pair, normal, columns))
  {
  }

  SlopeChanges at(const Vec2& zeta) const
  {
    const auto N = shape_functions(pair_.other.type, zeta);
    const auto dN = trace_gradients(pair_.other.type, 1, zeta);
    SlopeChanges out;
    for (const auto& [i, j, rise, by_nodes, by_normal] : slopes_)
      for (int a = 0; a < 2; ++a)
      {
        const double steeper = N[i] * (2 * dN[i][a] * N[j] + N[i] * dN[j][a]);
        for (int b = 0; b < n_; ++b)
          out.by_nodes[a][b] += steeper * by_nodes[b];
        add(out.by_normals[a][i].data(), steeper, by_normal);
      }
    return out;
  }

private:
  const RayPair& pair_;
  int n_;
  std::vector<EdgeSlope> slopes_;
};

RayLift lift_by_heights(const RayPair& pair, const Vec2& zeta)
{
  constexpr std::array<double, 4> corners{1, -1, -1, 1};
  const FacetType type = pair.other.type;
  const auto N = shape_functions(type, zeta);
  const auto dN = trace_gradients(type, 1, zeta);
  const int n = pair.other.num_vertices();
  const auto second = [&](int i, int a, int b)
  { return type == FacetType::quadrilateral && a != b ? corners[i] : 0.0; };
  RayLift out;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
    {
      const double s = pair.rise[i * n + j];
      if (s == 0)
        continue;
      for (int a = 0; a < 2; ++a)
      {
        out.slope[a] += s * N[i] * (2 * dN[i][a] * N[j] + N[i] * dN[j][a]);
        for (int b = 0; b < 2; ++b)
          out.bending[a][b] += s
                               * (2 * (dN[i][a] * dN[i][b] + N[i] * second(i, a, b)) * N[j]
                                  + 2 * N[i] * (dN[i][a] * dN[j][b] + dN[i][b] * dN[j][a])
                                  + N[i] * N[i] * second(j, a, b));
      }
    }
  return out;
}

/// Interpolated normals of the surface over a facet of degree 1 in 3D.
class Interpolated
{
public:
  Interpolated(const RayPair& pair, const Normal& normal)
      : facet_(pair.other), normal_(normal), count_(facet_.num_vertices())
  {
    for (int i = 0; i < count_; ++i)
    {
      m_[i] = facet_vertex(pair.rise_normal, i);
      is_known_[i] = dot(m_[i], m_[i]) > 0;
      if (!is_known_[i])
        m_[i] = normal.n();
    }
    for (int i = 0; i < count_; ++i)
      for (int j = i + 1; j < count_; ++j)
        if (count_ == 3 || i + j != 3)
          edges_.at(num_edges_++) = {i, j, facet_vertex(facet_.x, j) - facet_vertex(facet_.x, i)};
  }

  RayLift lift(const Vec2& zeta) const
  {
    const At at(*this, zeta);
    RayLift out;
    Vec3 twist{}; // ∂₁∂₂x
    if (count_ == 4)
      twist = facet_vertex(facet_.x, 0) - facet_vertex(facet_.x, 1) - facet_vertex(facet_.x, 2)
              + facet_vertex(facet_.x, 3);
    for (int a = 0; a < 2; ++a)
    {
      out.slope[a] = at.slope[a];
      for (int b = 0; b < 2; ++b)
        out.bending[a][b]
            = dot(change(at, b), at.by_direction[a]) - (a != b) * dot(at.nu, twist) / at.up;
    }
    return out;
  }

  SlopeChanges changes(const Vec2& zeta, const Columns& columns) const
  {
    const At at(*this, zeta);
    SlopeChanges out;
    for (int a = 0; a < 2; ++a)
    {
      const Vec3& q = at.by_direction[a];
      double* row = &out.by_nodes[a][3 * columns.other];
      Vec3 by_n = -at.slope[a] / at.up * at.nu;
      std::array<Vec3, 4> by_m{};
      for (int k = 0; k < count_; ++k)
      {
        add(row + 3 * k, -at.dN[k][a] / at.up, at.nu);
        by_m[k] = at.N[k] * q;
      }
      for (int k = 0; k < num_edges_; ++k)
      {
        const auto& [i, j, e] = edges_[k];
        const double factor = -3 * at.N[i] * at.N[j] / dot(e, e);
        const Vec3 sum = m_[i] + m_[j];
        const double along = dot(q, e), tilt = dot(sum, e);
        const Vec3 by_m_of_edge = factor * along * e,
                   by_e = factor * (along * sum + tilt * q - 2 * tilt * along / dot(e, e) * e);
        by_m[i] = by_m[i] + by_m_of_edge;
        by_m[j] = by_m[j] + by_m_of_edge;
        add(row + 3 * i, -1, by_e);
        add(row + 3 * j, 1, by_e);
      }
      for (int k = 0; k < count_; ++k)
        if (is_known_[k])
          out.by_normals[a][k] = by_m[k];
        else
          by_n = by_n + by_m[k];
      normal_.add_to(by_n, row);
    }
    return out;
  }

private:
  struct Edge
  {
    int i, j;
    Vec3 e; ///< from i to j
  };

  /// The direction and the slopes at a point.
  struct At
  {
    At(const Interpolated& of, const Vec2& zeta)
        : N(shape_functions(of.facet_.type, zeta)), dN(trace_gradients(of.facet_.type, 1, zeta))
    {
      for (int i = 0; i < of.count_; ++i)
        add(nu.data(), N[i], of.m_[i]);
      for (int k = 0; k < of.num_edges_; ++k)
      {
        const auto& [i, j, e] = of.edges_[k];
        add(nu.data(), -3 * N[i] * N[j], of.tilt(k));
      }
      up = dot(nu, of.normal_.n());
      const auto tangent = tangents(of.facet_, facet_vertex(of.facet_.x, 0), dN);
      for (int a = 0; a < 2; ++a)
      {
        slope[a] = -dot(nu, tangent[a]) / up;
        by_direction[a] = -1 / up * (tangent[a] + slope[a] * of.normal_.n());
      }
    }

    std::array<double, 4> N;
    std::array<Vec2, max_trace> dN;
    Vec3 nu{};
    double up; ///< ν·n
    Vec2 slope;
    std::array<Vec3, 2> by_direction; ///< derivatives of the slopes by ν
  };

  /// Part of m_i + m_j along an edge.
  Vec3 tilt(int k) const
  {
    const auto& [i, j, e] = edges_[k];
    return dot(m_[i] + m_[j], e) / dot(e, e) * e;
  }

  /// ∂ν/∂ζ_b.
  Vec3 change(const At& at, int b) const
  {
    Vec3 out{};
    for (int i = 0; i < count_; ++i)
      add(out.data(), at.dN[i][b], m_[i]);
    for (int k = 0; k < num_edges_; ++k)
    {
      const auto& [i, j, e] = edges_[k];
      add(out.data(), -3 * (at.dN[i][b] * at.N[j] + at.N[i] * at.dN[j][b]), tilt(k));
    }
    return out;
  }

  const RayFacet& facet_;
  const Normal& normal_;
  int count_, num_edges_ = 0;
  std::array<Vec3, 4> m_{};
  std::array<bool, 4> is_known_{};
  std::array<Edge, 4> edges_{};
};

/// Add the derivatives of forces c·v, c being linear in slopes.
/// @param factors of the slopes in c, [slope]
void add_forces(const RayPair& pair, std::span<const RayPoint> points, std::span<double> by_nodes,
                std::span<double> by_normals,
                const std::function<std::array<Vec3, 2>(std::size_t, const Ray&)>& factors)
{
  if (!pair.is_raised())
    return;
  const Normal normal(pair.along()), outward(pair.other);
  const Columns columns(pair);
  const int n = columns.size(), count = pair.other.num_vertices(), width = 3 * count;
  std::optional<Heights> heights;
  std::optional<Interpolated> interpolated;
  if (pair.interpolates())
    interpolated.emplace(pair, outward);
  else
    heights.emplace(pair, outward, columns);
  for (std::size_t p = 0; p < points.size(); ++p)
  {
    const Ray ray(pair, normal, points[p]);
    const auto c = factors(p, ray);
    const SlopeChanges slopes = interpolated ? interpolated->changes(points[p].zeta, columns)
                                             : heights->at(points[p].zeta);
    for (int alpha = 0; alpha < dim_of(pair); ++alpha)
    {
      const Row force = ray.form(columns, normal, c[alpha]);
      for (int a = 0; a < n; ++a)
      {
        for (int b = 0; b < n; ++b)
          by_nodes[a * n + b] += force[a] * slopes.by_nodes[alpha][b];
        for (int i = 0; i < count; ++i)
          add(&by_normals[a * width + 3 * i], force[a], slopes.by_normals[alpha][i]);
      }
    }
  }
}
} // namespace

RayLift qsdolfinx::lift_of(const RayPair& pair, const std::array<double, 2>& zeta)
{
  if (!pair.is_raised())
    return {};
  if (pair.interpolates())
    return Interpolated(pair, Normal(pair.other)).lift(zeta);
  return lift_by_heights(pair, zeta);
}

std::array<double, max_trace> qsdolfinx::edge_tangent(FacetType type, int degree, int i, int j)
{
  constexpr std::array<Vec2, 4> vertices{Vec2{0, 0}, Vec2{1, 0}, Vec2{0, 1}, Vec2{1, 1}};
  const auto dM = trace_gradients(type, degree, vertices[i]);
  std::array<double, max_trace> out{};
  for (int k = 0; k < trace_size(type, degree); ++k)
    for (int a = 0; a < 2; ++a)
      out[k] += (vertices[j][a] - vertices[i][a]) * dM[k][a];
  return out;
}

Vec3 qsdolfinx::along_edge(FacetType type, int degree, std::span<const double> x, int i, int j)
{
  const Vec3 origin = facet_vertex(x, i);
  const auto factors = edge_tangent(type, degree, i, j);
  Vec3 out{};
  for (int k = 0; k < trace_size(type, degree); ++k)
    add(out.data(), factors[k], facet_vertex(x, k) - origin);
  return out;
}

void qsdolfinx::add_forces_by_rise(const RayPair& pair, std::span<const RayPoint> points,
                                   std::span<const double> pressure, std::span<double> by_nodes,
                                   std::span<double> by_normals)
{
  add_forces(pair, points, by_nodes, by_normals,
             [&](std::size_t p, const Ray& ray) -> std::array<Vec3, 2>
             {
               const double force = points[p].weight * pressure[p];
               return {force * ray.A.zeta[0], force * ray.A.zeta[1]};
             });
}

void qsdolfinx::add_slip_forces_by_rise(const RayPair& pair, std::span<const RayPoint> points,
                                        std::span<const double> traction,
                                        std::span<double> by_nodes, std::span<double> by_normals)
{
  add_forces(pair, points, by_nodes, by_normals,
             [&](std::size_t p, const Ray& ray) -> std::array<Vec3, 2>
             {
               const Vec3 tau = facet_vertex(traction, static_cast<int>(p));
               const double w = (pair.cut_is_slave ? 1 : -1) * points[p].weight;
               return {w * dot(tau, ray.A.zeta[0]) * ray.A.t,
                       w * dot(tau, ray.A.zeta[1]) * ray.A.t};
             });
}
