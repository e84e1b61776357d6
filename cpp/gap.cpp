#include "gap.h"
#include "exchange.h"

#include <algorithm>
#include <map>
#include <tuple>

using namespace qsdolfinx;

namespace
{
/// Pairing points that other ranks found and that act on multipliers of this one.
PairingPoints points_from_others(const Surface& slave, const PairingPoints& points)
{
  const int nk = points.num_multipliers, ns = points.slave.num_nodes, nm = points.master.num_nodes,
            d = points.gdim;
  const int num_doubles = nk + ns + nm + 5, num_dofs = (ns + nm) * d;
  int this_rank;
  MPI_Comm_rank(slave.comm(), &this_rank);
  std::vector<int> dest;
  std::vector<double> doubles;
  std::vector<std::int64_t> dofs;
  for (std::size_t p = 0; p < points.size(); ++p)
  {
    std::array<int, 4> sent;
    sent.fill(this_rank);
    for (int i = 0; i < nk; ++i)
    {
      const int rank = points.slave.owner[p * ns + i];
      if (points.multiplier_values[p * nk + i] == 0
          || std::find(sent.begin(), sent.end(), rank) != sent.end())
        continue;
      sent[i] = rank;
      dest.push_back(rank);
      const auto append = [p](auto& out, const auto& in, int width)
      { out.insert(out.end(), in.begin() + p * width, in.begin() + (p + 1) * width); };
      append(doubles, points.multiplier_values, nk);
      append(doubles, points.slave.shape_values, ns);
      append(doubles, points.master.shape_values, nm);
      append(doubles, points.normal, 3);
      append(doubles, points.gap, 1);
      append(doubles, points.weight, 1);
      append(dofs, points.slave.dofs, ns * d);
      append(dofs, points.master.dofs, nm * d);
    }
  }
  const Exchange exchange(slave.comm(), dest);
  doubles = exchange.forward<double>(doubles, num_doubles);
  dofs = exchange.forward<std::int64_t>(dofs, num_dofs);

  PairingPoints out = points.none_like();
  for (std::size_t p = 0; p < exchange.num_received(); ++p)
  {
    const double* v = doubles.data() + p * num_doubles;
    const auto take = [&v](std::vector<double>& to, int n)
    {
      to.insert(to.end(), v, v + n);
      v += n;
    };
    take(out.multiplier_values, nk);
    take(out.slave.shape_values, ns);
    take(out.master.shape_values, nm);
    take(out.normal, 3);
    take(out.gap, 1);
    take(out.weight, 1);
    const std::int64_t* i = dofs.data() + p * num_dofs;
    out.slave.dofs.insert(out.slave.dofs.end(), i, i + ns * d);
    out.master.dofs.insert(out.master.dofs.end(), i + ns * d, i + num_dofs);
  }
  return out;
}

/// Points of this rank and from others.
using PointSets = std::array<const PairingPoints*, 2>;

/// Call visit(points, first, last, multiplier, row node) for every multiplier of this rank and
/// every range of points that lie on the same two facets.
template <typename Visit>
void for_each_row(const Surface& slave, const PointSets& sets,
                  std::pair<std::int64_t, std::int64_t> owned, Visit visit)
{
  for (const PairingPoints* points : sets)
  {
    const int nk = points->num_multipliers, d = points->gdim;
    const auto facet = [d](const PairingSide& side, std::size_t p)
    {
      const std::size_t width = static_cast<std::size_t>(side.num_nodes) * d;
      return std::span(side.dofs).subspan(p * width, width);
    };
    for (std::size_t first = 0, last; first < points->size(); first = last)
    {
      const auto on_slave = facet(points->slave, first), on_master = facet(points->master, first);
      for (last = first + 1; last < points->size(); ++last)
        if (!std::ranges::equal(facet(points->slave, last), on_slave)
            || !std::ranges::equal(facet(points->master, last), on_master))
          break;
      for (int i = 0; i < nk; ++i)
        if (const std::int64_t dof = on_slave[i * d]; dof >= owned.first && dof < owned.second)
          visit(*points, first, last, i, static_cast<std::int64_t>(slave.node_index(dof)));
    }
  }
}

/// Σ_p w_p N_k over a range of points.
double cover(const PairingPoints& points, std::size_t first, std::size_t last, int multiplier)
{
  double sum = 0;
  for (std::size_t p = first; p < last; ++p)
    sum += points.weight[p] * points.multiplier_values[p * points.num_multipliers + multiplier];
  return sum;
}

/// One term of a row before equal columns are merged.
struct Term
{
  std::int64_t row;
  const std::int64_t* dofs;    // unknowns of the column node
  std::array<double, 3> value; // Σ w N_k N_column (n) / S_k, negative for the master
};

/// Terms of one side's columns in all rows, sorted by row and column.
/// @param area what the gap of each slave node is divided by
std::vector<Term> row_terms(const Surface& slave, const PointSets& sets, int side, GapKind kind,
                            std::pair<std::int64_t, std::int64_t> owned,
                            const std::vector<double>& area)
{
  std::vector<Term> terms;
  for_each_row(
      slave, sets, owned,
      [&](const PairingPoints& points, std::size_t first, std::size_t last, int k, std::int64_t row)
      {
        const PairingSide& columns = side == 0 ? points.slave : points.master;
        const int nc = columns.num_nodes, nk = points.num_multipliers;
        const double sign = (side == 0 ? 1.0 : -1.0) / area[row];
        for (int j = 0; j < nc; ++j)
        {
          Term term{row, &columns.dofs[(first * nc + j) * points.gdim], {0, 0, 0}};
          bool any = false;
          for (std::size_t p = first; p < last; ++p)
          {
            const double N = points.multiplier_values[p * nk + k];
            const double M = columns.shape_values[p * nc + j];
            const double w = sign * points.weight[p] * N * M;
            any = any || (N != 0 && M != 0);
            for (int i = 0; i < 3; ++i)
              term.value[i] += w * (kind == GapKind::normal ? points.normal[3 * p + i] : 1.0);
          }
          if (any)
            terms.push_back(term);
        }
      });
  std::stable_sort(terms.begin(), terms.end(), [](const Term& a, const Term& b)
                   { return std::pair(a.row, *a.dofs) < std::pair(b.row, *b.dofs); });
  return terms;
}

/// Rows of one side in compressed form.
void compress(GapOperator::Side& out, const std::vector<Term>& terms, int d, GapKind kind,
              std::span<const std::int64_t> row_node)
{
  std::map<std::int64_t, std::int32_t> numbering;
  for (const Term& t : terms)
    numbering.emplace(*t.dofs, 0);
  std::int32_t next = 0;
  for (auto& [dof, number] : numbering)
    number = next++;
  out.dofs.resize(numbering.size() * d);

  const int width = kind == GapKind::normal ? d : 1;
  out.offset.assign(1, 0);
  std::size_t t = 0;
  for (std::int64_t row : row_node)
  {
    for (; t < terms.size() && terms[t].row == row; ++t)
    {
      const Term& term = terms[t];
      const std::int32_t column = numbering.at(*term.dofs);
      const bool first = out.column.size() == static_cast<std::size_t>(out.offset.back())
                         || out.column.back() != column;
      if (first)
      {
        out.column.push_back(column);
        out.coefficient.insert(out.coefficient.end(), width, 0.0);
        for (int i = 0; i < d; ++i)
          out.dofs[column * d + i] = static_cast<PetscInt>(term.dofs[i]);
      }
      double* c = &out.coefficient[out.coefficient.size() - width];
      for (int i = 0; i < width; ++i)
        c[i] += term.value[i];
    }
    out.offset.push_back(static_cast<std::int64_t>(out.column.size()));
  }
  out.free_dofs = out.dofs;
}
} // namespace

GapOperator::GapOperator(const Surface& slave, const Surface* master, const PairingPoints& points,
                         GapKind kind, bool by_cover)
    : kind_(kind), gdim_(points.gdim), num_sides_(master ? 2 : 1)
{
  const PairingPoints others = points_from_others(slave, points);
  build_rows(slave, {&points, &others}, by_cover);
  build_scatters(slave, master);
}

GapOperator::~GapOperator()
{
  PetscBool finalized = PETSC_FALSE;
  if (PetscFinalized(&finalized) != PETSC_SUCCESS || finalized)
    return;
  for (Side& side : sides_)
  {
    std::ignore = VecDestroy(&side.local);
    std::ignore = VecScatterDestroy(&side.scatter);
  }
}

void GapOperator::build_rows(const Surface& slave, const PointSets& sets, bool by_cover)
{
  std::int64_t end = 0, size = slave.local_size();
  MPI_Scan(&size, &end, 1, MPI_INT64_T, MPI_SUM, slave.comm());
  const std::pair owned{end - size, end};

  std::vector<double> area = slave.nodes().area;
  if (by_cover)
  {
    std::ranges::fill(area, 0.0);
    for_each_row(slave, sets, owned,
                 [&](const PairingPoints& points, std::size_t first, std::size_t last, int k,
                     std::int64_t node) { area[node] += cover(points, first, last, k); });
  }
  const std::array terms{row_terms(slave, sets, 0, kind_, owned, area),
                         row_terms(slave, sets, 1, kind_, owned, area)};
  for (const Term& t : terms[0])
    if (row_node_.empty() || row_node_.back() != t.row)
      row_node_.push_back(t.row);
  for (int side = 0; side < 2; ++side)
    compress(sides_[side], terms[side], gdim_, kind_, row_node_);

  for (std::int64_t node : row_node_)
    row_area_.push_back(area[node]);
  initial_gap_.assign(row_node_.size(), 0);
  if (kind_ == GapKind::jump)
    return;
  for_each_row(slave, sets, owned,
               [&](const PairingPoints& points, std::size_t first, std::size_t last, int k,
                   std::int64_t node)
               {
                 const auto row = std::lower_bound(row_node_.begin(), row_node_.end(), node);
                 if (row == row_node_.end() || *row != node)
                   return; // its function vanishes at all these points
                 for (std::size_t p = first; p < last; ++p)
                   initial_gap_[row - row_node_.begin()]
                       += points.weight[p]
                          * points.multiplier_values[p * points.num_multipliers + k] * points.gap[p]
                          / area[node];
               });
}

void GapOperator::build_scatters(const Surface& slave, const Surface* master)
{
  for (int i = 0; i < num_sides_; ++i)
  {
    Side& side = sides_[i];
    const Surface& surface = i == 0 ? slave : *master;
    const auto n = static_cast<PetscInt>(side.dofs.size());
    Vec layout;
    IS is;
    check(VecCreateMPI(surface.comm(), static_cast<PetscInt>(surface.local_size()), PETSC_DETERMINE,
                       &layout));
    check(VecCreateSeq(PETSC_COMM_SELF, n, &side.local));
    check(ISCreateGeneral(PETSC_COMM_SELF, n, side.dofs.data(), PETSC_USE_POINTER, &is));
    check(VecScatterCreate(layout, is, side.local, nullptr, &side.scatter));
    check(ISDestroy(&is));
    check(VecDestroy(&layout));
  }
}

std::vector<double> GapOperator::slave_sum() const
{
  const std::size_t width = kind_ == GapKind::normal ? gdim_ : 1;
  std::vector<double> sum(num_rows() * width, 0);
  for (std::size_t r = 0; r < num_rows(); ++r)
    for (std::int64_t e = sides_[0].offset[r]; e < sides_[0].offset[r + 1]; ++e)
      for (std::size_t i = 0; i < width; ++i)
        sum[r * width + i] += sides_[0].coefficient[e * width + i];
  return sum;
}

std::vector<double> GapOperator::apply(std::array<Vec, 2> x, std::array<double, 2> scale)
{
  std::vector<double> g(num_rows() * width(), 0);
  for (int s = 0; s < num_sides_; ++s)
  {
    Side& side = sides_[s];
    check(VecScatterBegin(side.scatter, x[s], side.local, INSERT_VALUES, SCATTER_FORWARD));
    check(VecScatterEnd(side.scatter, x[s], side.local, INSERT_VALUES, SCATTER_FORWARD));
    const PetscScalar* values;
    check(VecGetArrayRead(side.local, &values));
    for (std::size_t r = 0; r < num_rows(); ++r)
    {
      for (std::int64_t e = side.offset[r]; e < side.offset[r + 1]; ++e)
      {
        for (int i = 0; i < gdim_; ++i)
        {
          const double value = scale[s] * values[side.column[e] * gdim_ + i];
          if (kind_ == GapKind::normal)
            g[r] += side.coefficient[e * gdim_ + i] * value;
          else
            g[r * gdim_ + i] += side.coefficient[e] * value;
        }
      }
    }
    check(VecRestoreArrayRead(side.local, &values));
  }
  return g;
}

void GapOperator::add_transpose(std::span<const double> f, std::array<Vec, 2> b, bool slave_only)
{
  if (f.size() != num_rows() * width())
    throw std::invalid_argument("f must hold `width` values per row");
  for (int s = 0; s < (slave_only ? 1 : num_sides_); ++s)
  {
    Side& side = sides_[s];
    check(VecSet(side.local, 0));
    PetscScalar* y;
    check(VecGetArray(side.local, &y));
    for (std::size_t r = 0; r < num_rows(); ++r)
    {
      for (std::int64_t e = side.offset[r]; e < side.offset[r + 1]; ++e)
      {
        for (int i = 0; i < gdim_; ++i)
          y[side.column[e] * gdim_ + i] += kind_ == GapKind::normal
                                               ? side.coefficient[e * gdim_ + i] * f[r]
                                               : side.coefficient[e] * f[r * gdim_ + i];
      }
    }
    check(VecRestoreArray(side.local, &y));
    check(VecScatterBegin(side.scatter, side.local, b[s], ADD_VALUES, SCATTER_REVERSE));
    check(VecScatterEnd(side.scatter, side.local, b[s], ADD_VALUES, SCATTER_REVERSE));
  }
}

void GapOperator::constrain(std::array<Vec, 2> markers)
{
  for (int s = 0; s < num_sides_; ++s)
  {
    Side& side = sides_[s];
    check(VecScatterBegin(side.scatter, markers[s], side.local, INSERT_VALUES, SCATTER_FORWARD));
    check(VecScatterEnd(side.scatter, markers[s], side.local, INSERT_VALUES, SCATTER_FORWARD));
    const PetscScalar* marked;
    check(VecGetArrayRead(side.local, &marked));
    for (std::size_t i = 0; i < side.dofs.size(); ++i)
      side.free_dofs[i] = marked[i] != 0 ? -1 : side.dofs[i];
    check(VecRestoreArrayRead(side.local, &marked));
  }
}
