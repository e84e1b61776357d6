#include "gap/point_rows.h"
#include "gap/piece_forces.h"
#include "parallel/key_numbers.h"
#include "sliding/forms.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <numeric>
#include <stdexcept>

using namespace qsdolfinx;

namespace
{
/// Functions of the nodes of a facet at the points, from which rows are assembled.
struct Functions
{
  const std::vector<std::int64_t>& dofs; ///< [point][node of the facet][block]
  const std::vector<double>& values;     ///< [point][function]
  std::size_t num_nodes, num_functions, block;
  const std::vector<std::uint8_t>* component = nullptr; ///< [point][function]; null: the first ones

  /// Unknown that represents the node of a function.
  std::int64_t dof(std::size_t p, std::size_t j) const
  {
    const std::size_t i = component ? (*component)[p * num_functions + j] : 0;
    return dofs[(p * num_nodes + j) * block + i];
  }
  bool used(std::size_t p, std::size_t j) const { return dof(p, j) >= 0; }
  /// Whether functions of two points have the same columns.
  bool same_columns(std::size_t p, std::size_t q) const
  {
    const auto same = [p, q](const auto& values, std::size_t width)
    { return std::equal(&values[p * width], &values[p * width] + width, &values[q * width]); };
    return same(dofs, num_nodes * block) && (!component || same(*component, num_functions));
  }
};

/// Unknowns that represent all nodes with a function at any point, ascending.
std::vector<std::int64_t> find_columns(const Functions& f, std::size_t num_points)
{
  std::vector<std::int64_t> out;
  for (std::size_t p = 0; p < num_points; ++p)
    if (p == 0 || !f.same_columns(p, p - 1))
      for (std::size_t j = 0; j < f.num_functions; ++j)
        if (f.used(p, j))
          out.push_back(f.dof(p, j));
  std::ranges::sort(out);
  out.erase(std::ranges::unique(out).begin(), out.end());
  return out;
}

/// Compressed rows with an entry for each function; append(p, j) appends its coefficients.
template <typename Append>
void compress(GapOperator::Side& out, const Functions& f, std::size_t num_points,
              const std::vector<std::int64_t>& columns, Append append)
{
  std::vector<std::size_t> order;   // of the functions of the current facet, by their columns
  std::vector<std::int32_t> column; // of each function
  out.offset.assign(1, 0);
  for (std::size_t p = 0; p < num_points; ++p)
  {
    if (p == 0 || !f.same_columns(p, p - 1))
    {
      order.clear();
      column.assign(f.num_functions, -1);
      for (std::size_t j = 0; j < f.num_functions; ++j)
        if (f.used(p, j))
        {
          const auto at = std::ranges::lower_bound(columns, f.dof(p, j));
          column[j] = static_cast<std::int32_t>(at - columns.begin());
          order.push_back(j);
        }
      std::ranges::sort(order, {}, [&column](std::size_t j) { return column[j]; });
    }
    for (std::size_t j : order)
    {
      out.column.push_back(column[j]);
      append(p, j);
    }
    out.offset.push_back(static_cast<std::int64_t>(out.column.size()));
  }
  out.column.shrink_to_fit();
  out.coefficient.shrink_to_fit();
  out.offset.shrink_to_fit();
}

/// Unknowns of one side, with -1 for stand-alone points.
std::vector<std::int64_t> without_alone(const PairingPoints& points, const PairingSide& side)
{
  std::vector<std::int64_t> out = side.dofs;
  const std::size_t first = points.size() - points.num_alone;
  const std::size_t width = static_cast<std::size_t>(side.num_nodes) * points.block;
  std::fill(out.begin() + static_cast<std::ptrdiff_t>(first * width), out.end(), -1);
  return out;
}

/// Set all unknowns of the columns: the unknowns of a node need not be consecutive.
void fill_dofs(GapOperator::Side& out, const Functions& f, std::size_t num_points,
               const std::vector<std::int64_t>& columns)
{
  const std::size_t d = f.block;
  out.dofs.resize(columns.size() * d);
  for (std::size_t p = 0; p < num_points; ++p)
    if (p == 0 || !f.same_columns(p, p - 1))
      for (std::size_t j = 0; j < f.num_functions; ++j)
        if (f.used(p, j))
        {
          const auto at = std::ranges::lower_bound(columns, f.dof(p, j)) - columns.begin();
          for (std::size_t i = 0; i < d; ++i)
            out.dofs[at * d + i] = static_cast<PetscInt>(f.dofs[(p * f.num_nodes + j) * d + i]);
        }
  out.free_dofs = out.dofs;
}
} // namespace

void qsdolfinx::rows_at_points(GapOperator::Side& out, const PairingPoints& points, int side,
                               GapKind kind)
{
  const PairingSide& s = side == 0 ? points.slave : points.master;
  const auto n = static_cast<std::size_t>(s.num_nodes), d = static_cast<std::size_t>(points.block);
  const std::vector<std::int64_t> dofs = without_alone(points, s);
  const Functions f{dofs, s.shape_values, n, n, d};
  const std::vector<std::int64_t> columns = find_columns(f, points.size());
  const double sign = side == 0 ? 1.0 : -1.0;
  compress(out, f, points.size(), columns,
           [&](std::size_t p, std::size_t j)
           {
             const double value = sign * s.shape_values[p * n + j];
             if (kind == GapKind::jump)
               out.coefficient.push_back(value);
             else
               for (std::size_t i = 0; i < d; ++i)
                 out.coefficient.push_back(value * points.normal[3 * p + i]);
           });
  fill_dofs(out, f, points.size(), columns);
}

void qsdolfinx::multipliers_at_points(GapOperator::Side& out, const PairingPoints& points)
{
  const PairingSide& s = points.slave;
  const Functions f{s.dofs,
                    points.multiplier_values,
                    static_cast<std::size_t>(s.num_nodes),
                    static_cast<std::size_t>(points.num_multipliers),
                    static_cast<std::size_t>(points.block),
                    points.block == 1 ? nullptr : &points.multiplier_side};
  const std::vector<std::int64_t> columns = find_columns(f, points.size());
  compress(out, f, points.size(), columns, [&](std::size_t p, std::size_t j)
           { out.coefficient.push_back(f.values[p * f.num_functions + j]); });
  out.dofs.assign(columns.begin(), columns.end());
}

PairingPoints qsdolfinx::points_of_pieces(const Surface& slave, const Surface* master,
                                          const Pieces& pieces)
{
  PairingPoints out(slave, master);
  out.slave.num_nodes = pieces.slave.num_nodes;
  out.master.num_nodes = pieces.master.num_nodes;
  const auto d = static_cast<std::size_t>(pieces.gdim),
             nk = static_cast<std::size_t>(pieces.num_multipliers);
  const auto append
      = [d](PairingSide& to, const PieceSide& from, std::size_t piece, std::array<double, 2> xi)
  {
    const auto n = static_cast<std::size_t>(from.num_nodes);
    const auto dofs = std::span(from.dofs).subspan(piece * n * d, n * d);
    to.dofs.insert(to.dofs.end(), dofs.begin(), dofs.end());
    const auto owners = std::span(from.owner).subspan(piece * n, n);
    to.owner.insert(to.owner.end(), owners.begin(), owners.end());
    const auto T = trace_functions(from.type, from.degree, xi);
    to.shape_values.insert(to.shape_values.end(), T.begin(), T.begin() + from.num_nodes);
  };
  for (std::size_t i = 0; i < pieces.size(); ++i)
  {
    const bool on_slave = pieces.cut_is_slave[i];
    const auto sides = std::span(pieces.multiplier_side).subspan(i * nk, nk);
    for (const RayPoint& point : pieces.points_of(i))
    {
      const auto &at = on_slave ? point.xi : point.zeta,
                 &opposite = on_slave ? point.zeta : point.xi;
      append(out.slave, pieces.slave, i, at);
      append(out.master, pieces.master, i, opposite);
      const auto N = shape_functions(pieces.slave.type, at);
      out.multiplier_values.insert(out.multiplier_values.end(), N.begin(),
                                   N.begin() + pieces.num_multipliers);
      out.multiplier_side.insert(out.multiplier_side.end(), sides.begin(), sides.end());
      out.weight.push_back(point.weight);
    }
  }
  out.gap = distances_of(pieces);
  out.normal.resize(3 * out.size());
  for (PairingSide* side : {&out.slave, &out.master})
    side->x.resize(3 * out.size());
  return out;
}

namespace
{
/// Columns of some nodes of each piece, ascending by the unknowns that represent them.
struct PieceColumns
{
  std::size_t num_nodes;
  std::vector<std::int64_t> key;    ///< of each column
  std::vector<std::int32_t> column; ///< [piece][node]
  std::vector<std::uint32_t> order; ///< nodes of the piece by their columns, [piece][node]

  /// @param keys unknowns that represent the nodes, [piece][node] @param others further columns
  PieceColumns(const std::vector<std::int64_t>& keys, std::size_t nodes,
               std::span<const std::int64_t> others = {})
      : num_nodes(nodes), column(keys.size()), order(keys.size())
  {
    KeyNumbers numbers;
    const auto number_of = [&](std::int64_t k)
    {
      const std::int32_t out = numbers(k);
      if (numbers.size() > key.size())
        key.push_back(k);
      return out;
    };
    std::ranges::transform(keys, column.begin(), number_of);
    std::ranges::for_each(others, number_of);
    const std::vector<std::int64_t> found = key;
    std::ranges::sort(key);
    std::vector<std::int32_t> places(found.size());
    std::ranges::transform(found, places.begin(), [this](std::int64_t k) { return place(k); });
    for (std::int32_t& c : column)
      c = places[c];
    for (std::size_t first = 0; first < keys.size(); first += nodes)
    {
      const auto of_piece = std::span(order).subspan(first, nodes);
      std::iota(of_piece.begin(), of_piece.end(), 0u);
      std::ranges::sort(of_piece, {},
                        [&](std::uint32_t j) { return std::pair(column[first + j], j); });
    }
  }

  std::int32_t place(std::int64_t k) const
  {
    return static_cast<std::int32_t>(std::ranges::lower_bound(key, k) - key.begin());
  }
  std::span<const std::uint32_t> order_of(std::size_t piece) const
  {
    return std::span(order).subspan(piece * num_nodes, num_nodes);
  }
};

/// First unknowns of the nodes of one side, [piece][node].
std::vector<std::int64_t> node_keys(const PieceSide& side, std::size_t d)
{
  std::vector<std::int64_t> out(side.dofs.size() / d);
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i] = side.dofs[i * d];
  return out;
}

/// Reserve memory for the rows of all points and some empty rows.
void reserve_rows(GapOperator::Side& out, std::size_t points, std::size_t alone,
                  std::size_t entries, std::size_t entry_size)
{
  out.offset.assign(1, 0);
  out.offset.reserve(points + alone + 1);
  out.column.reserve(points * entries);
  out.coefficient.reserve(points * entries * entry_size);
}

/// Append the rows of the points of one piece. @param values values of each point,
/// [point][node][width]
/// @param first first of the nodes @param d unknowns of a node
void append_rows(GapOperator::Side& out, const PieceColumns& columns, std::size_t piece,
                 std::span<const double> values, std::size_t nodes, std::size_t first,
                 std::size_t width, std::size_t d)
{
  const auto order = columns.order_of(piece);
  const std::int32_t* column = &columns.column[piece * columns.num_nodes];
  const std::size_t in_row = width == 1 ? 1 : d, rows = width == 9 ? d : 1,
                    count = values.size() / (nodes * width);
  out.column.resize(out.column.size() + count * order.size());
  out.coefficient.resize(out.coefficient.size() + count * order.size() * rows * in_row);
  std::int32_t* to_column = out.column.data() + out.column.size() - count * order.size();
  double* to
      = out.coefficient.data() + out.coefficient.size() - count * order.size() * rows * in_row;
  for (std::size_t p = 0; p < values.size(); p += nodes * width)
  {
    for (std::uint32_t j : order)
    {
      *to_column++ = column[j];
      const double* value = &values[p + (first + j) * width];
      for (std::size_t r = 0; r < rows; ++r, value += 3)
        for (std::size_t i = 0; i < in_row; ++i)
          *to++ = value[i];
    }
    out.offset.push_back(out.offset.back() + static_cast<std::int64_t>(order.size()));
  }
}
} // namespace

void qsdolfinx::rows_of_pieces(std::span<GapOperator::Side> out, const Pieces& pieces,
                               std::size_t num_alone, std::size_t width, const OfPiece& values)
{
  const auto d = static_cast<std::size_t>(pieces.gdim);
  const std::array<const PieceSide*, 2> sides{&pieces.slave, &pieces.master};
  const auto ns = static_cast<std::size_t>(pieces.slave.num_nodes),
             nodes = ns + static_cast<std::size_t>(pieces.master.num_nodes);
  const std::size_t entry_size = width == 9 ? d * d : width == 3 ? d : 1;
  std::vector<PieceColumns> columns;
  for (std::size_t s = 0; s < out.size(); ++s)
  {
    const auto n = static_cast<std::size_t>(sides[s]->num_nodes);
    columns.emplace_back(node_keys(*sides[s], d), n);
    reserve_rows(out[s], pieces.points.size(), num_alone, n, entry_size);
    out[s].dofs.resize(columns[s].key.size() * d);
    for (std::size_t i = 0; i < columns[s].column.size(); ++i)
      for (std::size_t a = 0; a < d; ++a)
        out[s].dofs[static_cast<std::size_t>(columns[s].column[i]) * d + a]
            = static_cast<PetscInt>(sides[s]->dofs[i * d + a]);
    out[s].free_dofs = out[s].dofs;
  }
  for (std::size_t i = 0; i < pieces.size(); ++i)
  {
    const auto of_piece = values(i);
    for (std::size_t s = 0; s < out.size(); ++s)
      append_rows(out[s], columns[s], i, of_piece, nodes, s == 0 ? 0 : ns, width, d);
  }
  for (GapOperator::Side& side : out)
    side.offset.insert(side.offset.end(), num_alone, side.offset.back());
}

void qsdolfinx::multipliers_of_pieces(GapOperator::Side& out, const Pieces& pieces,
                                      std::span<const std::int64_t> alone)
{
  const auto nk = static_cast<std::size_t>(pieces.num_multipliers);
  std::vector<std::int64_t> others;
  std::ranges::copy_if(alone, std::back_inserter(others), [](std::int64_t u) { return u >= 0; });
  const PieceColumns columns(side_dofs(pieces), nk, others);
  reserve_rows(out, pieces.points.size(), alone.size(), nk, 1);
  std::vector<double> N;
  for (std::size_t i = 0; i < pieces.size(); ++i)
  {
    N.clear();
    for (const RayPoint& point : pieces.points_of(i))
    {
      const auto at
          = shape_functions(pieces.slave.type, pieces.cut_is_slave[i] ? point.xi : point.zeta);
      N.insert(N.end(), at.begin(), at.begin() + static_cast<std::ptrdiff_t>(nk));
    }
    append_rows(out, columns, i, N, nk, 0, 1, 1);
  }
  for (std::int64_t unknown : alone)
  {
    if (unknown >= 0)
    {
      out.column.push_back(columns.place(unknown));
      out.coefficient.push_back(1);
    }
    out.offset.push_back(static_cast<std::int64_t>(out.column.size()));
  }
  out.dofs.assign(columns.key.begin(), columns.key.end());
}

OfPiece qsdolfinx::gap_gradients_of(const Pieces& pieces)
{
  const auto nodes = static_cast<std::size_t>(pieces.slave.num_nodes + pieces.master.num_nodes);
  return [&pieces, nodes, values = std::vector<double>()](std::size_t i) mutable
  {
    const auto points = pieces.points_of(i);
    values.resize(points.size() * nodes * 3);
    gap_gradients(Rays(pair_of(pieces, i), points), values);
    return std::span<const double>(values);
  };
}

OfPiece qsdolfinx::jumps_of(const Pieces& pieces)
{
  return [&pieces, values = std::vector<double>()](std::size_t i) mutable
  {
    values.clear();
    for (const RayPoint& point : pieces.points_of(i))
    {
      const bool on_slave = pieces.cut_is_slave[i];
      const auto append = [&](const PieceSide& side, const std::array<double, 2>& xi, double sign)
      {
        const auto T = trace_functions(side.type, side.degree, xi);
        for (int j = 0; j < side.num_nodes; ++j)
          values.push_back(sign * T[static_cast<std::size_t>(j)]);
      };
      append(pieces.slave, on_slave ? point.xi : point.zeta, 1);
      append(pieces.master, on_slave ? point.zeta : point.xi, -1);
    }
    return std::span<const double>(values);
  };
}

OfPiece qsdolfinx::slips_of(const Pieces& pieces, const SlipOfPieces& slip, bool works)
{
  const auto nodes = static_cast<std::size_t>(pieces.slave.num_nodes + pieces.master.num_nodes);
  return [&pieces, &slip, works, nodes, rows = std::vector<double>(9 * nodes),
          values = std::vector<double>()](std::size_t i) mutable
  {
    const Rays rays(pair_of(pieces, i), pieces.points_of(i));
    const std::size_t first = i > 0 ? pieces.end[i - 1] : 0, count = pieces.end[i] - first;
    values.resize(9 * count * nodes);
    for (std::size_t p = 0; p < count; ++p)
    {
      const auto slides = std::span(works ? slip.works : slip.slides).subspan(9 * (first + p), 9);
      const auto chord = std::span(slip.chord).subspan(2 * (first + p), works ? 0 : 2);
      slip_rows(rays, p, slides, chord, rows);
      for (std::size_t j = 0; j < nodes; ++j)
        for (std::size_t r = 0; r < 3; ++r)
          std::copy_n(&rows[3 * (r * nodes + j)], 3, &values[9 * (p * nodes + j) + 3 * r]);
    }
    return std::span<const double>(values);
  };
}

SlipOfPieces::SlipOfPieces(const Pieces& pieces, Vec slave_start, Vec master_start,
                           std::span<const double> of_tool)
{
  const auto d = static_cast<std::size_t>(pieces.gdim),
             ns = static_cast<std::size_t>(pieces.slave.num_nodes),
             nm = static_cast<std::size_t>(pieces.master.num_nodes);
  if (!master_start && of_tool.size() != 12)
    throw std::invalid_argument("a rigid tool's map has 3 rows of 4 numbers");
  const auto in_space = [d](const std::vector<double>& from, std::size_t first, std::size_t nodes)
  {
    std::vector<double> out(3 * nodes, 0.0);
    for (std::size_t j = 0; j < nodes; ++j)
      std::copy_n(from.begin() + static_cast<std::ptrdiff_t>((first + j) * d), d,
                  out.begin() + static_cast<std::ptrdiff_t>(3 * j));
    return out;
  };
  const std::vector<double> of_slave = values_at(slave_start, pieces.slave.dofs);
  const std::vector<double> of_master
      = master_start ? values_at(master_start, pieces.master.dofs) : std::vector<double>{};
  const std::size_t n = pieces.points.size();
  slip.resize(3 * n);
  normal.resize(3 * n);
  slides.resize(9 * n);
  chord.resize(2 * n);
  works.resize(9 * n);
  slope.resize(6 * n);
  arc.resize(n);
  gap.resize(n);
  turn.resize(9 * pieces.size());
  std::size_t done = 0;
  for (std::size_t i = 0; i < pieces.size(); ++i)
  {
    const RayPair pair = pair_of(pieces, i);
    const auto points = pieces.points_of(i);
    const std::vector<double> first = in_space(of_slave, i * ns, ns);
    std::vector<double> second(3 * nm);
    if (master_start)
      second = in_space(of_master, i * nm, nm);
    else
      for (std::size_t j = 0; j < nm; ++j)
      {
        const Vec3 x = facet_vertex(pieces.master.x_of(i), static_cast<int>(j));
        for (std::size_t r = 0; r < 3; ++r)
          second[3 * j + r] = of_tool[4 * r] * x[0] + of_tool[4 * r + 1] * x[1]
                              + of_tool[4 * r + 2] * x[2] + of_tool[4 * r + 3];
      }
    const RayStart start{pair.cut_is_slave ? first : second, pair.cut_is_slave ? second : first};
    const std::size_t count = points.size();
    turn_since(pair, start, std::span(turn).subspan(9 * i, 9));
    slip_of_points(Rays(pair, points), start,
                   {std::span(slip).subspan(3 * done, 3 * count),
                    std::span(normal).subspan(3 * done, 3 * count),
                    std::span(slides).subspan(9 * done, 9 * count),
                    std::span(chord).subspan(2 * done, 2 * count),
                    std::span(works).subspan(9 * done, 9 * count),
                    std::span(slope).subspan(6 * done, 6 * count),
                    std::span(arc).subspan(done, count), std::span(gap).subspan(done, count)});
    done += count;
  }
}
