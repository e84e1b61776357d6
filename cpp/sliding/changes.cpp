#include "sliding/changes.h"
#include "geometry/processors.h"

#include <algorithm>

using namespace qsdolfinx;
using namespace qsdolfinx::forms;

namespace
{
/// Variations of the place and the weight of a point, from those of the corners of its triangle and
/// of the vertices of its facet.
[[gnu::always_inline]] inline void set_motion(const PieceMotion& piece, std::size_t point,
                                              const RayPair& pair, const Columns& columns,
                                              RayChange& out)
{
  const auto n = static_cast<std::size_t>(columns.size()),
             dim = static_cast<std::size_t>(dim_of(pair)),
             first = 3 * static_cast<std::size_t>(columns.cut),
             of_vertices = 3 * static_cast<std::size_t>(pair.cut.num_vertices());
  const PointMotion& motion = piece.points[point];
  const std::array<double*, 3> to{out.xi[0].data(), out.xi[1].data(), out.ln_weight.data()};
  for (std::size_t b = 0; b <= dim; ++b)
    for (std::size_t d = 0; d < dim; ++d)
    {
      const double* velocity = &piece.velocity[(motion.corner[b] * dim + d) * n];
      for (std::size_t a = 0; a < 3; ++a)
        (b + d == 0 ? set_rows<1> : add_rows<1>)(to[a], n, {motion.by_corner[a][2 * b + d]},
                                                 {velocity});
    }
  for (std::size_t a = 0; a < 3; ++a)
    add_rows<1>(to[a] + first, of_vertices, {1.0}, {motion.by_vertex[a].data()});
  if (motion.by_facing != 0)
    add_rows<1>(to[2], n, {motion.by_facing}, {piece.velocity.data() + piece.velocity.size() - n});
}

/// Add k·Δa_α, a_α being the tangents at the end of a ray.
/// @param bent k·∂²x_z/∂ζ², see bending
[[gnu::always_inline]] inline void add_tangent(const Ray& ray, const Columns& columns,
                                               const RayChange& change, int alpha, const Vec3& k,
                                               const Vec3& bent, double* row)
{
  for (int j = 0; j < columns.num_other; ++j)
    ::add(row + 3 * (columns.other + j), ray.dM[j][alpha], k);
  const Vec2 by_zeta{bent[alpha], bent[alpha + 1]};
  if (by_zeta[0] != 0 || by_zeta[1] != 0)
    add_rows<2>(row, static_cast<std::size_t>(columns.size()), {by_zeta[0], by_zeta[1]},
                {change.zeta[0].data(), change.zeta[1].data()});
}
} // namespace

QSDOLFINX_FOR_PROCESSORS
void qsdolfinx::change_of_ray(const Rays& rays, std::size_t point, const PieceMotion& motion,
                              RayChange& out)
{
  const auto& [pair, points, normal, columns, all] = rays;
  const Ray& ray = all[point];
  const auto n = static_cast<std::size_t>(columns.size());
  std::array<Vec3, 2> along{};
  if (motion.points.empty())
    for (Row* row : {&out.xi[0], &out.xi[1], &out.ln_weight})
      std::fill_n(row->begin(), n, 0.0);
  else
  {
    set_motion(motion, point, pair, columns, out);
    along = tangents_at(pair.cut, points[point].xi);
  }
  std::array<Row, 3> v; // and what points that move add to it
  for (int r = 0; r < 3; ++r)
  {
    Vec3 axis{};
    axis[r] = 1;
    v[r] = ray.form(columns, normal, axis);
    add_rows<2>(v[r].data(), n, {along[0][r], along[1][r]}, {out.xi[0].data(), out.xi[1].data()});
  }
  const std::array<const double*, 3> rows{v[0].data(), v[1].data(), v[2].data()};
  set_rows<3>(out.t.data(), n, ray.A.t, rows);
  for (int a = 0; a < 2; ++a)
    set_rows<3>(out.zeta[a].data(), n, ray.A.zeta[a], rows);
}

RayForces::RayForces(const Rays& rays, std::size_t width, std::span<double> matrix)
    : rays_(rays), width_(width), matrix_(matrix.data())
{
  for (WideRow& row : lever_changes_)
    std::fill_n(row.begin(), width, 0.0);
}

QSDOLFINX_FOR_PROCESSORS
void RayForces::add(std::size_t point, const RayChange& change, const RayStress& stress,
                    std::span<const WideRow> changes)
{
  const auto& [pair, points, normal, columns, all] = rays_;
  const Ray& ray = all[point];
  const std::size_t n = static_cast<std::size_t>(columns.size()), width = width_;
  const Vec3& n_ray = normal.n();
  const double s = pair.cut_is_slave ? 1 : -1, p = stress.pressure;
  const Vec3 tau = s * stress.traction;
  const bool is_raised = pair.is_raised(), slides = changes.size() > 1;
  const RayLift lift = lift_of(pair, points[point].zeta);
  const auto& [slope, bent_up] = lift;
  // f = Σ φ_k A_k
  const Vec3 rises = slope[0] * ray.A.zeta[0] + slope[1] * ray.A.zeta[1];
  const Vec3 f = p * (rises - ray.A.t) + dot(rises, tau) * ray.A.t
                 + dot(ray.a[0], tau) * ray.A.zeta[0] + dot(ray.a[1], tau) * ray.A.zeta[1];
  WideRow by_t, by_first, by_second; // Δφ_k, and from φ_k ΔA_k what multiplies A_k
  const std::array<double*, 3> by{by_t.data(), by_first.data(), by_second.data()};
  const std::array<Vec3, 3> of_tau{rises, ray.a[0], ray.a[1]};
  const Vec3 of_pressure{-1, slope[0], slope[1]};
  for (std::size_t k = 0; k < 3; ++k)
  {
    set_rows<1>(by[k], width, {of_pressure[k]}, {changes[0].data()});
    if (slides)
      add_rows<3>(by[k], width, s * of_tau[k],
                  {changes[1].data(), changes[2].data(), changes[3].data()});
    const double grows = of_pressure[k] * p + dot(of_tau[k], tau);
    add_rows<1>(by[k], n, {grows}, {change.ln_weight.data()});
    // τ stays in the plane across n: n·Δτ = −τ·Δn.
    normal.add_to((k == 0 ? f : Vec3{}) - dot(of_tau[k], n_ray) * tau, by[k] + 3 * columns.along);
  }
  const Vec3 turned = tau - f, bent = bending(pair.other, points[point].zeta, turned);
  for (int alpha = 0; alpha < dim_of(pair); ++alpha)
    add_tangent(ray, columns, change, alpha, turned, bent, by[1 + alpha]);
  if (is_raised)
  {
    const Vec2 across{dot(ray.A.zeta[0], tau), dot(ray.A.zeta[1], tau)};
    const Vec3 bent_rises = bending(pair.other, points[point].zeta, rises);
    normal.add_to(dot(ray.A.t, tau) * rises, by[0] + 3 * columns.along);
    for (int beta = 0; beta < dim_of(pair); ++beta)
    {
      add_tangent(ray, columns, change, beta, -across[beta] * rises, -across[beta] * bent_rises,
                  by[0]);
      const Vec3 by_zeta{across[0] * bent_up[0][beta] + across[1] * bent_up[1][beta],
                         p * bent_up[0][beta], p * bent_up[1][beta]};
      for (std::size_t k = 0; k < 3; ++k)
        add_rows<1>(by[k], n, {by_zeta[k]}, {change.zeta[beta].data()});
    }
  }
  std::array<WideRow, 3> df;
  for (int r = 0; r < 3; ++r)
  {
    set_rows<3>(df[r].data(), width, {ray.A.t[r], ray.A.zeta[0][r], ray.A.zeta[1][r]},
                {by[0], by[1], by[2]});
    add_rows<1>(lever_changes_[r].data(), width, {ray.t}, {df[r].data()});
    add_rows<1>(lever_changes_[r].data(), n, {f[r]}, {change.t.data()});
  }
  lever_ = lever_ + ray.t * f;
  const auto push = [&](int node, double function, const Vec2& slopes, const auto& place)
  {
    Row moved;
    set_rows<2>(moved.data(), n, slopes, {place[0].data(), place[1].data()});
    for (int r = 0; r < 3; ++r)
    {
      double* to = matrix_ + static_cast<std::size_t>(3 * node + r) * width;
      add_rows<2>(to, n, {function, f[r]}, {df[r].data(), moved.data()});
      add_rows<1>(to + n, width - n, {function}, {df[r].data() + n});
    }
  };
  const auto dT = trace_gradients(pair.cut.type, pair.cut.degree, points[point].xi);
  for (int i = 0; i < columns.num_cut; ++i)
    push(columns.cut + i, ray.T[i], dT[i], change.xi);
  for (int j = 0; j < columns.num_other; ++j)
    push(columns.other + j, -ray.M[j], {-ray.dM[j][0], -ray.dM[j][1]}, change.zeta);
}

/// With C = Σ t f, C·∂²n = (C − n (n·C))·∂²s/|s| − ((C·δn)(n·Δs) + (C·Δn)(n·δs))/|s| − (C·n) δn·Δn.
QSDOLFINX_FOR_PROCESSORS
void RayForces::finish()
{
  const Normal& normal = rays_.normal;
  const int count = 3 * normal.num_vertices(), first = 3 * rays_.columns.along;
  std::array<double, 12 * 12> half{};
  std::array<double, 12> area{}, across{};
  normal.add_half_curvature(normal.across(lever_), half.data(), count);
  normal.add_area(normal.n(), area.data());
  normal.add_to(lever_, across.data());
  const double turn = 0.5 * dot(lever_, normal.n());
  for (int r = 0; r < 3; ++r)
  {
    const auto& dn = normal.gradient(r);
    for (int a = 0; a < count; ++a)
    {
      add_rows<1>(matrix_ + static_cast<std::size_t>(first + a) * width_, width_, {dn[a]},
                  {lever_changes_[r].data()});
      for (int b = 0; b < count; ++b)
        half[a * count + b] -= turn * dn[a] * dn[b];
    }
  }
  for (int a = 0; a < count; ++a)
    for (int b = 0; b < count; ++b)
      matrix_[static_cast<std::size_t>(first + a) * width_ + static_cast<std::size_t>(first + b)]
          += half[a * count + b] + half[b * count + a]
             - (across[a] * area[b] + area[a] * across[b]) / normal.length();
}
