#include "gap/piece_rows.h"
#include "gap/piece_forces.h"
#include "parallel/exchange.h"
#include "parallel/records.h"

#include <algorithm>

using namespace qsdolfinx;

namespace
{
/// Sums over the points of a piece, for all multipliers.
struct PieceSums
{
  std::vector<double> cover, gap, jump, gradient, mass, cover_gradient;

  PieceSums(std::size_t multipliers, std::size_t columns)
      : cover(multipliers), gap(multipliers), jump(multipliers * 3),
        gradient(multipliers * columns * 3), mass(multipliers * columns),
        cover_gradient(multipliers * columns * 3)
  {
  }

  void compute(const Pieces& pieces, std::size_t piece)
  {
    for (auto* values : {&cover, &gap, &jump, &gradient, &mass, &cover_gradient})
      std::ranges::fill(*values, 0.0);
    const RayPair pair = pair_of(pieces, piece);
    const auto points = pieces.points_of(piece);
    add_gap(pair, points, {cover, gap, jump, gradient, cover_gradient});
    if (mass.empty())
      return;
    for (const RayPoint& point : points)
      pair.cut_is_slave ? add_mass(pair.cut, pair.other, point.xi, point.zeta, point.weight)
                        : add_mass(pair.other, pair.cut, point.zeta, point.xi, point.weight);
  }

  /// Let penetration that counts as none be no part of the gap whose gradient it is.
  /// @param allowance a_k, [k]
  void allow(std::span<const double> allowance)
  {
    const std::size_t width = gradient.size() / cover.size();
    for (std::size_t i = 0; i < gradient.size(); ++i)
      gradient[i] -= allowance[i / width] * cover_gradient[i];
  }

private:
  void add_mass(const RayFacet& slave, const RayFacet& master, std::array<double, 2> on_slave,
                std::array<double, 2> on_master, double weight)
  {
    const auto N = shape_functions(slave.type, on_slave);
    const auto T = trace_functions(slave.type, slave.degree, on_slave);
    const auto M = trace_functions(master.type, master.degree, on_master);
    const std::size_t ns = slave.x.size() / 3, nm = master.x.size() / 3;
    for (std::size_t k = 0; k < cover.size(); ++k)
    {
      double* row = &mass[k * (ns + nm)];
      for (std::size_t j = 0; j < ns; ++j)
        row[j] += weight * N[k] * T[j];
      for (std::size_t j = 0; j < nm; ++j)
        row[ns + j] -= weight * N[k] * M[j];
    }
  }
};

/// The slip of all multipliers of a piece along one axis, as a gradient.
void compute_slip(const Pieces& pieces, std::size_t piece, int axis, std::vector<double>& slip,
                  PieceSums& sums)
{
  std::ranges::fill(slip, 0.0);
  add_slip(pair_of(pieces, piece), pieces.points_of(piece), slip);
  for (std::size_t i = 0; i < sums.gradient.size() / 3; ++i)
    for (std::size_t c = 0; c < 3; ++c)
      sums.gradient[3 * i + c] = slip[9 * i + 3 * static_cast<std::size_t>(axis) + c];
}

/// Records of rows, as they are sent: cover, gap, jump, gradient, mass.
void append_row(std::vector<double>& out, const PieceSums& sums, std::size_t k, std::size_t columns)
{
  append_record(out, sums.cover, k, 1);
  append_record(out, sums.gap, k, 1);
  append_record(out, sums.jump, k, 3);
  append_record(out, sums.gradient, k, columns * 3);
  append_record(out, sums.mass, k, columns);
}

/// Rows of pieces on their way to the owners of the nodes.
struct Records
{
  bool with_columns = true;
  std::vector<int> dest;
  std::vector<double> doubles;
  std::vector<std::int64_t> integers;

  /// @param sums of the piece; what hardly covered nodes have is shared out
  /// @param allowance of all pieces, [piece][k], or empty
  void append(const Pieces& pieces, std::size_t piece, const Shares& shares, PieceSums& sums,
              std::span<const double> allowance)
  {
    for (auto* values :
         {&sums.cover, &sums.gap, &sums.jump, &sums.gradient, &sums.mass, &sums.cover_gradient})
      shares.share_out(piece, *values);
    if (!allowance.empty())
      sums.allow(allowance.subspan(piece * sums.cover.size(), sums.cover.size()));
    const auto d = static_cast<std::size_t>(pieces.gdim),
               num_slave = static_cast<std::size_t>(pieces.slave.num_nodes),
               num_master = static_cast<std::size_t>(pieces.master.num_nodes);
    for (std::size_t k = 0; k < sums.cover.size(); ++k)
    {
      dest.push_back(pieces.slave.owner[piece * num_slave + k]);
      append_row(doubles, sums, k, with_columns ? num_slave + num_master : 0);
      integers.push_back(pieces.slave.dofs[(piece * num_slave + k) * d]);
      integers.push_back(pieces.multiplier_side[piece * sums.cover.size() + k]);
      if (!with_columns)
        continue;
      append_record(integers, pieces.slave.dofs, piece, num_slave * d);
      append_record(integers, pieces.master.dofs, piece, num_master * d);
    }
  }
};
} // namespace

PieceRows::PieceRows(const Surface& slave, const Pieces& pieces, Vec covered, Vec allowance,
                     bool with_columns)
    : gdim(pieces.gdim), num_slave(with_columns ? pieces.slave.num_nodes : 0),
      num_master(with_columns ? pieces.master.num_nodes : 0)
{
  const auto nk = static_cast<std::size_t>(pieces.num_multipliers),
             columns = static_cast<std::size_t>(num_columns());
  PieceSums sums(nk, columns);
  const Shares shares(pieces, covered);
  const std::vector<double> allowed
      = allowance ? values_at(allowance, first_dofs(pieces)) : std::vector<double>{};
  Records records;
  records.with_columns = with_columns;
  for (std::size_t i = 0; i < pieces.size(); ++i)
    if (!pieces.is_missed[i])
    {
      sums.compute(pieces, i);
      records.append(pieces, i, shares, sums, allowed);
    }
  append_received(slave, records.dest, records.doubles, records.integers);
}

PieceRows::PieceRows(const Surface& slave, const Pieces& pieces, Vec covered, int axis)
    : gdim(pieces.gdim), num_slave(pieces.slave.num_nodes), num_master(pieces.master.num_nodes)
{
  const auto nk = static_cast<std::size_t>(pieces.num_multipliers),
             columns = static_cast<std::size_t>(num_columns());
  PieceSums sums(nk, columns);
  std::vector<double> slip(nk * columns * 9);
  const Shares shares(pieces, covered);
  Records records;
  for (std::size_t i = 0; i < pieces.size(); ++i)
  {
    compute_slip(pieces, i, axis, slip, sums);
    records.append(pieces, i, shares, sums, {});
  }
  append_received(slave, records.dest, records.doubles, records.integers);
}

PieceRows::PieceRows(const Surface& slave, std::span<const std::uint8_t> marked,
                     std::span<const double> of_cover, std::span<const double> of_gap,
                     std::span<const double> of_jump, std::span<const double> of_gradient,
                     std::span<const double> of_mass)
    : gdim(slave.gdim()), num_slave(slave.num_trace()), num_master(0)
{
  const auto nk = static_cast<std::size_t>(slave.num_vertices()),
             columns = static_cast<std::size_t>(num_slave);
  const Facets& facets = slave.facets();
  std::vector<int> dest;
  std::vector<double> doubles;
  std::vector<std::int64_t> integers;
  for (std::size_t f = 0; f < slave.num_facets(); ++f)
    for (std::size_t k = 0; marked[f] && k < nk; ++k)
    {
      const std::size_t row = f * nk + k;
      dest.push_back(facets.vertex_owner[row]);
      append_record(doubles, of_cover, row, 1);
      append_record(doubles, of_gap, row, 1);
      append_record(doubles, of_jump, row, 3);
      append_record(doubles, of_gradient, row, columns * 3);
      append_record(doubles, of_mass, row, columns);
      integers.push_back(facets.vertex_dofs[row * gdim]);
      integers.push_back(facets.vertex_side[row]);
      append_record(integers, facets.dofs, f, columns * gdim);
    }
  append_received(slave, dest, doubles, integers);
}

void PieceRows::append_received(const Surface& slave, std::span<const int> dest,
                                const std::vector<double>& doubles,
                                const std::vector<std::int64_t>& integers)
{
  const auto columns = static_cast<std::size_t>(num_columns());
  const int num_doubles = 5 + 4 * num_columns(), num_integers = 2 + num_columns() * gdim;
  const Exchange exchange(slave.comm(), dest);
  const auto values = exchange.forward<double>(doubles, num_doubles);
  const auto numbers = exchange.forward<std::int64_t>(integers, num_integers);
  for (std::size_t r = 0; r < exchange.num_received(); ++r)
  {
    const double* v = values.data() + r * num_doubles;
    const auto take = [&v](std::vector<double>& to, std::size_t n)
    {
      to.insert(to.end(), v, v + n);
      v += n;
    };
    take(cover, 1);
    take(gap, 1);
    take(jump, 3);
    take(gradient, columns * 3);
    take(mass, columns);
    const std::int64_t* i = numbers.data() + r * num_integers;
    node.push_back(slave.node_index(i[0]));
    side.push_back(static_cast<std::uint8_t>(i[1]));
    dofs.insert(dofs.end(), i + 2, i + num_integers);
  }
}

std::vector<double> PieceRows::on_nodes(const std::vector<double>& values, std::size_t num_nodes,
                                        std::size_t width) const
{
  std::vector<double> out(num_nodes * width, 0.0);
  for (std::size_t r = 0; r < size(); ++r)
    for (std::size_t i = 0; i < width; ++i)
      out[node[r] * width + i] += values[r * width + i];
  return out;
}

std::vector<double> PieceRows::on_sides(const std::vector<double>& values,
                                        std::size_t num_nodes) const
{
  std::vector<double> out(num_nodes * gdim, 0.0);
  for (std::size_t r = 0; r < size(); ++r)
    out[node[r] * gdim + side[r]] += values[r];
  return out;
}
