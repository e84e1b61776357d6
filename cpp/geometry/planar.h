// Facets and polygons in a plane, in 2D on a line: projection, clipping, inverse maps, integrals.
#pragma once

#include "geometry/facet.h"
#include <algorithm>
#include <cstdint>
#include <initializer_list>
#include <span>
#include <vector>

namespace qsdolfinx
{

using Vec2 = std::array<double, 2>;

inline Vec2 operator-(const Vec2& a, const Vec2& b) { return {a[0] - b[0], a[1] - b[1]}; }
inline Vec2 operator+(const Vec2& a, const Vec2& b) { return {a[0] + b[0], a[1] + b[1]}; }
inline Vec2 operator*(double s, const Vec2& a) { return {s * a[0], s * a[1]}; }
inline double cross(const Vec2& a, const Vec2& b) { return a[0] * b[1] - a[1] * b[0]; }

/// Convex polygon with its corners anticlockwise. On a line: two corners (s, 0), the smaller s
/// first.
class Polygon
{
public:
  Polygon() = default;
  Polygon(std::initializer_list<Vec2> corners)
  {
    for (const Vec2& q : corners)
      push_back(q);
  }

  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  Vec2& operator[](std::size_t i) { return corners_[i]; }
  const Vec2& operator[](std::size_t i) const { return corners_[i]; }
  std::span<const Vec2> corners() const { return std::span(corners_).first(size_); }
  void clear() { size_ = 0; }
  void push_back(const Vec2& q) { corners_.at(size_++) = q; }
  void reverse() { std::reverse(corners_.begin(), corners_.begin() + size_); }
  /// Rotate the order of the corners so that the first is the one furthest back along a direction.
  void begin_along(const Vec2& direction)
  {
    const auto first = corners_.begin(), last = first + size_;
    const auto place = [&](const Vec2& q) { return q[0] * direction[0] + q[1] * direction[1]; };
    std::rotate(first, std::ranges::min_element(first, last, {}, place), last);
  }

private:
  // A line cuts at most half the sides: 4 corners become 6, 9, 13, 19 along 4 lines.
  std::array<Vec2, 20> corners_;
  std::uint32_t size_ = 0;
};

/// Area of a polygon, length of an interval.
double measure(const Polygon& polygon);

/// Intersection of two convex polygons (Sutherland & Hodgman) or intervals; empty if there is none.
void intersect(const Polygon& a, const Polygon& b, Polygon& out);

/// Whether a convex polygon or interval contains a point. A point that is outside a side only by
/// rounding counts as inside, so that a point on the common side of two polygons is in one of them.
bool contains(const Polygon& polygon, const Vec2& q);

/// Whether all the points are outside one side of a polygon, up to rounding. Their convex hull and
/// the polygon then do not overlap.
bool has_outside(const Polygon& polygon, std::span<const Vec2> points);

/// Plane of a facet (2D: its line), and the direction along which other facets are projected onto
/// it.
struct Frame
{
  Vec3 origin, e0, e1, normal;

  /// Plane through the facet's centre, perpendicular to its area vector there.
  Frame(FacetType type, std::span<const double> vertices);
  Vec2 project(const Vec3& x) const;
};

/// Points and weights on the reference interval [0, 1], triangle or square; weights sum to 1.
struct Rule
{
  std::vector<Vec2> x;
  std::vector<double> w;
};

/// Fraction of a polygon's area below which the triangle at a corner is an ear.
inline constexpr double ear_area = 1e-3;

/// Triangulation of a polygon by its corners, or an interval.
struct Triangles
{
  /// Ears are cut off first, in the order of their area. Where two nearly coincident lines cross, a
  /// small motion can move the intersection along a whole side; the points in other triangles must
  /// not move with it.
  /// @param from_middle whether the rest is a fan around the middle; otherwise it is a fan from a
  /// corner
  Triangles(const Polygon& polygon, bool from_middle);

  std::vector<std::array<std::uint8_t, 3>> corner; ///< corner numbers; the number after the last
                                                   ///< corner is the middle
  std::vector<std::uint8_t> around;                ///< corners that are not ears
  Vec2 middle{0, 0};
};

/// Quadrature points of a polygon (fan of triangles) or interval, appended; weights are areas.
void append_points(const Polygon& polygon, const Rule& rule, std::vector<Vec2>& x,
                   std::vector<double>& w);

/// Same as append_points, with the fan around the centroid. It does not depend on a rotation of the
/// plane.
void append_points_from_middle(const Polygon& polygon, const Rule& rule, std::vector<Vec2>& x,
                               std::vector<double>& w);

/// A facet projected into a plane.
class PlanarFacet
{
public:
  PlanarFacet(FacetType type, std::span<const double> vertices, const Frame& frame);

  const Polygon& polygon() const { return polygon_; }
  /// Vertex that is a corner of the polygon.
  std::int8_t vertex(std::size_t corner) const;
  /// Whether the map from the reference facet is affine; otherwise the facet is a general
  /// quadrilateral.
  bool affine() const { return affine_; }
  /// Whether the Jacobian of the map has the same sign everywhere. The projection of a
  /// quadrilateral that is not flat may fold when it is seen from the side; it can then be neither
  /// inverted nor clipped.
  bool unfolded() const { return unfolded_; }
  /// Reference coordinates of a point of the facet, by Newton's method if the map is not affine.
  Vec2 invert(const Vec2& q) const;
  /// |∂q/∂ξ|, area per reference area.
  double jacobian(const Vec2& xi) const;
  /// ∫ N_i over a polygon within the facet, N_i the bilinear functions, which are not polynomials
  /// in the plane. By Green's theorem on the reference facet: an integral over the polygon's edges
  /// of a function that is known in closed form.
  /// @param edge rule on the interval
  std::array<double, 4> integrals(const Polygon& polygon, const Rule& edge) const;

private:
  FacetType type_;
  Vec2 x0_, a_, b_{0, 0}, c_{0, 0}; // q = x0 + ξ a + η b + ξη c
  bool affine_ = true, unfolded_ = true, reversed_ = false;
  Polygon polygon_;
};

/// Corner of the intersection of two facets: a vertex of one of them, or a crossing of two edges.
struct CornerSource
{
  Vec2 q;
  /// Vertices at the ends of each facet's edge. Both are the same if the corner is this vertex; −1
  /// if the corner is a vertex of the other facet.
  std::array<std::int8_t, 2> a{-1, -1}, b{-1, -1};
};

/// Corners that `intersect` finds for the polygons of two facets, with their sources. If ends of
/// two intervals coincide, the source is the vertex of b if `b_first` is true, otherwise that of a.
void sources_of_intersection(const PlanarFacet& a, const PlanarFacet& b, bool b_first,
                             std::vector<CornerSource>& out);

} // namespace qsdolfinx
