// Values of vectors at the nodes of pieces, and forces that friction puts there.
#pragma once

#include "pairing/pieces.h"

#include <petscvec.h>

namespace qsdolfinx
{

/// Values of a distributed vector at some unknowns, in their order. Collective.
std::vector<double> values_at(Vec x, std::span<const std::int64_t> dofs);

/// The two facets of a piece.
RayPair pair_of(const Pieces& pieces, std::size_t piece);

/// Add Σ_k τ_k·(D δx_slave − M δx_master − δV)_k: the work of friction on slip that no rigid motion
/// has, so that each point conserves momentum and moment. Collective.
/// @param pieces where rays have been solved for
/// @param traction τ_k at the unknowns of each node, a vector of the slave's body
/// @param b vectors of both bodies; of a rigid master null
void add_slip_forces(const Pieces& pieces, Vec traction, std::array<Vec, 2> b);

} // namespace qsdolfinx
