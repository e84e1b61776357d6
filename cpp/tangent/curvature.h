// The part of the tangent that comes from gaps and slip being no linear functions of the unknowns.
#pragma once

#include "pairing/pieces.h"
#include "surface/surface.h"
#include "tangent/insertion.h"

namespace qsdolfinx
{

/// Add Σ_p w_p p_p ∂²g_p of points of pieces, ξ and w fixed, and what the rims of pieces add by
/// moving across the facets, to the blocks (ss, sm, ms, mm). Not symmetric: rims may be open ends.
/// Collective.
/// @param pieces where rays have been solved for
/// @param master null for a rigid tool
/// @param pressure p_p, [point] @param at_rim p at the points of the rim, [point]
/// @param markers vectors of the bodies, nonzero at unknowns with Dirichlet conditions
/// @param scale displacement per unknown of each body
void insert_curvature_of_points(const Surface* master, const Pieces& pieces,
                                std::span<const double> pressure, std::span<const double> at_rim,
                                std::array<Vec, 2> markers, ContactBlocks blocks,
                                std::array<double, 2> scale);

/// Add how the forces of friction change with tractions at the points held, likewise. Collective.
/// @param traction τ_p, [point][3]
/// @param at_rim τ at the points of the rim, [point][3]
void insert_slip_curvature_of_points(const Surface* master, const Pieces& pieces,
                                     std::span<const double> traction,
                                     std::span<const double> at_rim, std::array<Vec, 2> markers,
                                     ContactBlocks blocks, std::array<double, 2> scale);

} // namespace qsdolfinx
