// Weighted gaps of slave nodes and their derivatives, from pieces that follow the bodies.
#pragma once

#include "pairing/pieces.h"
#include "surface/surface.h"

#include <petscvec.h>

namespace qsdolfinx
{

/// What pieces give to the multipliers of this rank, one row for each piece and multiplier:
/// G_k = Σ_p w_p N_k g_p, its derivative by the nodes of both facets, and what belongs to friction.
/// Columns are the nodes of the slave's facet, then those of the master's.
struct PieceRows
{
  /// Collective. @param pieces where rays have been solved for, see solve_pieces @param cover see
  /// Shares @param allowance a_k at the first unknown of each node, a vector of the slave's body:
  /// penetration that counts as none; null for none @param with_columns whether derivatives are
  /// wanted; otherwise rows have no columns. Pieces that are missed are left out.
  PieceRows(const Surface& slave, const Pieces& pieces, Vec cover, Vec allowance,
            bool with_columns);

  /// The objective slip of each multiplier along one axis, see add_slip: its variation takes the
  /// gradient's place, the other sums are none. Collective. @param pieces as the above left them
  PieceRows(const Surface& slave, const Pieces& pieces, Vec cover, int axis);

  /// Sums over points of the slave's facets, before a rigid tool: rows of the marked facets of this
  /// rank. Collective. @param marked [facet] @param cover, gap [facet][k] @param jump [facet][k][3]
  /// @param gradient [facet][k][node][3] @param mass [facet][k][node]
  PieceRows(const Surface& slave, std::span<const std::uint8_t> marked,
            std::span<const double> cover, std::span<const double> gap,
            std::span<const double> jump, std::span<const double> gradient,
            std::span<const double> mass);

  int gdim, num_slave, num_master; ///< columns of either side
  std::vector<std::size_t> node;   ///< owned node of the slave, [row]
  std::vector<std::uint8_t> side;  ///< its smooth side, [row]
  std::vector<double> cover;       ///< Σ_p w_p N_k, [row]
  std::vector<double> gap;         ///< G_k, positive in penetration, [row]
  std::vector<double> jump;        ///< Σ_p w_p N_k (x_slave − x_master), [row][3]
  std::vector<double> gradient;    ///< of G_k − a_k Σ_p w_p N_k, [row][column][3]
  std::vector<double> mass;        ///< Σ_p w_p N_k T_j, negative for the master, [row][column]
  std::vector<std::int64_t> dofs;  ///< [row][column][gdim]

  std::size_t size() const { return node.size(); }
  int num_columns() const { return num_slave + num_master; }
  /// Sums over the rows of each owned node, [node][width]. @param values [row][width]
  std::vector<double> on_nodes(const std::vector<double>& values, std::size_t num_nodes,
                               std::size_t width) const;
  /// Sums over the rows of each side of the owned nodes, [node][gdim]. @param values [row]
  std::vector<double> on_sides(const std::vector<double>& values, std::size_t num_nodes) const;

private:
  void append_received(const Surface& slave, std::span<const int> dest,
                       const std::vector<double>& doubles,
                       const std::vector<std::int64_t>& integers);
};

} // namespace qsdolfinx
