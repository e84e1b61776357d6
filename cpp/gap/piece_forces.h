// Values of vectors at the nodes and points of pieces.
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

/// The side whose facets rays of vertices end on.
const PieceSide& raised_side(const Pieces& pieces);

/// Derivatives by these normals: rows, unknowns that stand for components of a normal, values.
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

/// Of the gaps; rows are points.
ByNormals gaps_by_normals(const Pieces& pieces);

/// Of the forces of pressures, or of tractions, that stay; rows are unknowns of the slave's and of
/// the master's body. @param stress [point] or [point][3]
std::array<ByNormals, 2> forces_by_normals(const Pieces& pieces, std::span<const double> stress,
                                           bool slips);

/// Distances along the rays to the facets, or to what they stand for, positive when open, [point].
std::vector<double> distances_of(const Pieces& pieces);

/// Σ_p w_p N_k, [piece][multiplier].
std::vector<double> cover_of(const Pieces& pieces);

/// Unknowns that stand for the smooth sides of the nodes with multipliers, [piece][multiplier].
std::vector<std::int64_t> side_dofs(const Pieces& pieces);

} // namespace qsdolfinx
