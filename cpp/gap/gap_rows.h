// Rows of the gap operator from pairing points. No MPI but for the range of unknowns a rank owns.
#pragma once

#include "gap/gap.h"

namespace qsdolfinx
{

/// A multiplier of this rank and a range of points that lie on the same two facets.
struct Patch
{
  const PairingPoints* points;
  std::size_t first, last; ///< points
  int multiplier;          ///< place among the slave facet's vertices
  std::int64_t node;       ///< index in the slave surface's nodes

  double multiplier_value(std::size_t p) const
  {
    return points->multiplier_values[p * points->num_multipliers + multiplier];
  }
  /// w_p N_k(ξ_p)
  double weight(std::size_t p) const { return points->weight[p] * multiplier_value(p); }
};

/// All patches of several sets of points, in the order of the points. Collective.
std::vector<Patch> find_patches(const Surface& slave, std::span<const PairingPoints* const> sets);

/// Σ_p w_p N_k over a patch.
double cover(const Patch& patch);

/// Coefficients of one side's unknowns in all rows, before equal columns of a row are added.
class RowTerms
{
public:
  /// @param side 0: slave, 1: master
  /// @param area what the gap of each slave node is divided by
  RowTerms(std::span<const Patch> patches, int side, GapKind kind, std::span<const double> area);

  /// Row of each node, -1 without, and the nodes that have one, ascending.
  std::vector<std::int64_t> rows(std::size_t num_nodes, std::vector<std::int64_t>& row_node) const;

  /// Rows in compressed form, columns ascending by their unknowns. Cost: linear in the terms, n log
  /// n in the columns.
  void compress(GapOperator::Side& out, int gdim, std::span<const std::int64_t> row_of,
                std::size_t num_rows) const;

private:
  struct Term
  {
    std::int64_t node;
    std::int32_t column;         ///< in the order of appearance
    std::array<double, 3> value; ///< Σ w N_k N_column (n) / S_k, negative for the master
  };

  std::vector<std::int32_t> number_columns(GapOperator::Side& out, int gdim) const;

  int width_;
  std::vector<Term> terms_;
  std::vector<const std::int64_t*> column_dofs_; ///< unknowns of each column node
};

} // namespace qsdolfinx
