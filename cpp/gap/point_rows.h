// Rows of the gap operator that are the pairing points themselves. No MPI.
#pragma once

#include "gap/gap.h"
#include "pairing/pieces.h"

#include <functional>

namespace qsdolfinx
{

/// Rows of one side, one for each point: its trace functions, times the normal for the normal part
/// of the jump. The master's are negative. @param side 0: slave, 1: master
void rows_at_points(GapOperator::Side& out, const PairingPoints& points, int side, GapKind kind);

/// Functions N_k of the slave's vertices at each point, of a field with one value for each smooth
/// side of a node: its column is the component of the vertex' unknowns with the side's number.
void multipliers_at_points(GapOperator::Side& out, const PairingPoints& points);

/// Points of pieces, where rays have been solved for, as pairing points without normals.
PairingPoints points_of_pieces(const Surface& slave, const Surface* master, const Pieces& pieces);

/// Values at the points of a piece for the nodes of both facets, [point][node][width], the slave's
/// nodes first; until the next piece is asked for.
using OfPiece = std::function<std::span<const double>(std::size_t piece)>;

/// Gradients of the gaps, width 3.
OfPiece gap_gradients_of(const Pieces& pieces);

/// Trace functions, negative for the master, width 1.
OfPiece jumps_of(const Pieces& pieces);

/// Gradients of the gaps with what points move by, width 3.
OfPiece moving_gap_gradients_of(const Pieces& pieces);

/// Parts of values that are known, [point][node][width].
OfPiece parts_of(const Pieces& pieces, std::span<const double> values);

/// Rows of both sides, or the slave alone, one for each point of pieces and some empty ones.
/// @param num_alone of these @param width 1: of all unknowns of a node alike, 3: by unknown,
/// 9: the same of a vector, [component][unknown]
void rows_of_pieces(std::span<GapOperator::Side> out, const Pieces& pieces, std::size_t num_alone,
                    std::size_t width, const OfPiece& values);

/// Functions N_k at the points of pieces, as multipliers_at_points, and rows with one unknown each.
void multipliers_of_pieces(GapOperator::Side& out, const Pieces& pieces,
                           std::span<const std::int64_t> alone);

/// How functions of the slave's vertices move along its facets at the points of pieces.
struct FunctionsOfPieces
{
  /// Gradients of Σ_k λ_k N_k with what points move by, [point][node][3], the slave's nodes first.
  std::vector<double> gradient;
  /// Derivative of Σ_p w_p N_k r_p by the motion of N_k and of points: unknown that stands for the
  /// side of a node, unknown of a body, and value.
  std::array<std::vector<std::int64_t>, 2> row, column; ///< [side of contact][entry]
  std::array<std::vector<double>, 2> value;

  /// Collective. @param field λ, a vector of the slave's body
  /// @param rest r_p, [point], which stays @param moves whether points move
  /// @param turning vectors of which r_p is a component and that stay in the planes of the facets
  /// that rays leave, [point][3]; empty if there are none
  /// @param markers vectors of the bodies, nonzero at unknowns with conditions, whose columns are
  /// −1; of a rigid tool null
  FunctionsOfPieces(const Pieces& pieces, Vec field, std::span<const double> rest, bool moves,
                    std::array<Vec, 2> markers, std::span<const double> turning = {},
                    std::size_t component = 0);
};

/// Slip at the points of pieces, see RaySlip, [point][3] and [point][node][3][3], the slave's nodes
/// first; [point].
struct SlipOfPieces
{
  std::vector<double> slip, normal, gradient, works, slope, arc, gap;

  /// Collective. @param slave, master places of the bodies' nodes when slip began, vectors of them;
  /// master null for a rigid tool @param of_tool where a place of it was then, rows of an affine
  /// map, [3][4]
  SlipOfPieces(const Pieces& pieces, Vec slave, Vec master, std::span<const double> of_tool);

  /// ``gradient`` with what points move by, and of tangential parts of vectors that stay: −l_p δn.
  /// @param leaning l_p, along the slave's normal, [point]
  std::vector<double> moving_gradient(const Pieces& pieces, std::span<const double> leaning) const;
};

} // namespace qsdolfinx
