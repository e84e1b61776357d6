// Facets of a contact surface: vectors, shapes, shape functions, areas. Geometry only, no MPI.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

namespace qsdolfinx
{

using Vec3 = std::array<double, 3>;

inline Vec3 operator-(const Vec3& a, const Vec3& b)
{
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
inline Vec3 operator+(const Vec3& a, const Vec3& b)
{
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}
inline Vec3 operator*(double s, const Vec3& a) { return {s * a[0], s * a[1], s * a[2]}; }
inline double dot(const Vec3& a, const Vec3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline double norm(const Vec3& a) { return std::sqrt(dot(a, a)); }
inline Vec3 cross(const Vec3& a, const Vec3& b)
{
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

/// A line that misses a facet by less than this fraction of the facet's size still counts as
/// meeting it. A line through the edge between two facets thus meets at least one of them in spite
/// of rounding.
inline constexpr double seam_tolerance = 1e-9;

/// Facet shapes. The number of vertices identifies the shape: 2, 3, 4.
enum class FacetType : int
{
  interval = 2,
  triangle = 3,
  quadrilateral = 4 ///< vertices in tensor order: (0,0), (1,0), (0,1), (1,1)
};

/// Vertex i of a facet. @param v 3 coordinates a vertex
inline Vec3 facet_vertex(std::span<const double> v, int i)
{
  return {v[3 * i], v[3 * i + 1], v[3 * i + 2]};
}

/// Values of the linear (bilinear) shape functions at ξ; the unused ones are 0.
inline std::array<double, 4> shape_functions(FacetType type, std::array<double, 2> xi)
{
  const auto [s, t] = xi;
  switch (type)
  {
  case FacetType::interval:
    return {1 - s, s, 0, 0};
  case FacetType::triangle:
    return {1 - s - t, s, t, 0};
  default:
    return {(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t};
  }
}

/// Gradients of the shape functions; the unused ones are 0.
inline std::array<std::array<double, 2>, 4> shape_gradients(FacetType type,
                                                            std::array<double, 2> xi)
{
  const auto [s, t] = xi;
  switch (type)
  {
  case FacetType::interval:
    return {{{-1, 0}, {1, 0}}};
  case FacetType::triangle:
    return {{{-1, -1}, {1, 0}, {0, 1}}};
  default:
    return {{{t - 1, s - 1}, {1 - t, -s}, {-t, 1 - s}, {t, s}}};
  }
}

/// Point of the facet at ξ. @param vertices 3 coordinates a vertex
inline Vec3 facet_point(FacetType type, std::span<const double> v, std::array<double, 2> xi)
{
  const auto N = shape_functions(type, xi);
  Vec3 x{0, 0, 0};
  for (int i = 0; i < static_cast<int>(type); ++i)
    x = x + N[i] * facet_vertex(v, i);
  return x;
}

/// Area vector ∂x/∂ξ × ∂x/∂η at ξ (triangle: twice its area; interval in the xy-plane: its length,
/// turned by −90°). Its norm is the surface Jacobian.
inline Vec3 area_vector(FacetType type, std::span<const double> v, std::array<double, 2> xi)
{
  const Vec3 x0 = facet_vertex(v, 0), a = facet_vertex(v, 1) - x0;
  if (type == FacetType::interval)
    return {a[1], -a[0], 0};
  const Vec3 b = facet_vertex(v, 2) - x0;
  if (type == FacetType::triangle)
    return cross(a, b);
  const Vec3 c = facet_vertex(v, 3) - facet_vertex(v, 1) - facet_vertex(v, 2) + x0;
  return cross(a + xi[1] * c, b + xi[0] * c);
}

/// Centre of the reference facet.
inline std::array<double, 2> facet_centre(FacetType type)
{
  if (type == FacetType::triangle)
    return {1.0 / 3, 1.0 / 3};
  return {0.5, type == FacetType::interval ? 0.0 : 0.5};
}

/// Largest number of unknowns of one component that a trace has on a facet.
inline constexpr int max_trace = 9;

/// Number of trace functions on a facet. @param degree 1 or 2
inline int trace_size(FacetType type, int degree)
{
  if (degree == 1)
    return static_cast<int>(type);
  return type == FacetType::interval ? 3 : type == FacetType::triangle ? 6 : 9;
}

/// Lagrange functions of degree 2 at ξ, see trace_functions.
std::array<double, max_trace> quadratic_functions(FacetType type, std::array<double, 2> xi);
std::array<std::array<double, 2>, max_trace> quadratic_gradients(FacetType type,
                                                                 std::array<double, 2> xi);

/// Lagrange functions of degree 1 or 2 at ξ; the unused ones are 0. Vertices come first, then, for
/// degree 2, the edges in the order of `facet_edges`, and the interior of a quadrilateral.
inline std::array<double, max_trace> trace_functions(FacetType type, int degree,
                                                     std::array<double, 2> xi)
{
  if (degree == 2)
    return quadratic_functions(type, xi);
  const auto N = shape_functions(type, xi);
  return {N[0], N[1], N[2], N[3]};
}

/// First derivatives of trace_functions, [function][∂ξ, ∂η]. For degree 1 they are those of the
/// shape functions.
inline std::array<std::array<double, 2>, max_trace> trace_gradients(FacetType type, int degree,
                                                                    std::array<double, 2> xi)
{
  if (degree == 2)
    return quadratic_gradients(type, xi);
  const auto dN = shape_gradients(type, xi);
  return {dN[0], dN[1], dN[2], dN[3]};
}

/// Second derivatives of trace_functions, [function][∂ξ∂ξ, ∂ξ∂η, ∂η∂η].
std::array<std::array<double, 3>, max_trace> trace_curvatures(FacetType type, int degree,
                                                              std::array<double, 2> xi);

/// Local vertices of the edges of a triangle or quadrilateral; the one edge of an interval.
std::span<const std::array<int, 2>> facet_edges(FacetType type);

/// Square of the largest distance of two vertices.
double squared_size(FacetType type, std::span<const double> v);

/// Number of degenerate facets: without length or area, or quadrilaterals that are not convex.
std::int64_t count_degenerate(FacetType type, std::span<const double> x);

} // namespace qsdolfinx
