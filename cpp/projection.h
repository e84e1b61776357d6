// Closest point on one facet: segment, triangle, bilinear quadrilateral. Geometry only, no MPI.
#pragma once

#include <array>
#include <cmath>
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

/// Facet shapes. The number of vertices identifies the shape: 2, 3, 4.
enum class FacetType : int
{
  interval = 2,
  triangle = 3,
  quadrilateral = 4 ///< vertices in tensor order: (0,0), (1,0), (0,1), (1,1)
};

/// Newton's method on a bilinear quadrilateral stops when the step in (ξ, η) is below this ...
inline constexpr double projection_tolerance = 1e-14;
/// ... or after this many iterations; the best point seen so far is then the answer.
inline constexpr int projection_max_iterations = 30;

/// Values of the linear (bilinear) shape functions at ξ; the unused ones are 0.
std::array<double, 4> shape_functions(FacetType type, std::array<double, 2> xi);

/// Point of the facet at ξ. @param vertices 3 coordinates a vertex
Vec3 facet_point(FacetType type, std::span<const double> vertices, std::array<double, 2> xi);

/// Area vector ∂x/∂ξ × ∂x/∂η at ξ (triangle: twice its area; interval in the xy-plane: its length,
/// turned by −90°). Its norm is the surface Jacobian.
Vec3 area_vector(FacetType type, std::span<const double> vertices, std::array<double, 2> xi);

/// Closest point of a facet.
struct ClosestPoint
{
  std::array<double, 2> xi{0, 0}; ///< reference coordinates, within the facet
  Vec3 x{0, 0, 0};                ///< the point
  double distance = 0;            ///< its distance from the query
};

/// Closest point of a facet to p.
///
/// Exact on segments and triangles. On a bilinear quadrilateral the distance may have several local
/// minima: the four edges are searched exactly, then Newton's method (projection_tolerance,
/// projection_max_iterations) runs in the interior from the centre and the four quadrants; the
/// nearest of all points seen is returned, so that the answer is defined also where Newton does not
/// converge.
ClosestPoint closest_point(FacetType type, std::span<const double> vertices, const Vec3& p);

} // namespace qsdolfinx
