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

/// Distances along the rays to the facets, or to what they stand for, positive when open, [point].
std::vector<double> distances_of(const Pieces& pieces);

/// Σ_p w_p N_k, [piece][multiplier].
std::vector<double> cover_of(const Pieces& pieces);

/// Unknowns that stand for the smooth sides of the nodes with multipliers, [piece][multiplier].
std::vector<std::int64_t> side_dofs(const Pieces& pieces);

} // namespace qsdolfinx
