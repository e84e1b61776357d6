#include "sliding/rise.h"
#include "sliding/forms.h"

#include <functional>
#include <vector>

using namespace qsdolfinx;
using namespace qsdolfinx::forms;

// The surface rises from vertex i towards j by s = −m·e/(m·n), where e is the facet's tangent at i
// along the edge to j, m the normal of the surface at i, and n the normal of the facet.

namespace
{
/// The slope from a vertex to another one, and its derivatives.
struct Slope
{
  int from, to;
  Row by_nodes;
  Vec3 by_normal;
};

std::vector<Slope> slopes_of(const RayPair& pair)
{
  std::vector<Slope> out;
  if (pair.rise.empty())
    return out;
  const Normal normal(pair.other);
  const Columns columns(pair);
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
      Slope slope{i, j, {}, rise * normal.n() - 1 / along * e};
      const auto factors = edge_tangent(pair.other.type, pair.other.degree, i, j);
      for (int k = 0; k < columns.num_other; ++k)
        add(&slope.by_nodes[3 * (columns.other + k)], -factors[k] / along, m);
      normal.add_to(rise * m, &slope.by_nodes[3 * columns.other]);
      out.push_back(slope);
    }
  return out;
}

/// Derivatives of N_i² N_j by ζ at a point.
Vec2 steepness(const RayPair& pair, const Slope& slope, const RayPoint& point)
{
  const auto N = shape_functions(pair.other.type, point.zeta);
  const auto dN = trace_gradients(pair.other.type, 1, point.zeta);
  const int i = slope.from, j = slope.to;
  Vec2 out;
  for (int a = 0; a < 2; ++a)
    out[a] = N[i] * (2 * dN[i][a] * N[j] + N[i] * dN[j][a]);
  return out;
}

/// Add the derivatives of forces c·v, c being linear in slopes.
void add_forces(const RayPair& pair, std::span<const RayPoint> points, std::span<double> by_nodes,
                std::span<double> by_normals,
                const std::function<Vec3(std::size_t, const Ray&, const Vec2&)>& change)
{
  const std::vector<Slope> slopes = slopes_of(pair);
  if (slopes.empty())
    return;
  const Normal normal(pair.along());
  const Columns columns(pair);
  const int n = columns.size(), width = 3 * pair.other.num_vertices();
  for (std::size_t p = 0; p < points.size(); ++p)
  {
    const Ray ray(pair, normal, points[p]);
    for (const Slope& slope : slopes)
    {
      const Vec3 c = change(p, ray, steepness(pair, slope, points[p]));
      const Row force = ray.form(columns, normal, c);
      for (int a = 0; a < n; ++a)
      {
        for (int b = 0; b < n; ++b)
          by_nodes[a * n + b] += force[a] * slope.by_nodes[b];
        add(&by_normals[a * width + 3 * slope.from], force[a], slope.by_normal);
      }
    }
  }
}
} // namespace

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
             [&](std::size_t p, const Ray& ray, const Vec2& steeper)
             {
               const double force = points[p].weight * pressure[p];
               return force * (steeper[0] * ray.A.zeta[0] + steeper[1] * ray.A.zeta[1]);
             });
}

void qsdolfinx::add_slip_forces_by_rise(const RayPair& pair, std::span<const RayPoint> points,
                                        std::span<const double> traction,
                                        std::span<double> by_nodes, std::span<double> by_normals)
{
  add_forces(pair, points, by_nodes, by_normals,
             [&](std::size_t p, const Ray& ray, const Vec2& steeper)
             {
               const Vec3 tau = facet_vertex(traction, static_cast<int>(p)),
                          rises = steeper[0] * ray.A.zeta[0] + steeper[1] * ray.A.zeta[1];
               const double w = (pair.cut_is_slave ? 1 : -1) * points[p].weight;
               return w * dot(tau, rises) * ray.A.t;
             });
}
