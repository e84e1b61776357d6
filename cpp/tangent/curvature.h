// The part of the tangent that comes from gaps and slip being no linear functions of the unknowns.
#pragma once

#include "pairing/pieces.h"
#include "surface/surface.h"
#include "tangent/insertion.h"

namespace qsdolfinx
{

/// Add Σ_k λ_k ∂²G_k, at fixed points, and what the rims of pieces add by moving across the facets,
/// to the blocks (ss, sm, ms, mm). Collective.
/// @param pieces where rays have been solved for
/// @param master null for a rigid tool
/// @param cover see Shares
/// @param lambda λ_k at the first unknown of each node, a vector of the slave's body
/// @param allowance a_k, likewise, penetration that counts as none: forces are λ_k times
/// derivatives of G_k − a_k Σ w N_k; null for none
/// @param markers vectors of the bodies, nonzero at unknowns with Dirichlet conditions
/// @param scale displacement per unknown of each body
/// @return whether it is symmetric but for the scale: no rim with a pressure is an open end
bool insert_curvature(const Surface* master, const Pieces& pieces, Vec cover, Vec lambda,
                      Vec allowance, std::array<Vec, 2> markers, ContactBlocks blocks,
                      std::array<double, 2> scale);

/// Add Σ_p w_p p_p ∂²g_p of points of pieces, and what rims add, likewise. Collective.
/// @param pressure p_p, [point] @param at_rim p at the points of the rim, [point]
bool insert_curvature_of_points(const Surface* master, const Pieces& pieces,
                                std::span<const double> pressure, std::span<const double> at_rim,
                                std::array<Vec, 2> markers, ContactBlocks blocks,
                                std::array<double, 2> scale, MPI_Comm comm);

/// Add how the forces Σ_k τ_k·slip_k of friction, see add_slip_forces, change with tractions held,
/// to the blocks. Not symmetric. Collective.
/// @param traction τ_k at the unknowns of each node, a vector of the slave's body
void insert_slip_curvature(const Surface* master, const Pieces& pieces, Vec cover, Vec traction,
                           std::array<Vec, 2> markers, ContactBlocks blocks,
                           std::array<double, 2> scale);

/// The same of tractions at the points of pieces. Collective. @param traction τ_p, [point][3]
/// @param at_rim τ at the points of the rim, [point][3]
void insert_slip_curvature_of_points(const Surface* master, const Pieces& pieces,
                                     std::span<const double> traction,
                                     std::span<const double> at_rim, std::array<Vec, 2> markers,
                                     ContactBlocks blocks, std::array<double, 2> scale);

} // namespace qsdolfinx
