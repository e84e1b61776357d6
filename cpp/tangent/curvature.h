// The part of the tangent that comes from gaps and slip being no linear functions of the unknowns.
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

/// Where derivatives by the nodes of pieces go.
struct Destination
{
  RowSums& sums; ///< by all unknowns of the equations
  /// Of the slave's unknowns and of the master's among all, [piece][node][gdim], negative where
  /// they are held; none of a rigid tool.
  std::array<std::span<const std::int64_t>, 2> numbers;
  std::array<double, 2> scale; ///< displacement per unknown of each body
};

/// Unknowns of one side, −1 where a Dirichlet condition holds, [piece][node][gdim]. Collective.
/// @param markers a vector of the body, nonzero there
std::vector<std::int64_t> free_unknowns(const PieceSide& side, Vec markers);

/// Add Σ_p w_p p_p ∂²g_p of points of pieces, ξ and w fixed, and what their motion on the facets
/// and heights add. Not symmetric.
/// @param pieces where rays have been solved for
/// @param pressure p_p, [point], which stays
/// @param moves whether points move, and heights change
void add_curvature(const Pieces& pieces, std::span<const double> pressure, bool moves,
                   const Destination& to);

/// Add how the forces of friction change with tractions at the points held, likewise.
/// @param traction τ_p, [point][3]
void add_slip_curvature(const Pieces& pieces, std::span<const double> traction, bool moves,
                        const Destination& to);

} // namespace qsdolfinx
