#include "surface/curvature.h"
#include "parallel/exchange.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <petscblaslapack.h>

using namespace qsdolfinx;

namespace
{
/// Vertices that are connected with vertex i by an edge; an interval has one.
std::array<int, 2> neighbours(FacetType type, int i)
{
  if (type == FacetType::interval)
    return {1 - i, 1 - i};
  if (type == FacetType::triangle)
    return {(i + 1) % 3, (i + 2) % 3};
  return {i ^ 1, i ^ 2};
}

/// Data of a facet at one of its vertices, sent to the vertex's owner.
struct Corner
{
  Vec3 normal;               ///< outward
  Vec3 weighted;             ///< with Max's weight; in 2D 1/length, which is the same for a circle
  double angle;              ///< of the facet at the vertex
  std::array<Vec3, 2> edges; ///< to the neighbours
  Vec3 diagonal;             ///< of a quadrilateral, to the opposite vertex
};

/// Data of the surface at a vertex, computed by the vertex's owner for one facet.
struct Vertex
{
  Vec3 normal;                ///< without the facets beyond a sharp edge
  double closed;              ///< 1 if facets surround the vertex
  double straight;            ///< 1 if the facets end there, along a nearly straight line
  std::array<double, 2> ends; ///< whether the facets end at the edge to each of the neighbours
  Curvature curvature;        ///< from a fit to the neighbours, if that was asked for
};

/// Surface near a vertex.
struct Fitted
{
  Vec3 normal;
  Curvature curvature;
};

constexpr int corner_width = sizeof(Corner) / sizeof(double);
constexpr int vertex_width = sizeof(Vertex) / sizeof(double);

Corner corner(const Surface& surface, std::size_t f, int i)
{
  const auto v = surface.facet_x(f);
  const FacetType type = surface.type();
  const auto [j, k] = neighbours(type, i);
  const Vec3 a = facet_vertex(v, j) - facet_vertex(v, i),
             b = facet_vertex(v, k) - facet_vertex(v, i);
  const Vec3 n = surface.normal(f, facet_centre(type));
  if (type == FacetType::interval)
    return {n, (1 / norm(a)) * n, std::numbers::pi, {a, b}, {}};
  const Vec3 d = type == FacetType::triangle ? Vec3{} : facet_vertex(v, 3 - i) - facet_vertex(v, i);
  const Vec3 c = cross(a, b);
  if (norm(c) == 0) // the edges are collinear
    return {n, {0, 0, 0}, std::numbers::pi, {a, b}, d};
  const double side = dot(c, n) < 0 ? -1 : 1; // the neighbours may be in either order
  return {(side / norm(c)) * c,
          (side / (dot(a, a) * dot(b, b))) * c,
          std::atan2(norm(c), dot(a, b)),
          {a, b},
          d};
}

/// k₁₁ a aᵀ + k₁₂ (a bᵀ + b aᵀ) + k₂₂ b bᵀ.
Curvature tensor(const Vec3& a, const Vec3& b, double k11, double k12, double k22)
{
  const auto entry = [&](int i, int j)
  { return k11 * a[i] * a[j] + k12 * (a[i] * b[j] + b[i] * a[j]) + k22 * b[i] * b[j]; };
  return {entry(0, 0), entry(1, 1), entry(2, 2), entry(0, 1), entry(0, 2), entry(1, 2)};
}

/// Correct a normal by a least-squares fit of a quadric to the neighbouring vertices: with t₁, t₂
/// perpendicular to n and e the vector to a neighbour, e·(n + α t₁ + β t₂) + ½ e·K e = 0. Mean
/// normals of facets of different sizes have an error proportional to the angle between the facets.
Fitted fitted(const Vec3& n, std::span<const Vec3> edges)
{
  constexpr int size = 5;
  // Damping for directions that the neighbours do not determine: if there are few neighbours, the
  // normal stays the same (tests/tools/test_elevate.py, a strip).
  constexpr std::array<double, size> damping{1e-3, 1e-3, 1e-6, 1e-6, 1e-6};
  const Vec3 first = edges[0] - dot(edges[0], n) * n;
  const Vec3 t1 = (1 / norm(first)) * first, t2 = cross(n, t1);
  double length = 0;
  for (const Vec3& e : edges)
    length += norm(e) / static_cast<double>(edges.size());
  std::array<std::array<double, size>, size> A{};
  std::array<double, size> b{};
  for (const Vec3& e : edges)
  {
    const double x = dot(e, t1) / length, y = dot(e, t2) / length, z = dot(e, n) / length,
                 weight = 1 / (x * x + y * y + z * z);
    const std::array<double, size> row{x, y, x * x / 2, x * y / std::numbers::sqrt2, y * y / 2};
    for (int i = 0; i < size; ++i)
    {
      b[i] -= weight * row[i] * z;
      for (int j = 0; j < size; ++j)
        A[i][j] += weight * row[i] * row[j];
    }
  }
  for (int i = 0; i < size; ++i)
    A[i][i] += damping[i] * static_cast<double>(edges.size());
  PetscBLASInt order = size, one = 1, info = 0;
  LAPACKpotrf_("U", &order, A[0].data(), &order, &info);
  if (info != 0)
    return {n, {}};
  LAPACKpotrs_("U", &order, &one, A[0].data(), &order, b.data(), &order, &info);
  const Vec3 sum = n + b[0] * t1 + b[1] * t2;
  const double k11 = b[2] / length, k12 = b[3] / (std::numbers::sqrt2 * length),
               k22 = b[4] / length;
  return {(1 / norm(sum)) * sum, tensor(t1, t2, k11, k12, k22)};
}

/// Compute the data of the surface at a vertex for facet r of those at the vertex.
/// @param star all facets at the vertex
/// @param edges the neighbours' unknowns of each facet
/// @param fit whether normals are fitted to the positions of the neighbours
/// @param seen, around reused storage
Vertex look(FacetType type, std::span<const std::size_t> star, std::size_t r,
            const std::vector<Corner>& corners, const std::vector<std::int64_t>& edges, bool fit,
            std::vector<std::int64_t>& seen, std::vector<Vec3>& around)
{
  Vec3 sum{0, 0, 0};
  double angle = 0;
  std::size_t facets = 0;
  seen.clear();
  around.clear();
  for (std::size_t s : star)
  {
    if (dot(corners[s].normal, corners[r].normal) < smooth_cosine)
      continue;
    sum = sum + corners[s].weighted;
    angle += corners[s].angle;
    ++facets;
    for (std::size_t i = 0; i < 2; ++i)
    {
      if (std::ranges::find(seen, edges[2 * s + i]) == seen.end())
        around.push_back(corners[s].edges[i]);
      seen.push_back(edges[2 * s + i]);
    }
    if (type == FacetType::quadrilateral)
      around.push_back(corners[s].diagonal);
  }
  const double length = norm(sum);
  Vec3 n = length > 0 ? (1 / length) * sum : corners[r].normal;
  if (type == FacetType::interval)
    return {n, facets > 1 ? 1.0 : 0.0, 0, {0, 0}, {}};
  Curvature K{};
  if (fit && around.size() > 2)
  {
    const Fitted found = fitted(n, around);
    n = found.normal;
    K = found.curvature;
  }
  const auto once = [&](std::int64_t edge) { return std::ranges::count(seen, edge) == 1; };
  const double closed = std::ranges::none_of(seen, once) ? 1 : 0;
  const double straight = std::abs(angle - std::numbers::pi) < std::numbers::pi / 6 ? 1 : 0;
  return {
      n, closed, straight, {once(edges[2 * r]) ? 1.0 : 0.0, once(edges[2 * r + 1]) ? 1.0 : 0.0}, K};
}

/// Compute the data of the surface for each facet at its vertices, [facet][vertex]. Collective.
/// @param fit see look
std::vector<Vertex> look_around(const Surface& surface, bool fit)
{
  const Facets& facets = surface.facets();
  const int nv = surface.num_vertices(), d = surface.gdim();
  const std::size_t n = surface.num_facets() * nv;
  std::vector<double> told;
  std::vector<std::int64_t> names; // of the vertex and its neighbours
  told.reserve(n * corner_width);
  names.reserve(3 * n);
  for (std::size_t f = 0; f < surface.num_facets(); ++f)
    for (int i = 0; i < nv; ++i)
    {
      const Corner c = corner(surface, f, i);
      const double* first = c.normal.data();
      told.insert(told.end(), first, first + 3);
      told.insert(told.end(), c.weighted.begin(), c.weighted.end());
      told.push_back(c.angle);
      for (const Vec3& edge : {c.edges[0], c.edges[1], c.diagonal})
        told.insert(told.end(), edge.begin(), edge.end());
      const auto [j, k] = neighbours(surface.type(), i);
      for (int vertex : {i, j, k})
        names.push_back(facets.vertex_dofs[(f * nv + vertex) * d]);
    }
  const Exchange to_owner(surface.comm(), facets.vertex_owner);
  const auto data = to_owner.forward<double>(told, corner_width);
  const auto named = to_owner.forward<std::int64_t>(names, 3);

  const std::size_t received = to_owner.num_received();
  std::vector<Corner> corners;
  std::vector<std::int64_t> edges;
  std::vector<std::size_t> order;
  for (std::size_t r = 0; r < received; ++r)
  {
    const double* c = data.data() + r * corner_width;
    corners.push_back({{c[0], c[1], c[2]},
                       {c[3], c[4], c[5]},
                       c[6],
                       {Vec3{c[7], c[8], c[9]}, Vec3{c[10], c[11], c[12]}},
                       {c[13], c[14], c[15]}});
    edges.insert(edges.end(), {named[3 * r + 1], named[3 * r + 2]});
    order.push_back(r);
  }
  const auto name = [&](std::size_t r) { return named[3 * r]; };
  std::ranges::sort(order, {}, name);
  std::vector<double> answers(received * vertex_width);
  std::vector<std::int64_t> seen;
  std::vector<Vec3> around;
  for (std::size_t first = 0, last = 0; first < received; first = last)
  {
    while (last < received && name(order[last]) == name(order[first]))
      ++last;
    const auto star = std::span(order).subspan(first, last - first);
    for (std::size_t r : star)
    {
      const Vertex v = look(surface.type(), star, r, corners, edges, fit, seen, around);
      const std::array<double, 7> values{v.normal[0], v.normal[1], v.normal[2], v.closed,
                                         v.straight,  v.ends[0],   v.ends[1]};
      const auto next = std::ranges::copy(values, answers.begin() + r * vertex_width).out;
      std::ranges::copy(v.curvature, next);
    }
  }
  const auto back = to_owner.reverse<double>(answers, vertex_width);
  std::vector<Vertex> out;
  out.reserve(n);
  for (std::size_t i = 0; i < n; ++i)
  {
    const double* v = back.data() + i * vertex_width;
    out.push_back({{v[0], v[1], v[2]}, v[3], v[4], {v[5], v[6]}, {}});
    std::copy_n(v + 7, out.back().curvature.size(), out.back().curvature.begin());
  }
  return out;
}

/// Mean of two values, limited to twice the value nearer to zero; zero if the signs differ.
double limited_mean(double a, double b)
{
  if (a * b <= 0)
    return 0;
  const double least = std::min(2 * std::min(std::abs(a), std::abs(b)), std::abs(a + b) / 2);
  return a > 0 ? least : -least;
}

/// Least-squares fit of the tensor in the plane of a facet, with the smallest norm.
class Fit
{
public:
  Fit(const Vec3& normal, const Vec3& direction)
  {
    first_ = direction - dot(direction, normal) * normal;
    first_ = (1 / norm(first_)) * first_;
    second_ = cross(normal, first_);
  }

  /// Add e·K e = value; e in units of the facet's size.
  void add(const Vec3& e, double value)
  {
    const double a = dot(e, first_), b = dot(e, second_);
    const Vec3 row{a * a, std::numbers::sqrt2 * a * b, b * b};
    for (int i = 0; i < 3; ++i)
    {
      matrix_[i] = matrix_[i] + row[i] * row;
      right_[i] += value * row[i];
    }
  }

  Curvature solve() const
  {
    // Determines components that the data do not determine, and hardly changes the others.
    constexpr double regularisation = 1e-6;
    const double more = regularisation * (matrix_[0][0] + matrix_[1][1] + matrix_[2][2]);
    if (more == 0)
      return {};
    auto A = matrix_;
    for (int i = 0; i < 3; ++i)
      A[i][i] += more;
    const double det = dot(A[0], cross(A[1], A[2]));
    // Cramer's rule: the inverse has the rows' cross products as columns.
    const Vec3 k = (1 / det)
                   * (right_[0] * cross(A[1], A[2]) + right_[1] * cross(A[2], A[0])
                      + right_[2] * cross(A[0], A[1]));
    const double k12 = k[1] / std::numbers::sqrt2;
    return tensor(first_, second_, k[0], k12, k[2]);
  }

private:
  Vec3 first_, second_;
  std::array<Vec3, 3> matrix_{};
  Vec3 right_{0, 0, 0};
};

/// The line between two vertices of a facet: the slope of the surface out of the facet at both
/// ends, times the length of the line, and whether this slope is known at the vertices.
struct Ascent
{
  /// @param n the facet's normal
  Ascent(FacetType type, std::span<const double> v, const Vec3& n, std::span<const Vertex> vertices,
         int i, int j)
  {
    const Vec3 e = facet_vertex(v, j) - facet_vertex(v, i);
    const auto knows = [&](int here, int there)
    {
      if (vertices[here].closed > 0)
        return true;
      const auto to = neighbours(type, here);
      for (int side = 0; side < 2; ++side)
        if (to[side] == there && vertices[here].ends[side] > 0)
          return vertices[here].straight > 0;
      return false;
    };
    const auto slope = [&](int at)
    { return dot(vertices[at].normal, e) / std::max(dot(vertices[at].normal, n), 0.5); };
    known = {knows(i, j), knows(j, i)};
    at = {-slope(i), slope(j)}; // ascends from the facet at i, descends to it at j
  }

  /// Limited mean of both ends; the value of one end if the other is not known; 0 if neither is
  /// known.
  double mean() const
  {
    if (known[0] && known[1])
      return limited_mean(at[0], at[1]);
    return known[0] ? at[0] : known[1] ? at[1] : 0.0;
  }

  std::array<bool, 2> known;
  std::array<double, 2> at;
};

Curvature curvature_of(const Surface& surface, std::size_t f, std::span<const Vertex> vertices)
{
  const auto v = surface.facet_x(f);
  const FacetType type = surface.type();
  const Vec3 n = surface.normal(f, facet_centre(type));
  const double size = surface.facets().size[f];
  Fit fit(n, facet_vertex(v, 1) - facet_vertex(v, 0));
  for (int i = 0; i < static_cast<int>(type); ++i)
    for (int j = 0; j < i; ++j)
      if (const Ascent line(type, v, n, vertices, i, j); line.known[0] || line.known[1])
      {
        const Vec3 e = facet_vertex(v, j) - facet_vertex(v, i);
        fit.add((1 / size) * e, 2 * line.mean() / (size * size));
      }
  return fit.solve();
}
} // namespace

std::vector<Curvature> qsdolfinx::facet_curvature(const Surface& surface)
{
  const std::vector<Vertex> vertices = look_around(surface, false);
  const auto nv = static_cast<std::size_t>(surface.num_vertices());
  std::vector<Curvature> out;
  out.reserve(surface.num_facets());
  for (std::size_t f = 0; f < surface.num_facets(); ++f)
    out.push_back(curvature_of(surface, f, std::span(vertices).subspan(f * nv, nv)));
  return out;
}

std::vector<double> qsdolfinx::edge_heights(const Surface& surface)
{
  constexpr double guess = 1e-6; // weight of a height that only the slopes at boundaries give
  const std::vector<Vertex> vertices = look_around(surface, true);
  const FacetType type = surface.type();
  const auto nv = static_cast<std::size_t>(surface.num_vertices());
  std::vector<double> out;
  for (std::size_t f = 0; f < surface.num_facets(); ++f)
  {
    const auto v = surface.facet_x(f);
    const Vec3 n = surface.normal(f, facet_centre(type));
    for (const auto& [i, j] : facet_edges(type))
    {
      const Ascent line(type, v, n, std::span(vertices).subspan(f * nv, nv), i, j);
      const Vec3 e = facet_vertex(v, j) - facet_vertex(v, i);
      const double length = norm(e);
      double slope = line.mean(), weight = 1;
      if (!line.known[0] && !line.known[1])
      {
        // Where a corner of the surface is cut off, the slope across its boundary is not known at
        // either end, but perhaps the curvature at the third vertex. Between two boundaries, it is
        // not known anywhere.
        double sum = 0, count = 0;
        for (std::size_t k = f * nv; k < (f + 1) * nv; ++k)
          if (vertices[k].closed > 0)
          {
            sum += along(vertices[k].curvature, e);
            ++count;
          }
        const double more = std::abs(line.at[0]) > std::abs(line.at[1]) ? line.at[0] : line.at[1];
        // An arc of curvature κ starts at an angle to its chord whose sine is ½ κ l; at most 30°
        // here.
        const double sine = count > 0 ? std::clamp(sum / (2 * count * length), -0.5, 0.5) : 0;
        slope = count > 0 ? length * sine / std::sqrt(1 - sine * sine) : more;
        weight = count > 0 ? 1 : guess;
      }
      // For an arc that starts at the angle φ to its chord of length l, the height is ½ l tan ½φ.
      out.insert(out.end(), {0.5 * length * slope / (length + std::hypot(length, slope)), weight});
    }
  }
  return out;
}

double qsdolfinx::along(const Curvature& K, const Vec3& e)
{
  return K[0] * e[0] * e[0] + K[1] * e[1] * e[1] + K[2] * e[2] * e[2]
         + 2 * (K[3] * e[0] * e[1] + K[4] * e[0] * e[2] + K[5] * e[1] * e[2]);
}

double qsdolfinx::bulge(const Curvature& K, FacetType type, std::span<const double> v,
                        const std::array<double, 4>& N)
{
  double sum = 0;
  for (int i = 0; i < static_cast<int>(type); ++i)
    for (int j = 0; j < i; ++j)
      sum += N[i] * N[j] * along(K, facet_vertex(v, j) - facet_vertex(v, i));
  return sum / 2;
}

Curvature qsdolfinx::shared_curvature(const Curvature& a, const Curvature& b)
{
  Curvature out;
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i] = (a[i] - b[i]) / 2;
  return out;
}
