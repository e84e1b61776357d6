#include "tangent/piece_matrix.h"
#include "gap/piece_forces.h"
#include "geometry/processors.h"
#include "sliding/rise.h"

#include <algorithm>

using namespace qsdolfinx;

namespace
{
bool any(std::span<const double> values)
{
  return std::ranges::any_of(values, [](double value) { return value != 0; });
}

[[gnu::always_inline]] inline void add_row(double* to, double factor, const double* row,
                                           std::size_t n)
{
  forms::add_rows<1>(to, n, {factor}, {row});
}
} // namespace

PieceMatrix::PieceMatrix(const Pieces& pieces, const SlipOfPieces* slip, const PointState& at,
                         bool own)
    : pieces_(pieces), slip_(slip), at_(at), own_(own), m_(at.components),
      n_(3 * static_cast<std::size_t>(pieces.slave.num_nodes + pieces.master.num_nodes)),
      nk_(own ? 1 : static_cast<std::size_t>(pieces.num_multipliers)), size_(n_ + m_ * nk_),
      has_functions_(!at.own.empty()), matrix_(size_ * size_), turn_(3 * n_), slips_(3 * n_),
      spin_(n_)
{
  const std::vector<std::int64_t> of_sides = side_dofs(pieces);
  for (Vec field : at.fields)
    lambda_.push_back(field ? values_at(field, of_sides) : std::vector<double>());
  lambda_.resize(m_);
  for (Vec missing : at.missing)
    missing_.push_back(values_at(missing, of_sides));
  missing_.resize(m_);
  for (Vec field : at.begun)
    begun_.push_back(values_at(field, of_sides));
}

std::span<const double> PieceMatrix::of(std::size_t piece, std::size_t first)
{
  piece_ = piece;
  first_ = first;
  points_ = pieces_.points_of(piece);
  const RayPair pair = pair_of(pieces_, piece);
  set_piece(pair);
  const Rays rays(pair, points_);
  RayForces forces(rays, size_, matrix_);
  for (std::size_t p = 0; p < points_.size(); ++p)
  {
    const bool pushes = has_force(p);
    if (!pushes && !has_functions_)
      continue;
    change_of_ray(rays, p, {velocity_, motions_}, change_);
    set_place(p);
    set_trials(rays, p);
    set_stresses(p);
    if (has_functions_)
      add_equations(p);
    if (!pushes)
      continue;
    for (std::size_t c = 0; c < m_; ++c)
      for (std::size_t i = 0; i < size_; ++i)
        stresses_[c][i] *= at_.gamma[c];
    forces.add(p, change_, stress_of(p), std::span(stresses_).first(m_));
  }
  forces.finish();
  if (has_functions_ && !at_.turning.empty())
    add_turning();
  if (at_.moves && pair.is_raised())
    add_rise(pair);
  return matrix_;
}

/// Set what the points of a piece share, and its matrix to zero.
void PieceMatrix::set_piece(const RayPair& pair)
{
  std::ranges::fill(matrix_, 0.0);
  cut_is_slave_ = pair.cut_is_slave;
  velocity_.clear();
  motions_.clear();
  if (at_.moves && !pieces_.corner_end.empty())
    append_motions(pair, pieces_.shape_of(piece_), points_, velocity_, motions_);
  turning_ = {};
  if (!slip_)
    return;
  normal_ = normal_of(pair);
  normal_gradient(pair, turn_);
  spin_gradient(pair, spin_);
}

/// Stresses at a point, times its weight.
RayStress PieceMatrix::stress_of(std::size_t p) const
{
  const std::size_t point = first_ + p;
  const double w = points_[p].weight;
  const Vec3 tau
      = at_.traction.empty() ? Vec3{} : facet_vertex(at_.traction, static_cast<int>(point));
  return {w * at_.pressure[point], w * tau};
}

/// Whether there are forces at a point, or they change.
bool PieceMatrix::has_force(std::size_t p) const
{
  const std::size_t point = first_ + p;
  return at_.pressure[point] != 0 || any(at_.D.subspan(point * m_ * m_, m_ * m_))
         || (!at_.traction.empty() && any(at_.traction.subspan(3 * point, 3)));
}

/// Set the multipliers' functions at a point, and how λ changes as it moves.
QSDOLFINX_FOR_PROCESSORS
void PieceMatrix::set_place(std::size_t p)
{
  const auto& place = cut_is_slave_ ? points_[p].xi : points_[p].zeta;
  N_ = own_ ? std::array<double, 4>{1} : shape_functions(pieces_.slave.type, place);
  dN_ = trace_gradients(pieces_.slave.type, 1, place);
  const auto& by_place = cut_is_slave_ ? change_.xi : change_.zeta;
  for (std::size_t c = 0; c < m_; ++c)
  {
    std::array<double, 2> slope{};
    for (std::size_t k = 0; k < nk_ && !lambda_[c].empty(); ++k)
      for (std::size_t a = 0; a < 2; ++a)
        slope[a] += lambda_[c][piece_ * nk_ + k] * dN_[k][a];
    forms::set_rows<2>(moved_[c].data(), n_, slope, {by_place[0].data(), by_place[1].data()});
  }
}

/// Set the changes of the trials at a point.
QSDOLFINX_FOR_PROCESSORS
void PieceMatrix::set_trials(const Rays& rays, std::size_t p)
{
  const std::size_t point = first_ + p;
  if (m_ > 1)
    slip_rows(rays, p, std::span(slip_->slides).subspan(9 * point, 9),
              std::span(slip_->chord).subspan(2 * point, 2), slips_);
  for (std::size_t c = 0; c < m_; ++c)
  {
    double* to = trials_[c].data();
    std::fill(to + n_, to + size_, 0.0);
    const double gamma = at_.gamma[c];
    if (c > 0)
      forms::set_rows<1>(to, n_, {gamma}, {&slips_[(c - 1) * n_]});
    else if (!at_.gaps_move)
    {
      const auto slope = lift_of(rays.pair, points_[p].zeta).slope;
      const forms::Ray& ray = rays.all[p];
      std::fill_n(to, n_, 0.0);
      ray.add_form(rays.columns, rays.normal, gamma * ray.of_gap(1, slope), to);
    }
    else // gaps are those to the facet itself
      forms::set_rows<1>(to, n_, {-gamma}, {change_.t.data()});
    if (c > 0 && at_.gaps_move)
    {
      add_row(to, -gamma * at_.leaning[point], &turn_[(c - 1) * n_], n_);
      for (std::size_t a = 0; a < 2; ++a)
        add_row(to, gamma * slip_->slope[6 * point + 3 * a + c - 1], change_.xi[a].data(), n_);
    }
    if (!has_functions_)
      continue;
    if (c > 0 && !at_.kept.empty())
      add_kept(c - 1, p, trials_[c]);
    add_row(to, at_.part[c], moved_[c].data(), n_);
    for (std::size_t k = 0; k < nk_; ++k)
      to[row_of(c, k)] = at_.part[c] * N_[k];
  }
}

/// Add the change of the part of a trial that turns with the facet, see PointState.
QSDOLFINX_FOR_PROCESSORS
void PieceMatrix::add_kept(std::size_t r, std::size_t p, WideRow& to) const
{
  const std::size_t point = first_ + p;
  const Vec3 v = facet_vertex(at_.kept, static_cast<int>(point));
  if (at_.gaps_move)
    add_row(to.data(), (cut_is_slave_ ? 1 : -1) * cross(normal_, v)[r], spin_.data(), n_);
  std::array<double, 2> slope{};
  for (std::size_t k = 0; k < nk_ && !own_; ++k)
  {
    double by_function = 0;
    for (std::size_t i = 0; i < 3; ++i)
    {
      const double turn = slip_->turn[9 * piece_ + 3 * r + i];
      if (!at_.kept_slopes.empty())
        by_function += turn * at_.kept_slopes[3 * (point * nk_ + k) + i];
      if (i < begun_.size())
        by_function += turn * begun_[i][piece_ * nk_ + k];
    }
    for (std::size_t a = 0; a < 2; ++a)
      slope[a] += by_function * dN_[k][a];
  }
  const auto& by_place = cut_is_slave_ ? change_.xi : change_.zeta;
  for (std::size_t a = 0; a < 2; ++a)
    add_row(to.data(), slope[a], by_place[a].data(), n_);
}

/// Set the changes of the stresses, over γ: D times those of the trials.
QSDOLFINX_FOR_PROCESSORS
void PieceMatrix::set_stresses(std::size_t p)
{
  const double* D = &at_.D[(first_ + p) * m_ * m_];
  for (std::size_t c = 0; c < m_; ++c, D += m_)
  {
    forms::set_rows<1>(stresses_[c].data(), size_, {D[0]}, {trials_[0].data()});
    for (std::size_t l = 1; l < m_; ++l)
      if (D[l] != 0)
        add_row(stresses_[c].data(), D[l], trials_[l].data(), size_);
  }
}

/// Add the change of R_λ: w_p N_k r_c. Without a change of r, it is that of w_p N_k as the point
/// moves; what points without a partner lose does not move.
QSDOLFINX_FOR_PROCESSORS
void PieceMatrix::add_equations(std::size_t p)
{
  const auto& by_place = cut_is_slave_ ? change_.xi : change_.zeta;
  for (std::size_t c = 0; c < m_; ++c)
  {
    const double own = at_.own[(first_ + p) * m_ + c];
    WideRow row;
    forms::set_rows<1>(row.data(), size_, {at_.in_work[c]}, {stresses_[c].data()});
    add_row(row.data(), own, moved_[c].data(), n_);
    for (std::size_t k = 0; k < nk_; ++k)
      row[row_of(c, k)] += own * N_[k];
    for (std::size_t k = 0; k < nk_; ++k)
    {
      double* to = &matrix_[row_of(c, k) * size_];
      const double lost = missing_[c].empty() ? 0.0 : missing_[c][piece_ * nk_ + k],
                   rest = points_[p].weight * (at_.rest[(first_ + p) * m_ + c] - lost);
      forms::add_rows<4>(
          to, n_, {N_[k], rest * N_[k], rest * dN_[k][0], rest * dN_[k][1]},
          {row.data(), change_.ln_weight.data(), by_place[0].data(), by_place[1].data()});
      add_row(to + n_, N_[k], row.data() + n_, size_ - n_);
    }
  }
  for (std::size_t k = 0; k < nk_ && !at_.turning.empty(); ++k)
    for (std::size_t r = 0; r < 3; ++r)
      turning_[k][r] += N_[k] * points_[p].weight * at_.turning[3 * (first_ + p) + r];
}

/// Add the change of R_τ as tractions stay in the planes of facets: n·δτ = −τ·δn.
void PieceMatrix::add_turning()
{
  for (std::size_t c = 1; c < m_; ++c)
    for (std::size_t k = 0; k < nk_; ++k)
      for (std::size_t r = 0; r < 3; ++r)
        add_row(&matrix_[row_of(c, k) * size_], -normal_[c - 1] * turning_[k][r], &turn_[r * n_],
                n_);
}

/// Add the change of forces with the curved surface whose normals they have.
void PieceMatrix::add_rise(const RayPair& pair)
{
  const std::size_t count = points_.size();
  std::vector<double> by_nodes(n_ * n_, 0.0),
      by_normals(3 * n_ * static_cast<std::size_t>(pair.other.num_vertices()));
  add_forces_by_rise(pair, points_, at_.pressure.subspan(first_, count), by_nodes, by_normals);
  if (!at_.traction.empty())
    add_slip_forces_by_rise(pair, points_, at_.traction.subspan(3 * first_, 3 * count), by_nodes,
                            by_normals);
  for (std::size_t r = 0; r < n_; ++r)
    add_row(&matrix_[r * size_], 1.0, &by_nodes[r * n_], n_);
}
