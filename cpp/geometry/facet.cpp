#include "geometry/facet.h"

#include <algorithm>

using namespace qsdolfinx;

int qsdolfinx::trace_size(FacetType type, int degree)
{
  if (degree == 1)
    return static_cast<int>(type);
  return type == FacetType::interval ? 3 : type == FacetType::triangle ? 6 : 9;
}

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

std::array<double, max_trace> qsdolfinx::trace_functions(FacetType type, int degree,
                                                         std::array<double, 2> xi)
{
  const auto N = shape_functions(type, xi);
  std::array<double, max_trace> out{};
  if (degree == 1)
  {
    std::copy(N.begin(), N.end(), out.begin());
    return out;
  }
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
  const auto line = [](double s)
  { return std::array{(1 - s) * (1 - 2 * s), s * (2 * s - 1), 4 * s * (1 - s)}; };
  const auto f = line(xi[0]), g = line(xi[1]);
  return {f[0] * g[0], f[1] * g[0], f[0] * g[1], f[1] * g[1], f[2] * g[0],
          f[0] * g[2], f[1] * g[2], f[2] * g[1], f[2] * g[2]};
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
