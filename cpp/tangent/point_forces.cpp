#include "tangent/point_forces.h"
#include "gap/piece_forces.h"
#include "geometry/outer.h"
#include "sliding/forms.h"
#include "sliding/rise.h"

#include <algorithm>
#include <stdexcept>

using namespace qsdolfinx;

namespace
{
bool any(std::span<const double> values)
{
  return std::ranges::any_of(values, [](double value) { return value != 0; });
}

/// Adds matrices whose rows are first those of the nodes of a piece, [node][3], the slave's first,
/// and then those of its multipliers, [component][multiplier], to the matrix of all unknowns.
class Insertion
{
public:
  /// @throws std::invalid_argument if there is not a number for each unknown of the pieces
  Insertion(const Pieces& pieces, const FunctionUnknowns& functions, const Destination& to)
      : functions_(functions), to_(to), d_(static_cast<std::size_t>(pieces.gdim)),
        nodes_{static_cast<std::size_t>(pieces.slave.num_nodes),
               static_cast<std::size_t>(pieces.master.num_nodes)}
  {
    for (std::size_t s = 0; s < 2; ++s)
      if (!to.numbers[s].empty() && to.numbers[s].size() != pieces.size() * nodes_[s] * d_)
        throw std::invalid_argument("a number for each unknown");
  }

  /// Begin a matrix of the nodes of a piece.
  void begin(std::size_t piece)
  {
    clear();
    for (std::size_t s = 0, first = 0; s < 2; first += 3 * nodes_[s++])
      for (std::size_t i = 0; i < nodes_[s] * d_; ++i)
      {
        const std::size_t at = first + 3 * (i / d_) + i % d_;
        if (!to_.numbers[s].empty())
          append(rows_, columns_, to_.numbers[s][piece * nodes_[s] * d_ + i], at, to_.scale[s]);
        if (to_.tool < 0) // a motion of the tool is that of the slave in the other direction
          continue;
        if (s == 0)
          append(rows_, to_.tool, at, -to_.way[i % d_]);
        else
          append(columns_, to_.tool, at, to_.way[i % d_]);
      }
  }

  void clear()
  {
    rows_.clear();
    columns_.clear();
  }

  /// Append a multiplier. @param row see FunctionUnknowns @param at row of the matrix
  void append_function(std::size_t component, std::int64_t row, std::size_t at)
  {
    const CompressedRows& unknowns = *functions_.rows[component];
    for (std::int64_t e = unknowns.offset[row]; e < unknowns.offset[row + 1]; ++e)
    {
      append(rows_, unknowns.column[e], at, unknowns.value[e]);
      append(columns_, unknowns.column[e], at, unknowns.value[e]);
    }
  }

  /// @param size length of a row of the matrix
  void add(std::span<const double> matrix, std::size_t size)
  {
    if (rows_.is_all_of(size) && columns_.is_all_of(size))
      return to_.sums.add(rows_.number, columns_.number, matrix);
    block_.resize(rows_.number.size() * columns_.number.size());
    double* to = block_.data();
    for (std::size_t r = 0; r < rows_.number.size(); ++r)
    {
      const double* row = &matrix[rows_.at[r] * size];
      for (std::size_t c = 0; c < columns_.number.size(); ++c)
        *to++ = rows_.factor[r] * columns_.factor[c] * row[columns_.at[c]];
    }
    to_.sums.add(rows_.number, columns_.number, block_);
  }

private:
  /// Unknowns, and the rows of the matrix that are added to theirs with these factors.
  struct Unknowns
  {
    std::vector<PetscInt> number;
    std::vector<std::size_t> at;
    std::vector<double> factor;

    void clear()
    {
      number.clear();
      at.clear();
      factor.clear();
    }
    /// Whether they are those of all rows, in their order and without factors.
    bool is_all_of(std::size_t size) const
    {
      std::size_t i = 0;
      while (i < number.size() && at[i] == i && factor[i] == 1)
        ++i;
      return i == size && i == number.size();
    }
  };

  static void append(Unknowns& to, std::int64_t number, std::size_t at, double factor)
  {
    if (number < 0)
      return;
    to.number.push_back(static_cast<PetscInt>(number));
    to.at.push_back(at);
    to.factor.push_back(factor);
  }

  static void append(Unknowns& rows, Unknowns& columns, std::int64_t number, std::size_t at,
                     double scale)
  {
    append(rows, number, at, 1.0);
    append(columns, number, at, scale);
  }

  const FunctionUnknowns& functions_;
  const Destination& to_;
  std::size_t d_;
  std::array<std::size_t, 2> nodes_;
  Unknowns rows_, columns_;
  std::vector<double> block_;
};

/// Matrix of a piece, with rows as in Insertion.
class PieceMatrix
{
public:
  PieceMatrix(const Pieces& pieces, const SlipOfPieces* slip, const PointState& at, bool own)
      : pieces_(pieces), slip_(slip), at_(at), own_(own), m_(at.components),
        n_(3 * static_cast<std::size_t>(pieces.slave.num_nodes + pieces.master.num_nodes)),
        nk_(own ? 1 : static_cast<std::size_t>(pieces.num_multipliers)), size_(n_ + m_ * nk_),
        has_functions_(!at.own.empty()), of_sides_(side_dofs(pieces)), matrix_(size_ * size_),
        right_(m_ * size_), slopes_(2 * m_), moved_(m_ * n_), moved_slopes_(2 * m_),
        hessian_(n_ * n_)
  {
    for (Vec field : at.fields)
      lambda_.push_back(field ? values_at(field, of_sides_) : std::vector<double>());
    lambda_.resize(m_);
    for (Vec missing : at.missing)
      missing_.push_back(values_at(missing, of_sides_));
    missing_.resize(m_);
    for (Vec field : at.begun)
      begun_.push_back(values_at(field, of_sides_));
    for (auto* rows : {&of_nodes_, &of_functions_})
      rows->resize(m_);
  }

  std::size_t size() const { return size_; }
  std::size_t num_functions() const { return nk_; }
  /// Row of a multiplier.
  std::size_t row_of(std::size_t component, std::size_t k) const
  {
    return n_ + component * nk_ + k;
  }

  /// Compute the matrix of a piece. @param first number of its first point
  std::span<const double> of(std::size_t piece, std::size_t first)
  {
    piece_ = piece;
    first_ = first;
    points_ = pieces_.points_of(piece);
    const RayPair pair = pair_of(pieces_, piece);
    std::ranges::fill(matrix_, 0.0);
    const bool have_corners = at_.moves && !pieces_.corner_end.empty();
    forms_.assign(have_corners ? 3 * points_.size() * size_ : 0, 0.0);
    const Rays rays(pair, points_);
    measure(rays);
    for (std::size_t p = 0; p < points_.size(); ++p)
    {
      set_right(pair, p);
      add_products(p);
      if (has_functions_)
        add_rest(pair, p);
    }
    add_collected();
    add_turning(pair);
    add_constant_stress(rays);
    if (any(forms_))
      add_moved(pair, motion_of(pieces_, piece), forms_, matrix_);
    return matrix_;
  }

private:
  /// Left and right rows whose products are added.
  struct Rows
  {
    std::vector<double> left, right;
  };

  /// Compute gradients and slopes of gaps, and of the positions of points on the slave.
  void measure(const Rays& rays)
  {
    const std::size_t count = points_.size();
    works_.resize(count * n_);
    gap_slopes_.resize(2 * count);
    gap_gradients(rays, works_, gap_slopes_);
    gaps_ = works_;
    if (at_.gaps_move && rays.pair.is_raised()) // gaps are those to the facet itself
      gap_gradients(rays, gaps_, {}, false);
    turn_.resize(3 * n_);
    spin_.resize(n_);
    if (slip_)
    {
      normal_gradient(rays.pair, turn_);
      spin_gradient(rays.pair, spin_);
    }
    if (!has_functions_)
      return;
    places_.resize(2 * count * n_);
    place_slopes_.resize(4 * count);
    slave_places(rays, places_, place_slopes_);
  }

  /// Set functions, trials and their slopes at a point.
  void set_right(const RayPair& pair, std::size_t p)
  {
    const auto& place = pair.cut_is_slave ? points_[p].xi : points_[p].zeta;
    N_ = own_ ? std::array<double, 4>{1} : shape_functions(pieces_.slave.type, place);
    dN_ = trace_gradients(pieces_.slave.type, 1, place);
    const bool moves = !forms_.empty();
    for (auto* values : {&right_, &slopes_, &moved_, &moved_slopes_})
      std::ranges::fill(*values, 0.0);
    for (std::size_t c = 0; c < m_; ++c)
    {
      double* to = &right_[c * size_];
      set_gap(to, &slopes_[2 * c], c, p);
      if (c > 0 && has_functions_)
        set_kept(pair, to, &slopes_[2 * c], c - 1, p);
      if (!has_functions_)
        continue;
      const double part = at_.part[c];
      for (std::size_t k = 0; k < nk_; ++k)
        to[row_of(c, k)] = part * N_[k];
      if (lambda_[c].empty())
        continue;
      std::array<double, 2> change{};
      for (std::size_t k = 0; k < nk_; ++k)
        for (std::size_t a = 0; a < 2; ++a)
          change[a] += lambda_[c][piece_ * nk_ + k] * dN_[k][a];
      double* moved = &moved_[c * n_];
      const double* by_place = &places_[2 * p * n_];
      for (std::size_t i = 0; i < n_ && !pair.cut_is_slave; ++i)
        to[i] += part * (moved[i] = change[0] * by_place[i] + change[1] * by_place[n_ + i]);
      for (std::size_t a = 0; a < 2 && moves; ++a)
      {
        moved_slopes_[2 * c + a]
            = change[0] * place_slopes_[4 * p + a] + change[1] * place_slopes_[4 * p + 2 + a];
        slopes_[2 * c + a] += part * moved_slopes_[2 * c + a];
      }
    }
  }

  /// Set γ times the gradient of a gap, or of a component of the slip, and its slopes.
  void set_gap(double* to, double* slopes, std::size_t c, std::size_t p) const
  {
    const double gamma = at_.gamma[c];
    for (std::size_t i = 0; i < n_; ++i)
      to[i] = gamma * (c == 0 ? gaps_[p * n_ + i] : of_slip(slip_->gradient, p, c - 1, i));
    if (!at_.gaps_move)
      return;
    const std::size_t point = first_ + p;
    for (std::size_t i = 0; i < n_ && c > 0; ++i)
      to[i] -= gamma * at_.leaning[point] * turn_[(c - 1) * n_ + i];
    for (std::size_t a = 0; a < 2 && !forms_.empty(); ++a)
      slopes[a]
          = gamma * (c == 0 ? gap_slopes_[2 * p + a] : slip_->slope[6 * point + 3 * a + c - 1]);
  }

  /// Add the change of the part of a trial that turns with the facet, see PointState.
  void set_kept(const RayPair& pair, double* to, double* slopes, std::size_t r, std::size_t p) const
  {
    const std::size_t point = first_ + p;
    if (at_.kept.empty())
      return;
    const Vec3 v = facet_vertex(at_.kept, static_cast<int>(point));
    const double across = (pair.cut_is_slave ? 1 : -1) * cross(normal_of(pair), v)[r];
    for (std::size_t i = 0; i < n_ && at_.gaps_move; ++i)
      to[i] += across * spin_[i];
    std::array<double, 2> change{};
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
        change[a] += by_function * dN_[k][a];
    }
    const double* by_place = &places_[2 * p * n_];
    for (std::size_t i = 0; i < n_ && !pair.cut_is_slave; ++i)
      to[i] += change[0] * by_place[i] + change[1] * by_place[n_ + i];
    for (std::size_t a = 0; a < 2 && !forms_.empty(); ++a)
      slopes[a] += change[0] * place_slopes_[4 * p + a] + change[1] * place_slopes_[4 * p + 2 + a];
  }

  double of_slip(const std::vector<double>& values, std::size_t p, std::size_t r,
                 std::size_t i) const
  {
    return values[(((first_ + p) * n_ / 3 + i / 3) * 3 + r) * 3 + i % 3];
  }

  /// Collect the products of left rows with D times right rows, and of N with N λ.
  void add_products(std::size_t p)
  {
    const std::span<const double> D = at_.D.subspan((first_ + p) * m_ * m_, m_ * m_);
    if (any(D))
      for (std::size_t c = 0; c < m_; ++c)
      {
        auto& [left, right] = of_nodes_[c];
        for (std::size_t i = 0; i < n_; ++i)
          left.push_back(at_.gamma[c]
                         * (c == 0 ? works_[p * n_ + i] : of_slip(slip_->works, p, c - 1, i)));
        append_sum(right, right_, D.subspan(c * m_, m_));
        add_form(p, 0, n_, left.data() + left.size() - n_, sum_slopes(D.subspan(c * m_, m_)));
      }
    for (std::size_t c = 0; c < m_ && has_functions_; ++c)
    {
      auto& [left, right] = of_functions_[c];
      left.insert(left.end(), N_.begin(), N_.begin() + static_cast<std::ptrdiff_t>(nk_));
      const double in_work = at_.in_work[c], own = at_.own[(first_ + p) * m_ + c];
      append_sum(right, right_, D.subspan(c * m_, m_), in_work);
      double* to = right.data() + right.size() - size_;
      auto slopes = sum_slopes(D.subspan(c * m_, m_));
      for (std::size_t i = 0; i < n_ && !lambda_[c].empty(); ++i)
        to[i] += own * moved_[c * n_ + i];
      for (std::size_t k = 0; k < nk_; ++k)
        to[row_of(c, k)] += own * N_[k];
      for (std::size_t a = 0; a < 2; ++a)
        slopes[a] = in_work * slopes[a] + own * moved_slopes_[2 * c + a];
      add_form(p, row_of(c, 0), nk_, N_.data(), slopes);
    }
  }

  /// Append a sum of right rows.
  void append_sum(std::vector<double>& to, const std::vector<double>& rows,
                  std::span<const double> factors, double factor = 1) const
  {
    const std::size_t first = to.size();
    to.resize(first + size_, 0.0);
    for (std::size_t c = 0; c < m_; ++c)
      for (std::size_t i = 0; i < size_ && factors[c] != 0; ++i)
        to[first + i] += factor * factors[c] * rows[c * size_ + i];
  }

  std::array<double, 2> sum_slopes(std::span<const double> factors) const
  {
    std::array<double, 2> out{};
    for (std::size_t c = 0; c < m_; ++c)
      for (std::size_t a = 0; a < 2; ++a)
        out[a] += factors[c] * slopes_[2 * c + a];
    return out;
  }

  /// Add a row, times slopes, to the forms that are multiplied by the motion of a point.
  void add_form(std::size_t p, std::size_t first, std::size_t count, const double* row,
                const std::array<double, 2>& slopes)
  {
    for (std::size_t a = 0; a < 2 && !forms_.empty(); ++a)
      for (std::size_t i = 0; i < count; ++i)
        forms_[(3 * p + a) * size_ + first + i] += slopes[a] * row[i];
  }

  /// Collect the change of R_λ with the place of a point on the slave.
  void add_rest(const RayPair& pair, std::size_t p)
  {
    for (std::size_t c = 0; c < m_; ++c)
    {
      const std::array<double, 4> force = forces_of_rest(p, c);
      if (!any(force))
        continue;
      for (std::size_t i = 0; i < 2; ++i)
      {
        std::array<double, 4> changed{};
        for (std::size_t k = 0; k < nk_; ++k)
          changed[k] = force[k] * dN_[k][i];
        add_form(p, row_of(c, 0), nk_, changed.data(),
                 {place_slopes_[4 * p + 2 * i], place_slopes_[4 * p + 2 * i + 1]});
        if (pair.cut_is_slave)
          continue;
        auto& [left, right] = of_functions_[c];
        left.insert(left.end(), changed.begin(),
                    changed.begin() + static_cast<std::ptrdiff_t>(nk_));
        const auto place = std::span(places_).subspan((2 * p + i) * n_, n_);
        right.insert(right.end(), place.begin(), place.end());
        right.resize(right.size() + size_ - n_, 0.0);
      }
      for (std::size_t k = 0; k < nk_ && !forms_.empty(); ++k)
        forms_[(3 * p + 2) * size_ + row_of(c, k)] += force[k] * N_[k];
    }
  }

  /// w_p r_p for each function, without what points without a partner lose.
  std::array<double, 4> forces_of_rest(std::size_t p, std::size_t c) const
  {
    std::array<double, 4> out{};
    for (std::size_t k = 0; k < nk_; ++k)
    {
      const double lost = missing_[c].empty() ? 0.0 : missing_[c][piece_ * nk_ + k];
      out[k] = points_[p].weight * (at_.rest[(first_ + p) * m_ + c] - lost);
    }
    return out;
  }

  void add_collected()
  {
    for (std::size_t c = 0; c < m_; ++c)
    {
      add_outer_products(of_nodes_[c].left, of_nodes_[c].right, {}, n_, size_, matrix_.data(),
                         size_);
      add_outer_products(of_functions_[c].left, of_functions_[c].right, {}, nk_, size_,
                         &matrix_[row_of(c, 0) * size_], size_);
      for (Rows* rows : {&of_nodes_[c], &of_functions_[c]})
      {
        rows->left.clear();
        rows->right.clear();
      }
    }
  }

  /// Add the change of R_τ as tractions stay in the planes of facets: n·δτ = −τ·δn.
  void add_turning(const RayPair& pair)
  {
    if (!has_functions_ || at_.turning.empty())
      return;
    const Vec3 n = normal_of(pair);
    for (std::size_t p = 0; p < points_.size(); ++p)
    {
      const auto& place = pair.cut_is_slave ? points_[p].xi : points_[p].zeta;
      const auto N = own_ ? std::array<double, 4>{1} : shape_functions(pieces_.slave.type, place);
      for (std::size_t c = 1; c < m_; ++c)
        for (std::size_t k = 0; k < nk_; ++k)
          for (std::size_t r = 0; r < 3; ++r)
          {
            const double factor
                = N[k] * points_[p].weight * n[c - 1] * at_.turning[3 * (first_ + p) + r];
            for (std::size_t i = 0; i < n_ && factor != 0; ++i)
              matrix_[row_of(c, k) * size_ + i] -= factor * turn_[r * n_ + i];
          }
    }
  }

  /// Add the change of the forces of constant pressures and tractions.
  void add_constant_stress(const Rays& rays)
  {
    const auto pressure = at_.pressure.subspan(first_, points_.size());
    if (any(pressure))
      add_stress(rays, pressure,
                 {add_curvature_of_points, add_changes_of_forces, add_forces_by_rise});
    if (at_.traction.empty())
      return;
    const auto traction = at_.traction.subspan(3 * first_, 3 * points_.size());
    if (any(traction))
      add_stress(
          rays, traction,
          {add_slip_curvature_of_points, add_changes_of_slip_forces, add_slip_forces_by_rise});
  }

  /// Terms for fixed points, for the motion of points, and for heights.
  struct Terms
  {
    using Points = std::span<const RayPoint>;
    using In = std::span<const double>;
    using Out = std::span<double>;
    void (*fixed)(const Rays&, In, Out);
    void (*moving)(const Rays&, In, Out);
    void (*rising)(const RayPair&, Points, In, Out, Out);
  };

  void add_stress(const Rays& rays, std::span<const double> stress, const Terms& terms)
  {
    std::ranges::fill(hessian_, 0.0);
    terms.fixed(rays, stress, hessian_);
    if (!forms_.empty())
      terms.moving(rays, stress, forms_);
    const RayPair& pair = rays.pair;
    if (at_.moves && pair.is_raised())
    {
      by_normals_.assign(3 * n_ * static_cast<std::size_t>(pair.other.num_vertices()), 0.0);
      terms.rising(pair, points_, stress, hessian_, by_normals_);
    }
    for (std::size_t r = 0; r < n_; ++r)
      for (std::size_t c = 0; c < n_; ++c)
        matrix_[r * size_ + c] += hessian_[r * n_ + c];
  }

  const Pieces& pieces_;
  const SlipOfPieces* slip_;
  const PointState& at_;
  bool own_;
  std::size_t m_, n_, nk_, size_; ///< components, rows of nodes, multipliers, all rows
  bool has_functions_;
  std::vector<std::int64_t> of_sides_;
  std::vector<std::vector<double>> lambda_;  ///< λ_ck of each component; empty if it is constant
  std::vector<std::vector<double>> missing_; ///< see PointState, for each component; empty for 0
  std::vector<std::vector<double>> begun_;   ///< see PointState, for each component
  std::size_t piece_ = 0, first_ = 0;
  std::span<const RayPoint> points_;
  std::vector<double> matrix_, works_, gaps_, gap_slopes_, places_, place_slopes_, turn_, spin_;
  std::array<double, 4> N_{};
  std::array<std::array<double, 2>, max_trace> dN_{};
  std::vector<double> right_, slopes_;       ///< of the trials of a point, by nodes and by ξ
  std::vector<double> moved_, moved_slopes_; ///< of its λ
  std::vector<Rows> of_nodes_, of_functions_;
  std::vector<double> forms_; ///< [point][3][row]; empty if points do not move
  std::vector<double> hessian_, by_normals_;
};

/// Matrix of the multipliers of a point without a partner, [component][component].
std::vector<double> of_alone(const PointState& at, std::size_t point)
{
  const std::size_t m = at.components;
  std::vector<double> out(m * m);
  for (std::size_t c = 0; c < m; ++c)
  {
    for (std::size_t l = 0; l < m; ++l)
      out[c * m + l] = at.in_work[c] * at.D[(point * m + c) * m + l] * at.part[l];
    out[c * m + c] += at.own[point * m + c];
  }
  return out;
}
} // namespace

std::vector<std::int64_t> qsdolfinx::free_unknowns(const PieceSide& side, Vec markers)
{
  const std::vector<double> marked = values_at(markers, side.dofs);
  std::vector<std::int64_t> out = side.dofs;
  for (std::size_t i = 0; i < out.size(); ++i)
    if (marked[i] != 0)
      out[i] = -1;
  return out;
}

void qsdolfinx::add_point_forces(const Pieces& pieces, const SlipOfPieces* slip,
                                 const PointState& at, const FunctionUnknowns& functions,
                                 const Destination& to)
{
  if (at.components > 1 && !slip)
    throw std::invalid_argument("no slip");
  PieceMatrix matrix(pieces, slip, at, functions.own);
  Insertion insertion(pieces, functions, to);
  const std::size_t m = at.components, nk = matrix.num_functions();
  const bool has_functions = !at.own.empty();
  for (std::size_t i = 0, first = 0; i < pieces.size(); first = pieces.end[i++])
  {
    insertion.begin(i);
    for (std::size_t c = 0; c < m && has_functions; ++c)
      for (std::size_t k = 0; k < nk; ++k)
        insertion.append_function(c, functions.row[i * nk + k], matrix.row_of(c, k));
    insertion.add(matrix.of(i, first), matrix.size());
  }
  for (std::size_t p = pieces.points.size(); has_functions && p < at.own.size() / m; ++p)
  {
    insertion.clear();
    for (std::size_t c = 0; c < m; ++c)
      insertion.append_function(c, functions.row[pieces.size() * nk + p - pieces.points.size()], c);
    insertion.add(of_alone(at, p), m);
  }
}
