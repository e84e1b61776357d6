// Values of vectors at the nodes and points of pieces.
#pragma once

#include "pairing/pieces.h"

#include <petscvec.h>

namespace qsdolfinx
{

/// Values of a distributed vector at some unknowns, in their order. Collective.
std::vector<double> values_at(Vec x, std::span<const std::int64_t> dofs);

/// Let forces at vertices act along the normals of the curved surface that has the given normals at
/// its nodes, so that forces do not jump when a point moves from one facet to the next.
/// Collective.
/// @param normals unit vectors, stored in a vector of the body or tool; 0 at nodes on sharp edges
void raise_facets(Pieces& pieces, Vec normals);

/// Side whose facets the rays of vertices end on.
const PieceSide& raised_side(const Pieces& pieces);

/// Derivatives by the normals given to raise_facets: rows, unknowns that represent components of a
/// normal, and values.
struct ByNormals
{
  std::vector<std::int64_t> row, column;
  std::vector<double> value;

  void append(std::int64_t i, std::int64_t j, double v)
  {
    if (v == 0)
      return;
    row.push_back(i);
    column.push_back(j);
    value.push_back(v);
  }
};

/// Derivatives of the forces of constant pressures or tractions by the normals; rows are unknowns
/// of the slave's and of the master's body. @param stress [point] or [point][3]
std::array<ByNormals, 2> forces_by_normals(const Pieces& pieces, std::span<const double> stress,
                                           bool slips);

/// Distances along the rays to the facets, positive when open, [point].
std::vector<double> distances_of(const Pieces& pieces);

/// Σ_p w_p N_k, [piece][multiplier].
std::vector<double> cover_of(const Pieces& pieces);

/// Unknowns that represent the smooth sides of the nodes with multipliers, [piece][multiplier].
std::vector<std::int64_t> side_dofs(const Pieces& pieces);

} // namespace qsdolfinx
