// Rows of the gap operator from pairing points. MPI is used only for the range of unknowns that a
// rank owns.
#pragma once

#include "gap/gap.h"

namespace qsdolfinx
{

/// Slots for the multipliers of the slave's owned nodes: one for each smooth side of a node in a
/// corner. Other nodes use the first of their slots. Without corners there is one slot per node.
struct Slots
{
  std::size_t num_nodes, per_node;
  std::span<const std::uint8_t> in_corner; ///< [node], empty if per_node is 1

  Slots(const Surface& slave, const PairingPoints& points);
  std::size_t size() const { return num_nodes * per_node; }
  std::size_t operator()(std::size_t node, std::uint8_t side) const
  {
    return node * per_node + (per_node > 1 && in_corner[node] ? side : 0);
  }
};

/// A multiplier of this rank together with a range of points that lie on the same two facets.
struct Patch
{
  const PairingPoints* points;
  std::size_t first, last; ///< points
  int multiplier;          ///< place among the slave facet's vertices
  std::size_t slot;        ///< see Slots

  double multiplier_value(std::size_t p) const
  {
    return points->multiplier_values[p * points->num_multipliers + multiplier];
  }
  /// w_p N_k(ξ_p)
  double weight(std::size_t p) const { return points->weight[p] * multiplier_value(p); }
};

/// All patches of several sets of points, in the order of the points. Collective.
std::vector<Patch> find_patches(const Surface& slave, std::span<const PairingPoints* const> sets,
                                const Slots& slots);

/// Σ_p w_p N_k over a patch.
double cover(const Patch& patch);

/// Coefficients of one side's unknowns in all rows, before equal columns of a row are added.
class RowTerms
{
public:
  /// @param side 0: slave, 1: master
  /// @param area area by which the gap of each slot is divided
  RowTerms(std::span<const Patch> patches, int side, GapKind kind, std::span<const double> area);

  /// Row of each slot, -1 if it has no row, and the slots that have a row, ascending.
  std::vector<std::int64_t> rows(std::size_t num_slots, std::vector<std::size_t>& row_slot) const;

  /// Rows in compressed form, columns ascending by their unknowns. Cost: linear in the terms, n log
  /// n in the columns.
  void compress(GapOperator::Side& out, int block, std::span<const std::int64_t> row_of,
                std::size_t num_rows) const;

private:
  struct Term
  {
    std::size_t slot;
    std::int32_t column; ///< in the order of appearance
  };

  std::vector<std::int32_t> number_columns(GapOperator::Side& out, int block) const;

  std::size_t width_; ///< see GapOperator::entry_size
  std::vector<Term> terms_;
  std::vector<double> values_; ///< Σ w N_k N_column (n) / S_k, master negative; [term]
  std::vector<const std::int64_t*> column_dofs_; ///< unknowns of each column node
};

} // namespace qsdolfinx
