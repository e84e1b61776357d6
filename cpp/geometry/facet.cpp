#include "geometry/facet.h"

#include <algorithm>

using namespace qsdolfinx;

namespace
{
/// Quadratic functions of one variable, or their derivatives, for the two ends and the middle.
using Line = std::array<double, 3>;

Line line(double s) { return {(1 - s) * (1 - 2 * s), s * (2 * s - 1), 4 * s * (1 - s)}; }
Line line_slopes(double s) { return {4 * s - 3, 4 * s - 1, 4 - 8 * s}; }
constexpr Line line_curvatures{4, 4, -8};

/// Products f(ξ) g(η) in the order of a quadrilateral's nodes.
std::array<double, max_trace> products(const Line& f, const Line& g)
{
  return {f[0] * g[0], f[1] * g[0], f[0] * g[1], f[1] * g[1], f[2] * g[0],
          f[0] * g[2], f[1] * g[2], f[2] * g[1], f[2] * g[2]};
}
} // namespace

std::span<const std::array<int, 2>> qsdolfinx::facet_edges(FacetType type)
{
  static constexpr std::array<std::array<int, 2>, 1> interval{{{0, 1}}};
  static constexpr std::array<std::array<int, 2>, 3> triangle{{{0, 1}, {0, 2}, {1, 2}}};
  static constexpr std::array<std::array<int, 2>, 4> quadrilateral{
      {{0, 1}, {0, 2}, {1, 3}, {2, 3}}};
  switch (type)
  {
  case FacetType::interval:
    return interval;
  case FacetType::triangle:
    return triangle;
  default:
    return quadrilateral;
  }
}

std::array<double, max_trace> qsdolfinx::quadratic_functions(FacetType type,
                                                             std::array<double, 2> xi)
{
  const auto N = shape_functions(type, xi);
  std::array<double, max_trace> out{};
  if (type != FacetType::quadrilateral)
  {
    // In barycentric coordinates: N (2 N - 1) at vertices, 4 N_a N_b on edges.
    int next = static_cast<int>(type);
    for (int i = 0; i < next; ++i)
      out[i] = N[i] * (2 * N[i] - 1);
    for (const auto& [a, b] : facet_edges(type))
      out[next++] = 4 * N[a] * N[b];
    return out;
  }
  return products(line(xi[0]), line(xi[1]));
}

std::array<std::array<double, 2>, max_trace>
qsdolfinx::quadratic_gradients(FacetType type, std::array<double, 2> xi)
{
  std::array<std::array<double, 2>, max_trace> out{};
  if (type == FacetType::quadrilateral)
  {
    const auto s = products(line_slopes(xi[0]), line(xi[1]));
    const auto t = products(line(xi[0]), line_slopes(xi[1]));
    for (int i = 0; i < max_trace; ++i)
      out[i] = {s[i], t[i]};
    return out;
  }
  const auto dN = shape_gradients(type, xi);
  const auto N = shape_functions(type, xi);
  int next = static_cast<int>(type);
  for (int i = 0; i < next; ++i)
    for (int d = 0; d < 2; ++d)
      out[i][d] = (4 * N[i] - 1) * dN[i][d];
  for (const auto& [a, b] : facet_edges(type))
  {
    for (int d = 0; d < 2; ++d)
      out[next][d] = 4 * (N[a] * dN[b][d] + N[b] * dN[a][d]);
    ++next;
  }
  return out;
}

std::array<std::array<double, 3>, max_trace> qsdolfinx::trace_curvatures(FacetType type, int degree,
                                                                         std::array<double, 2> xi)
{
  std::array<std::array<double, 3>, max_trace> out{};
  if (degree == 1)
  {
    if (type == FacetType::quadrilateral)
      for (int i = 0; i < 4; ++i)
        out[i][1] = i == 0 || i == 3 ? 1 : -1;
    return out;
  }
  if (type == FacetType::quadrilateral)
  {
    const auto ss = products(line_curvatures, line(xi[1]));
    const auto st = products(line_slopes(xi[0]), line_slopes(xi[1]));
    const auto tt = products(line(xi[0]), line_curvatures);
    for (int i = 0; i < max_trace; ++i)
      out[i] = {ss[i], st[i], tt[i]};
    return out;
  }
  const auto dN = shape_gradients(type, xi);
  const auto product = [&](int a, int b) -> std::array<double, 3>
  {
    return {4 * dN[a][0] * dN[b][0], 2 * (dN[a][0] * dN[b][1] + dN[a][1] * dN[b][0]),
            4 * dN[a][1] * dN[b][1]};
  };
  int next = static_cast<int>(type);
  for (int i = 0; i < next; ++i)
    out[i] = product(i, i);
  for (const auto& [a, b] : facet_edges(type))
  {
    const auto half = product(a, b);
    out[next++] = {2 * half[0], 2 * half[1], 2 * half[2]};
  }
  return out;
}

double qsdolfinx::squared_size(FacetType type, std::span<const double> v)
{
  double square = 0;
  for (int i = 0; i < static_cast<int>(type); ++i)
    for (int j = 0; j < i; ++j)
    {
      const Vec3 d = facet_vertex(v, i) - facet_vertex(v, j);
      square = std::max(square, dot(d, d));
    }
  return square;
}

std::int64_t qsdolfinx::count_degenerate(FacetType type, std::span<const double> x)
{
  const int nv = static_cast<int>(type);
  const std::array<int, 4> cyclic{0, 1, nv == 4 ? 3 : 2, 2};
  std::int64_t count = 0;
  for (std::size_t first = 0; first < x.size(); first += 3 * nv)
  {
    const auto v = x.subspan(first, 3 * nv);
    const double square = squared_size(type, v);
    // The area vectors at all corners must point to one side.
    std::array<Vec3, 4> areas{};
    Vec3 whole{0, 0, 0};
    for (int i = 0; i < nv && nv > 2; ++i)
    {
      const Vec3 c = facet_vertex(v, cyclic[i]);
      areas[i] = cross(facet_vertex(v, cyclic[(i + 1) % nv]) - c,
                       facet_vertex(v, cyclic[(i + nv - 1) % nv]) - c);
      whole = whole + areas[i];
    }
    bool good = square > 0;
    for (int i = 0; i < nv && nv > 2; ++i)
      good = good && dot(areas[i], whole) > 1e-14 * square * norm(whole);
    count += !good;
  }
  return count;
}
