#include "gap/point_rows.h"

#include <algorithm>
#include <numeric>

using namespace qsdolfinx;

namespace
{
/// What rows are made of: functions at the points of the nodes of a facet.
struct Functions
{
  const std::vector<std::int64_t>& dofs; ///< [point][node of the facet][block]
  const std::vector<double>& values;     ///< [point][function]
  std::size_t num_nodes, num_functions, block;
  const std::vector<std::uint8_t>* component = nullptr; ///< [point][function]; null: the first ones

  /// Unknown that stands for the node of a function.
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

/// What stands for all nodes that have a function somewhere, ascending.
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
  std::vector<std::size_t> order;   // of the functions of the present facet, by their columns
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
}
} // namespace

void qsdolfinx::rows_at_points(GapOperator::Side& out, const PairingPoints& points, int side,
                               GapKind kind)
{
  const PairingSide& s = side == 0 ? points.slave : points.master;
  const auto n = static_cast<std::size_t>(s.num_nodes), d = static_cast<std::size_t>(points.block);
  const Functions f{s.dofs, s.shape_values, n, n, d};
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
  // The unknowns of a node need not follow each other: they are read where it appears.
  out.dofs.resize(columns.size() * d);
  for (std::size_t p = 0; p < points.size(); ++p)
    if (p == 0 || !f.same_columns(p, p - 1))
      for (std::size_t j = 0; j < n; ++j)
        if (f.used(p, j))
        {
          const auto at = std::ranges::lower_bound(columns, f.dof(p, j)) - columns.begin();
          for (std::size_t i = 0; i < d; ++i)
            out.dofs[at * d + i] = static_cast<PetscInt>(s.dofs[(p * n + j) * d + i]);
        }
  out.free_dofs = out.dofs;
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
