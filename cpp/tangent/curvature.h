// The part of the tangent that comes from gaps and slip being no linear functions of the unknowns.
#pragma once

#include "pairing/pieces.h"
#include "surface/surface.h"
#include "tangent/insertion.h"

namespace qsdolfinx
{

/// Add Σ_p w_p p_p ∂²g_p of points of pieces, ξ and w fixed, and what their motion on the facets
/// and heights add, to the blocks (ss, sm, ms, mm). Not symmetric. Collective.
/// @param pieces where rays have been solved for
/// @param master null for a rigid tool
/// @param pressure p_p, [point], which stays
/// @param moves whether points move, and heights change
/// @param markers vectors of the bodies, nonzero at unknowns with Dirichlet conditions
/// @param scale displacement per unknown of each body
void insert_curvature_of_points(const Surface* master, const Pieces& pieces,
                                std::span<const double> pressure, bool moves,
                                std::array<Vec, 2> markers, ContactBlocks blocks,
                                std::array<double, 2> scale);

/// Add how the forces of friction change with tractions at the points held, likewise. Collective.
/// @param traction τ_p, [point][3]
void insert_slip_curvature_of_points(const Surface* master, const Pieces& pieces,
                                     std::span<const double> traction, bool moves,
                                     std::array<Vec, 2> markers, ContactBlocks blocks,
                                     std::array<double, 2> scale);

} // namespace qsdolfinx
