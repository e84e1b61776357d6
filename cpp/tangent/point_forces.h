// Derivative of contact forces, and of the equations of multipliers, at the points of pieces.
#pragma once

#include "gap/point_rows.h"
#include "pairing/pieces.h"
#include "tangent/products.h"
#include "tangent/row_sums.h"

#include <petscvec.h>

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// State of the points of pieces. A point has one component, its pressure, and with friction also
/// those of its traction. Component c has the trial y_c = γ_c g_c + a_c λ_c with λ_c = Σ_k N_k
/// λ_ck, and R_λ has the terms w_p N_k r_c. Points without a partner follow those of the pieces.
struct PointState
{
  std::size_t components;          ///< 1, or 1 + gdim
  std::span<const double> gamma;   ///< γ_c, [component]
  std::span<const double> part;    ///< a_c, [component]
  std::span<const double> in_work; ///< factor of N_k in the terms of R_λ by D, [component]
  std::span<const double> D;       ///< derivative of w_p times stress/γ² by the trials,
                                   ///< [point][component][component]
  std::span<const double> own;     ///< derivative of w_p r_c by λ_c, [point][component]
  std::span<const double> pressure, traction; ///< held constant, times shares, [point], [point][3]
  std::span<const double> rest;               ///< r_c times shares, [point][component]
  std::span<const double> turning; ///< vectors of which r_c are components and which stay in the
                                   ///< planes of facets, times shares, [point][3]
  std::span<const double> leaning; ///< see SlipOfPieces, [point]
  std::span<const double>
      kept; ///< part of the trials of tractions that turns with facets, [point][3]
  /// Derivatives of this part by the slave's functions at the point, before it turns,
  /// [point][multiplier][3]; empty if there are none.
  std::span<const double> kept_slopes;
  std::vector<Vec> fields;  ///< λ_c at the smooth sides of nodes, for each component
  std::vector<Vec> begun;   ///< components at the smooth sides of nodes of a field in this part,
                            ///< before it turns; none if there is no such field
  std::vector<Vec> missing; ///< r_c of points without a partner at the smooth sides of nodes: as
                            ///< much area as the points of pieces cover, these lose
  bool moves;               ///< whether points move on the facets, and heights change
  bool gaps_move; ///< whether gaps and slips change with this motion, and slips with the facets
};

/// Unknowns of the nodal functions N_k of pieces.
struct FunctionUnknowns
{
  /// Number of the function's row in `rows`, [piece][multiplier], then one for each point without
  /// a partner.
  std::span<const std::int64_t> row;
  /// Factors of unknowns in the value of a function, for each component.
  std::vector<const CompressedRows*> rows;
  bool own; ///< whether each piece has one multiplier, with N = 1
};

/// Destination of derivatives by the nodes of pieces.
struct Destination
{
  RowSums& sums; ///< matrix for all unknowns of the equations
  /// Numbers of the slave's and the master's unknowns among all unknowns, [piece][node][gdim],
  /// negative where a Dirichlet condition holds; empty for a rigid tool.
  std::array<std::span<const std::int64_t>, 2> numbers;
  std::array<double, 2> scale; ///< displacement per unknown of each body
  std::int64_t tool;           ///< number of the displacement of a force-controlled tool, or −1
  std::array<double, 3> way;   ///< the tool's motion per displacement
};

/// Unknowns of one side, −1 where a Dirichlet condition holds, [piece][node][gdim]. Collective.
/// @param markers a vector of the body, nonzero at unknowns with Dirichlet conditions
std::vector<std::int64_t> free_unknowns(const PieceSide& side, Vec markers);

/// Add the derivative of the forces and of R_λ at the points of pieces: one matrix for each piece.
/// Not symmetric. Collective.
/// @param pieces pieces whose rays have been solved
/// @param slip slip at these points; null without friction
void add_point_forces(const Pieces& pieces, const SlipOfPieces* slip, const PointState& at,
                      const FunctionUnknowns& functions, const Destination& to);

} // namespace qsdolfinx
