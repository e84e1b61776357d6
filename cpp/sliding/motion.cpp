#include "sliding/motion.h"
#include "geometry/outer.h"
#include "sliding/forms.h"

#include <algorithm>
#include <tuple>
#include <vector>

using namespace qsdolfinx;
using namespace qsdolfinx::forms;

// Let V be the velocity of a point in the plane of the facet, linear in a triangle of the piece,
// and U = Σ_i N_i(ξ) U_i the velocity of the facet's own material there. Then
//
//   δξ = (∂q/∂ξ)⁻¹ (V − U),   δ ln w = div V − div U + δ ln S + (∂ ln(S/J)/∂ξ)·δξ,
//
// where J is the area per reference area in the plane, and S that of the facet, in the axisymmetric
// case that of a ring.

namespace
{
/// Fraction of a facet's area below which a triangle's corners coincide up to rounding.
constexpr double flat = 1e-9;

using Matrix2 = std::array<Vec2, 2>;

/// Vertices of a facet in the plane of the facet that is cut, and their velocities there.
struct InPlane
{
  InPlane(const RayFacet& facet, const Frame& frame, const Normal& normal, int first, int along,
          int size, int dim)
      : velocity(static_cast<std::size_t>(2 * facet.num_vertices()))
  {
    const std::array<Vec3, 2> e{frame.e0, frame.e1};
    for (int i = 0; i < facet.num_vertices(); ++i)
    {
      const Vec3 x = facet_vertex(facet.x, i);
      q[i] = frame.project(x);
      const double height = dot(normal.n(), x - frame.origin);
      for (int d = 0; d < dim; ++d)
      {
        Row& row = velocity[static_cast<std::size_t>(2 * i + d)];
        std::fill_n(row.begin(), size, 0.0);
        add(&row[3 * (first + i)], 1, e[d]);
        normal.add_to(-height * e[d], &row[3 * along]);
      }
    }
  }

  const Row& of(int vertex, int d) const
  {
    return velocity[static_cast<std::size_t>(2 * vertex + d)];
  }

  std::array<Vec2, 4> q{};
  std::vector<Row> velocity; ///< [vertex][direction]
};

/// Corners of a piece and their motion.
class Motion
{
public:
  Motion(const RayPair& pair, const PieceShape& shape)
      : cut_(pair.cut), shape_(shape), type_(pair.cut.type), dim_(dim_of(pair)), columns_(pair),
        size_(columns_.size()),
        planar_(type_, vertices_of(pair.cut), Frame(type_, vertices_of(pair.cut)))
  {
    const Frame frame(type_, vertices_of(pair.cut));
    const Normal normal(pair.cut);
    const InPlane cut(pair.cut, frame, normal, columns_.cut, columns_.along, size_, dim_),
        other(pair.other, frame, normal, columns_.other, columns_.along, size_, dim_);
    vertices_ = cut.q;
    least_area_ = flat * std::abs(cross(cut.q[1] - cut.q[0], cut.q[2] - cut.q[0]));
    for (const PieceCorner& corner : shape.corners)
      append_corner(corner, cut, other);
    const bool has_middle = std::ranges::any_of(
        shape.places, [](const PointPlace& place)
        { return std::ranges::find(place.corner, middle_corner) != place.corner.end(); });
    if (has_middle)
      append_middle();
    if (planar_.affine()) // U is linear, too: store V − U at corners
      for (std::size_t c = 0; c < q_.size(); ++c)
        take_off(c, cut);
    else
      for (int i = 0; i < cut_vertices(); ++i)
        for (int d = 0; d < dim_; ++d)
          velocity_.push_back(cut.of(i, d));
    uniform_ = !shape.axisymmetric && is_flat(pair.cut);
    if (uniform_)
    {
      area_slot_ = velocity_.size();
      velocity_.push_back(area_of(RayPoint{}).growth);
    }
  }

  /// δξ₁, δξ₂ and δ ln w of a point. @param out [3][column]
  void rows(std::size_t p, const RayPoint& point, std::span<double> out) const
  {
    const auto [slots, inverse, growth] = moves_with(p, point);
    const auto n = static_cast<std::size_t>(size_);
    std::ranges::fill(out, 0.0);
    const Row grows = uniform_ ? velocity_[area_slot_] : area_of(point).growth;
    std::copy_n(grows.begin(), n, out.subspan(2 * n).begin());
    for (const Slot& slot : slots)
      for (int d = 0; d < dim_; ++d)
      {
        const Row& moves = velocity_[slot.number * dim_ + d];
        for (int a = 0; a < dim_; ++a)
          for (std::size_t i = 0; i < n; ++i)
            out[a * n + i] += slot.value * inverse[a][d] * moves[i];
        for (std::size_t i = 0; i < n; ++i)
          out[2 * n + i] += slot.gradient[d] * moves[i];
      }
    for (int a = 0; a < dim_; ++a)
      for (std::size_t i = 0; i < n; ++i)
        out[2 * n + i] += growth[a] * out[a * n + i];
  }

private:
  /// Whether a facet has the same area per reference area everywhere.
  static bool is_flat(const RayFacet& facet)
  {
    if (facet.type != FacetType::quadrilateral)
      return true;
    const auto x = [&](int i) { return facet_vertex(facet.x, i); };
    const Vec3 twist = x(3) - x(1) - x(2) + x(0), side = x(3) - x(0);
    return dot(twist, twist) <= 1e-26 * dot(side, side);
  }

  /// Contribution of a slot to the motion of a point: V − U and its divergence are sums of `value`
  /// and `gradient` times the velocities of the slots.
  struct Slot
  {
    std::size_t number;
    double value;
    Vec2 gradient;
  };

  /// δ ln S at a fixed place of the facet, and ∂ ln S/∂ξ.
  struct Area
  {
    Row growth{};
    Vec2 slope{};
  };

  Area area_of(const RayPoint& point) const
  {
    Area out;
    const auto dN = trace_gradients(type_, 1, point.xi);
    const auto N = shape_functions(type_, point.xi);
    const RayFacet chord{type_, 1, vertices_of(cut_), cut_.orientation};
    const Vec3 origin = facet_vertex(cut_.x, 0);
    const auto t = forms::tangents(chord, origin, dN);
    const Vec3 s = cross(t[0], t[1]);
    const double square = dot(s, s), r = point_of(chord, Vec3{}, point.xi)[0];
    const Vec3 first = (1 / square) * cross(t[1], s), second = (1 / square) * cross(s, t[0]);
    for (int i = 0; i < cut_vertices(); ++i)
    {
      double* at = &out.growth[3 * (columns_.cut + i)];
      add(at, dN[i][0], first);
      if (dim_ == 2)
        add(at, dN[i][1], second);
      if (shape_.axisymmetric)
        at[0] += N[i] / r;
    }
    if (type_ == FacetType::quadrilateral)
    {
      Vec3 twist{};
      for (int i = 0; i < 4; ++i)
        add(twist.data(), i == 0 || i == 3 ? 1 : -1, facet_vertex(cut_.x, i) - origin);
      out.slope = {dot(s, cross(t[0], twist)) / square, dot(s, cross(twist, t[1])) / square};
    }
    if (shape_.axisymmetric)
      out.slope[0] += t[0][0] / r;
    return out;
  }

  /// @returns the slots that move a point, (∂q/∂ξ)⁻¹, and ∂ ln(S/J)/∂ξ
  std::tuple<std::vector<Slot>, Matrix2, Vec2> moves_with(std::size_t p,
                                                          const RayPoint& point) const
  {
    const PointPlace& place = shape_.places[p];
    const auto dN = trace_gradients(type_, 1, point.xi);
    const Matrix2 t = tangents(dN), inverse = inverse_of(t);
    const auto [values, gradients] = within(place);
    std::vector<Slot> out;
    for (int b = 0; b <= dim_; ++b)
      out.push_back({slot(place.corner[b]), values[b], gradients[b]});
    const auto N = shape_functions(type_, point.xi);
    for (int i = 0; i < cut_vertices() && !planar_.affine(); ++i)
      out.push_back({q_.size() + i,
                     -N[i],
                     {-dN[i][0] * inverse[0][0] - dN[i][1] * inverse[1][0],
                      -dN[i][0] * inverse[0][1] - dN[i][1] * inverse[1][1]}});
    return {out, inverse, area_of(point).slope - bending(t)};
  }

  static std::span<const double> vertices_of(const RayFacet& facet)
  {
    return facet.x.first(3 * static_cast<std::size_t>(facet.num_vertices()));
  }

  int cut_vertices() const { return static_cast<int>(type_); }

  std::size_t slot(std::uint8_t corner) const
  {
    return corner == middle_corner ? shape_.corners.size() : corner;
  }

  void append(const Vec2& q, const std::array<Row, 2>& velocity)
  {
    q_.push_back(q);
    velocity_.insert(velocity_.end(), velocity.begin(), velocity.begin() + dim_);
  }

  void append_corner(const PieceCorner& corner, const InPlane& cut, const InPlane& other)
  {
    const auto [a, b] = corner.cut;
    const auto [c, d] = corner.other;
    if (c < 0 || a < 0)
    {
      const InPlane& own = c < 0 ? cut : other;
      const int vertex = c < 0 ? a : c;
      return append(own.q[vertex], {own.of(vertex, 0), own.of(vertex, dim_ - 1)});
    }
    // V stays on both lines: V = W + t (u × (X − W))/(u × t), where the lines along t and u move
    // with W and X.
    const Vec2 t = cut.q[b] - cut.q[a], u = other.q[d] - other.q[c],
               between = other.q[c] - cut.q[a];
    const double det = cross(t, u), s = cross(between, u) / det, r = cross(between, t) / det;
    std::array<Row, 2> W, out;
    Row across; // u × (X − W)
    for (int i = 0; i < size_; ++i)
    {
      Vec2 apart;
      for (int k = 0; k < 2; ++k)
      {
        W[k][i] = (1 - s) * cut.of(a, k)[i] + s * cut.of(b, k)[i];
        apart[k] = (1 - r) * other.of(c, k)[i] + r * other.of(d, k)[i] - W[k][i];
      }
      across[i] = cross(u, apart) / -det;
    }
    for (int k = 0; k < 2; ++k)
      for (int i = 0; i < size_; ++i)
        out[k][i] = W[k][i] + t[k] * across[i];
    append(cut.q[a] + s * t, out);
  }

  /// The middle of the area between corners, m = Σ A_k m_k / Σ A_k over the triangles of a fan.
  void append_middle()
  {
    std::vector<std::size_t> around;
    for (std::size_t c = 0; c < shape_.corners.size(); ++c)
      if (shape_.corners[c].around)
        around.push_back(c);
    Vec2 middle{0, 0};
    double area = 0;
    const auto each = [&](auto use)
    {
      for (std::size_t k = 1; k + 1 < around.size(); ++k)
      {
        const std::array<std::size_t, 3> at{around[0], around[k], around[k + 1]};
        const Vec2 s = q_[at[1]] - q_[at[0]], t = q_[at[2]] - q_[at[0]];
        use(at, s, t, 0.5 * cross(s, t), (1.0 / 3) * (q_[at[0]] + q_[at[1]] + q_[at[2]]));
      }
    };
    each(
        [&](const auto&, const Vec2&, const Vec2&, double part, const Vec2& its)
        {
          middle = middle + part * its;
          area += part;
        });
    if (area <= least_area_) // all corners are at one place or on one line
      return append(q_[around[0]], {velocity_[2 * around[0]], velocity_[2 * around[0] + 1]});
    middle = (1 / area) * middle;
    std::array<Row, 2> out;
    for (Row& row : out)
      std::fill_n(row.begin(), size_, 0.0);
    each(
        [&](const auto& at, const Vec2& s, const Vec2& t, double part, const Vec2& its)
        {
          const Vec2 lever = its - middle, u = t - s;
          // Derivatives of the part's area by its corners.
          const std::array<Vec2, 3> of_area{Vec2{-0.5 * u[1], 0.5 * u[0]},
                                            Vec2{0.5 * t[1], -0.5 * t[0]},
                                            Vec2{-0.5 * s[1], 0.5 * s[0]}};
          for (int c = 0; c < 3; ++c)
            for (int d = 0; d < 2; ++d)
              for (int k = 0; k < 2; ++k)
              {
                const double factor = (of_area[c][d] * lever[k] + (d == k) * part / 3) / area;
                const Row& moves = velocity_[2 * at[c] + d];
                for (int i = 0; i < size_; ++i)
                  out[k][i] += factor * moves[i];
              }
        });
    append(middle, out);
  }

  /// Replace a corner's velocity by its velocity relative to the facet's material.
  void take_off(std::size_t c, const InPlane& cut)
  {
    if (c < shape_.corners.size() && shape_.corners[c].other[0] < 0) // a vertex of this facet
    {
      for (int d = 0; d < dim_; ++d)
        velocity_[c * dim_ + d].fill(0.0);
      return;
    }
    const auto N = shape_functions(type_, planar_.invert(q_[c]));
    for (int d = 0; d < dim_; ++d)
      for (int i = 0; i < cut_vertices(); ++i)
        for (int k = 0; k < size_; ++k)
          velocity_[c * dim_ + d][k] -= N[i] * cut.of(i, d)[k];
  }

  /// Values of the functions of a triangle's corners at a point, and their gradients.
  std::pair<std::array<double, 3>, std::array<Vec2, 3>> within(const PointPlace& place) const
  {
    const auto [x, y] = place.at;
    const Vec2 &a = q_[slot(place.corner[0])], &b = q_[slot(place.corner[1])];
    if (dim_ == 1)
    {
      const double slope = 1 / (b[0] - a[0]);
      return {{1 - x, x, 0}, {Vec2{-slope, 0}, Vec2{slope, 0}, Vec2{0, 0}}};
    }
    const Vec2 s = b - a, t = q_[slot(place.corner[2])] - a;
    const double area = cross(s, t), scale = area > least_area_ ? 1 / area : 0;
    const Vec2 of_b{scale * t[1], -scale * t[0]}, of_c{-scale * s[1], scale * s[0]};
    return {{1 - x - y, x, y}, {-1 * (of_b + of_c), of_b, of_c}};
  }

  /// ∂q/∂ξ_α; in 2D the second one is perpendicular to the line.
  Matrix2 tangents(const std::array<Vec2, max_trace>& dN) const
  {
    Matrix2 out{};
    for (int i = 0; i < cut_vertices(); ++i)
      for (int a = 0; a < 2; ++a)
        out[a] = out[a] + dN[i][a] * vertices_[i];
    if (dim_ == 1)
      out[1] = {0, 1};
    return out;
  }

  /// Derivatives of δξ_α by the velocity, [α][d].
  static Matrix2 inverse_of(const Matrix2& t)
  {
    const double scale = 1 / cross(t[0], t[1]);
    return {Vec2{scale * t[1][1], -scale * t[1][0]}, Vec2{-scale * t[0][1], scale * t[0][0]}};
  }

  /// ∂ ln J/∂ξ
  Vec2 bending(const Matrix2& t) const
  {
    if (planar_.affine())
      return {0, 0};
    const Vec2 twist = vertices_[3] - vertices_[1] - vertices_[2] + vertices_[0];
    const double scale = 1 / cross(t[0], t[1]);
    return {scale * cross(t[0], twist), scale * cross(twist, t[1])};
  }

  const RayFacet& cut_;
  const PieceShape& shape_;
  FacetType type_;
  int dim_;
  Columns columns_;
  int size_;
  PlanarFacet planar_;
  std::array<Vec2, 4> vertices_{}; ///< of the facet that is cut
  double least_area_ = 0;          ///< of a triangle that is not degenerate
  std::vector<Vec2> q_;            ///< of corners, and of the middle
  std::vector<Row> velocity_;      ///< of these, and of the facet's vertices, [slot][direction]
  bool uniform_ = false;           ///< whether δ ln S is the same at all points, a slot of its own
  std::size_t area_slot_ = 0;
};

/// Products of linear forms with the motion of the points of a piece.
class Moved
{
public:
  /// @param motions from point_motions
  Moved(const RayPair& pair, std::span<const double> motions)
      : n_(3 * static_cast<std::size_t>(pair.num_nodes())), dim_(dim_of(pair)), motions_(motions)
  {
  }

  /// @param by_xi, by_weight forms that are multiplied by δξ and δ ln w of the point
  void add_point(std::size_t p, const std::array<Row, 2>& by_xi, const Row& by_weight)
  {
    const auto of_point = motions_.subspan(3 * n_ * p, 3 * n_);
    for (int a = 0; a < dim_; ++a)
      add_row(by_xi[a], of_point.subspan(a * n_, n_));
    add_row(by_weight, of_point.subspan(2 * n_, n_));
  }

  /// @param out [column][column]
  void add_to(std::span<double> out) const
  {
    add_outer_products(left_, right_, {}, n_, n_, out.data());
  }

private:
  void add_row(const Row& form, std::span<const double> motion)
  {
    left_.insert(left_.end(), form.begin(), form.begin() + n_);
    right_.insert(right_.end(), motion.begin(), motion.end());
  }

  std::size_t n_;
  int dim_;
  std::span<const double> motions_;
  std::vector<double> left_, right_;
};
} // namespace

void qsdolfinx::point_motions(const RayPair& pair, const PieceShape& shape,
                              std::span<const RayPoint> points, std::span<double> out)
{
  std::ranges::fill(out, 0.0);
  if (shape.corners.empty())
    return;
  const Motion motion(pair, shape);
  const auto size = 9 * static_cast<std::size_t>(pair.num_nodes());
  for (std::size_t p = 0; p < points.size(); ++p)
    motion.rows(p, points[p], out.subspan(p * size, size));
}

void qsdolfinx::add_motion_of_points(const RayPair& pair, std::span<const double> motions,
                                     std::span<const RayPoint> points,
                                     std::span<const double> pressure, std::span<double> hessian)
{
  const Normal normal(pair.cut);
  const Columns columns(pair);
  Moved moved(pair, motions);
  for (std::size_t p = 0; p < points.size(); ++p)
  {
    if (pressure[p] == 0)
      continue;
    const RayByXi at(pair, normal, columns, points[p]);
    const double force = points[p].weight * pressure[p];
    const Vec3 c = -force * at.ray.A.t;
    std::array<Row, 2> by_xi;
    for (int a = 0; a < dim_of(pair); ++a)
      by_xi[a] = at.form(c, -force * at.change_of(at.ray.A.t, a), a);
    moved.add_point(p, by_xi, at.ray.form(columns, normal, c));
  }
  moved.add_to(hessian);
}

void qsdolfinx::add_slip_motion_of_points(const RayPair& pair, std::span<const double> motions,
                                          std::span<const RayPoint> points,
                                          std::span<const double> traction,
                                          std::span<double> hessian)
{
  const Normal normal(pair.cut);
  const Columns columns(pair);
  const int dim = dim_of(pair);
  Moved moved(pair, motions);
  for (std::size_t p = 0; p < points.size(); ++p)
  {
    const RayByXi at(pair, normal, columns, points[p]);
    const double w = (pair.cut_is_slave ? 1 : -1) * points[p].weight;
    const Vec3 force = w * facet_vertex(traction, static_cast<int>(p));
    const auto& A = at.ray.A.zeta;
    Vec3 c{};
    std::array<Vec3, 2> dc{};
    for (int b = 0; b < dim; ++b)
    {
      const double s = dot(force, at.ray.a[b]);
      c = c + s * A[b];
      for (int a = 0; a < dim; ++a)
        dc[a] = dc[a] + dot(force, at.da[a][b]) * A[b] + s * at.change_of(A[b], a);
    }
    std::array<Row, 2> by_xi;
    for (int a = 0; a < dim; ++a)
      by_xi[a] = at.form(c, dc[a], a);
    moved.add_point(p, by_xi, at.ray.form(columns, normal, c));
  }
  moved.add_to(hessian);
}
