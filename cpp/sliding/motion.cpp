#include "sliding/motion.h"
#include "geometry/processors.h"
#include "sliding/facing.h"
#include "sliding/forms.h"

#include <algorithm>
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
  {
    const std::array<Vec3, 2> e{frame.e0, frame.e1};
    for (int i = 0; i < facet.num_vertices(); ++i)
    {
      const Vec3 x = facet_vertex(facet.x, i);
      q[i] = frame.project(x);
      height[i] = dot(normal.n(), x - frame.origin);
      for (int d = 0; d < dim; ++d)
      {
        Row& row = velocity[2 * i + d];
        std::fill_n(row.begin(), size, 0.0);
        add(&row[3 * (first + i)], 1, e[d]);
        normal.add_to(-height[i] * e[d], &row[3 * along]);
      }
    }
  }

  const Row& of(int vertex, int d) const { return velocity[2 * vertex + d]; }

  std::array<Vec2, 4> q{};
  std::array<double, 4> height{};
  std::array<Row, 8> velocity; ///< [vertex][direction]
};

/// Corners of a piece and their motion.
class Motion
{
public:
  /// @param velocity of corners, appended
  Motion(const RayPair& pair, const PieceShape& shape, std::vector<double>& velocity)
      : cut_(pair.cut), shape_(shape), type_(pair.cut.type), dim_(dim_of(pair)), columns_(pair),
        size_(columns_.size()), frame_(type_, vertices_of(pair.cut)), normal_(pair.cut),
        first_(velocity.size()), velocity_(velocity)
  {
    const InPlane cut(pair.cut, frame_, normal_, columns_.cut, columns_.along, size_, dim_),
        other(pair.other, frame_, normal_, columns_.other, columns_.along, size_, dim_);
    vertices_ = cut.q;
    heights_ = cut.height;
    least_area_ = flat * std::abs(cross(cut.q[1] - cut.q[0], cut.q[2] - cut.q[0]));
    for (const PieceCorner& corner : shape.corners)
      append_corner(corner, cut, other);
    const bool has_middle = std::ranges::any_of(
        shape.places, [](const PointPlace& place)
        { return std::ranges::find(place.corner, middle_corner) != place.corner.end(); });
    if (has_middle)
      append_middle();
    append_facing(pair);
  }

  PointMotion of(std::size_t p, const RayPoint& point) const
  {
    const PointPlace& place = shape_.places[p];
    const auto N = shape_functions(type_, point.xi);
    const auto dN = trace_gradients(type_, 1, point.xi);
    const Matrix2 t = tangents(dN), inverse = inverse_of(t);
    const auto [values, gradients] = within(place);
    const std::array<Vec3, 2> e{frame_.e0, frame_.e1};
    PointMotion out;
    out.by_facing = by_facing_;
    for (int b = 0; b <= dim_; ++b)
    {
      out.corner[b] = slot(place.corner[b]);
      std::copy_n(gradients[b].begin(), dim_, &out.by_corner[2][2 * b]);
    }
    const Vec2 growth = add_area(point, N, dN, out.by_vertex[2]) - bending(t); // ∂ ln(S/J)/∂ξ
    std::array<Vec3, 4> spreading{}; // div U = Σ_i spreading_i·U_i
    for (int a = 0; a < dim_; ++a)
    {
      std::array<Vec3, 4> going{}; // δξ_a of U, the same sum
      Vec3 along{};
      for (int d = 0; d < dim_; ++d)
      {
        add(along.data(), inverse[a][d], e[d]);
        for (int b = 0; b <= dim_; ++b)
          out.by_corner[a][2 * b + d] = values[b] * inverse[a][d];
      }
      for (int i = 0; i < cut_vertices(); ++i)
      {
        going[i] = N[i] * along;
        add(spreading[i].data(), dN[i][a], along);
      }
      take_off(going, out.by_vertex[a]);
    }
    take_off(spreading, out.by_vertex[2]);
    const auto add_growth = [&](auto& by)
    {
      for (int a = 0; a < dim_; ++a)
        for (std::size_t i = 0; i < by[a].size(); ++i)
          by[2][i] += growth[a] * by[a][i];
    };
    add_growth(out.by_corner);
    add_growth(out.by_vertex);
    return out;
  }

private:
  using OfVertices = std::array<double, 3 * 4>;

  /// Subtract Σ_i k_i·U_i, k_i being vectors in the plane.
  void take_off(const std::array<Vec3, 4>& k, OfVertices& row) const
  {
    Vec3 lever{};
    for (int i = 0; i < cut_vertices(); ++i)
    {
      add(&row[3 * i], -1, k[i]);
      lever = lever + heights_[i] * k[i];
    }
    normal_.add_to(lever, row.data());
  }

  /// Add δ ln S at a fixed place of the facet. @returns ∂ ln S/∂ξ
  Vec2 add_area(const RayPoint& point, const std::array<double, 4>& N,
                const std::array<Vec2, max_trace>& dN, OfVertices& row) const
  {
    const RayFacet chord{type_, 1, vertices_of(cut_), cut_.orientation};
    const Vec3 origin = facet_vertex(cut_.x, 0);
    const auto t = forms::tangents(chord, origin, dN);
    const Vec3 s = cross(t[0], t[1]);
    const double square = dot(s, s),
                 r = shape_.axisymmetric ? point_of(chord, Vec3{}, point.xi)[0] : 0;
    const Vec3 first = (1 / square) * cross(t[1], s), second = (1 / square) * cross(s, t[0]);
    for (int i = 0; i < cut_vertices(); ++i)
    {
      add(&row[3 * i], dN[i][0], first);
      if (dim_ == 2)
        add(&row[3 * i], dN[i][1], second);
      if (shape_.axisymmetric)
        row[3 * i] += N[i] / r;
    }
    Vec2 slope{};
    if (type_ == FacetType::quadrilateral)
    {
      Vec3 twist{};
      for (int i = 0; i < 4; ++i)
        add(twist.data(), i == 0 || i == 3 ? 1 : -1, facet_vertex(cut_.x, i) - origin);
      slope = {dot(s, cross(t[0], twist)) / square, dot(s, cross(twist, t[1])) / square};
    }
    if (shape_.axisymmetric)
      slope[0] += t[0][0] / r;
    return slope;
  }

  static std::span<const double> vertices_of(const RayFacet& facet)
  {
    return facet.x.first(3 * static_cast<std::size_t>(facet.num_vertices()));
  }

  int cut_vertices() const { return static_cast<int>(type_); }

  std::uint8_t slot(std::uint8_t corner) const
  {
    return corner == middle_corner ? static_cast<std::uint8_t>(shape_.corners.size()) : corner;
  }

  /// Velocity of a corner.
  const double* of_corner(std::size_t corner, int d) const
  {
    return &velocity_[first_ + (corner * dim_ + d) * size_];
  }

  void append(const Vec2& q, const Row& first, const Row& second)
  {
    q_.push_back(q);
    velocity_.insert(velocity_.end(), first.begin(), first.begin() + size_);
    if (dim_ == 2)
      velocity_.insert(velocity_.end(), second.begin(), second.begin() + size_);
  }

  void append_corner(const PieceCorner& corner, const InPlane& cut, const InPlane& other)
  {
    const auto [a, b] = corner.cut;
    const auto [c, d] = corner.other;
    if (c < 0 || a < 0)
    {
      const InPlane& own = c < 0 ? cut : other;
      const int vertex = c < 0 ? a : c;
      return append(own.q[vertex], own.of(vertex, 0), own.of(vertex, dim_ - 1));
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
    append(cut.q[a] + s * t, out[0], out[1]);
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
    std::array<Row, 2> out;
    if (area <= least_area_) // all corners are at one place or on one line
    {
      for (int d = 0; d < 2; ++d)
        std::copy_n(of_corner(around[0], d), size_, out[d].begin());
      return append(q_[around[0]], out[0], out[1]);
    }
    middle = (1 / area) * middle;
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
                const double* moves = of_corner(at[c], d);
                for (int i = 0; i < size_; ++i)
                  out[k][i] += factor * moves[i];
              }
        });
    append(middle, out[0], out[1]);
  }

  /// Rotation of the facets towards each other, if the weights depend on it.
  void append_facing(const RayPair& pair)
  {
    const Normal other(pair.other);
    const auto [value, slope] = facing_weight(-dot(normal_.n(), other.n()));
    if (slope == 0)
      return;
    by_facing_ = slope / value;
    velocity_.resize(velocity_.size() + static_cast<std::size_t>(size_), 0.0);
    double* row = &velocity_[velocity_.size() - static_cast<std::size_t>(size_)];
    normal_.add_to(-1 * other.n(), row + 3 * columns_.cut);
    other.add_to(-1 * normal_.n(), row + 3 * columns_.other);
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
    if (type_ != FacetType::quadrilateral)
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
  Frame frame_;
  Normal normal_;
  std::array<Vec2, 4> vertices_{};  ///< of the facet that is cut
  std::array<double, 4> heights_{}; ///< of these above the plane
  double least_area_ = 0;           ///< of a triangle that is not degenerate
  std::vector<Vec2> q_;             ///< of corners, and of the middle
  std::size_t first_;
  std::vector<double>& velocity_; ///< of these, from `first_` on
  double by_facing_ = 0;          ///< see PointMotion
};
} // namespace

QSDOLFINX_FOR_PROCESSORS
void qsdolfinx::append_motions(const RayPair& pair, const PieceShape& shape,
                               std::span<const RayPoint> points, std::vector<double>& velocity,
                               std::vector<PointMotion>& motions)
{
  const Motion motion(pair, shape, velocity);
  for (std::size_t p = 0; p < points.size(); ++p)
    motions.push_back(motion.of(p, points[p]));
}
