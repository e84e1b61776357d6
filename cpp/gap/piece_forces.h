// Values of vectors at the nodes of pieces, and forces that friction puts there.
#pragma once

#include "pairing/pieces.h"

#include <petscvec.h>

namespace qsdolfinx
{

/// Values of a distributed vector at some unknowns, in their order. Collective.
std::vector<double> values_at(Vec x, std::span<const std::int64_t> dofs);

/// Let facets that rays of vertices end on stand for the curved surface with these normals at its
/// nodes, so that forces do not jump where a point goes from facet to facet. Collective.
/// @param normals unit vectors, a vector of the body or tool that they are of; 0 at nodes at
/// creases
void raise_facets(Pieces& pieces, Vec normals);

/// Distances along the rays to the facets, or to what they stand for, positive when open, [point].
std::vector<double> distances_of(const Pieces& pieces);

/// First unknowns of the nodes with multipliers, [piece][multiplier].
std::vector<std::int64_t> first_dofs(const Pieces& pieces);

/// Unknowns of the nodes with multipliers, [piece][multiplier][gdim].
std::vector<std::int64_t> multiplier_dofs(const Pieces& pieces);

/// Unknowns that stand for the smooth sides of the nodes with multipliers, [piece][multiplier].
std::vector<std::int64_t> side_dofs(const Pieces& pieces);

/// Values Σ_k N_k v_k at the points of the rim, [point]. Collective. @param values v_k at the
/// unknowns that stand for the sides of nodes, a vector of the slave's body
std::vector<double> values_at_rim(const Pieces& pieces, Vec values);

/// Which multipliers of a slave's facet carry those of its hardly covered vertices, as beyond the
/// rim of the master: two that are to close nearly the same gap would grow against each other. So
/// do they on all smooth sides of a node but one: the mean gap of two sides lets an edge in.
class Shares
{
public:
  /// Collective. @param cover at the unknowns of each node of the slave that stand for its sides
  /// the part of its area that is covered if they keep its multiplier, else 0; null if all do
  Shares(const Pieces& pieces, Vec cover);

  /// Rows of the multipliers of a piece, [k][width], are shared out: N_k are.
  void share_out(std::size_t piece, std::span<double> rows) const;
  /// The opposite for values of multipliers, [k][width]: what the functions see.
  void gather(std::size_t piece, std::span<double> values) const;

private:
  std::size_t num_multipliers_;
  std::vector<double> cover_; ///< [piece][k], empty if all keep theirs
};

/// Add Σ_k τ_k·(D δx_slave − M δx_master − δV)_k: the work of friction on slip that no rigid motion
/// has, so that each point conserves momentum and moment. Collective.
/// @param pieces where rays have been solved for
/// @param cover see Shares
/// @param traction τ_k at the unknowns of each node, a vector of the slave's body
/// @param b vectors of both bodies; of a rigid master null
void add_slip_forces(const Pieces& pieces, Vec cover, Vec traction, std::array<Vec, 2> b);

} // namespace qsdolfinx
