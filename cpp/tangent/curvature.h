// Geometric part of the tangent, which arises because gaps and slip are nonlinear functions of the
// unknowns.
#pragma once

#include "pairing/pieces.h"
#include "tangent/row_sums.h"

#include <petscvec.h>

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Destination of derivatives by the nodes of pieces.
struct Destination
{
  RowSums& sums; ///< matrix for all unknowns of the equations
  /// Numbers of the slave's and the master's unknowns among all unknowns, [piece][node][gdim],
  /// negative where a Dirichlet condition holds; empty for a rigid tool.
  std::array<std::span<const std::int64_t>, 2> numbers;
  std::array<double, 2> scale; ///< displacement per unknown of each body
};

/// Unknowns of one side, −1 where a Dirichlet condition holds, [piece][node][gdim]. Collective.
/// @param markers a vector of the body, nonzero at unknowns with Dirichlet conditions
std::vector<std::int64_t> free_unknowns(const PieceSide& side, Vec markers);

/// Add Σ_p w_p p_p ∂²g_p of points of pieces, ξ and w fixed, and the contributions of the motion of
/// the points on the facets and of heights. Not symmetric.
/// @param pieces pieces whose rays have been solved
/// @param pressure p_p, [point], held constant
/// @param moves whether points move, and heights change
void add_curvature(const Pieces& pieces, std::span<const double> pressure, bool moves,
                   const Destination& to);

/// Add the derivative of the friction forces for constant tractions at the points, with the same
/// contributions as add_curvature.
/// @param traction τ_p, [point][3]
void add_slip_curvature(const Pieces& pieces, std::span<const double> traction, bool moves,
                        const Destination& to);

} // namespace qsdolfinx
