// Rows of the gap operator that are the pairing points themselves. No MPI.
#pragma once

#include "gap/gap.h"
#include "pairing/pieces.h"

#include <functional>

namespace qsdolfinx
{

/// Rows of one side, one for each point: the trace functions of the side, times the normal for the
/// normal part of the jump. The master's entries are negative. @param side 0: slave, 1: master
void rows_at_points(GapOperator::Side& out, const PairingPoints& points, int side, GapKind kind);

/// Functions N_k of the slave's vertices at each point, for a field with one value for each smooth
/// side of a node. The column is the component of the vertex' unknowns that has the side's number.
void multipliers_at_points(GapOperator::Side& out, const PairingPoints& points);

/// Points of pieces as pairing points without normals. The rays must have been solved.
PairingPoints points_of_pieces(const Surface& slave, const Surface* master, const Pieces& pieces);

/// Values at the points of a piece for the nodes of both facets, [point][node][width], the slave's
/// nodes first. They are valid until the next piece is requested.
using OfPiece = std::function<std::span<const double>(std::size_t piece)>;

/// Gradients of the gaps, width 3; at vertices in the direction of the curved surface's normals.
OfPiece gap_gradients_of(const Pieces& pieces);

/// Trace functions, negative for the master, width 1.
OfPiece jumps_of(const Pieces& pieces);

/// Rows of both sides, or of the slave only: one for each point of pieces, then some empty rows.
/// @param num_alone number of empty rows
/// @param width 1: one value for all unknowns of a node, 3: one value for each unknown, 9: one for
/// each component of a vector and unknown, [component][unknown]
void rows_of_pieces(std::span<GapOperator::Side> out, const Pieces& pieces, std::size_t num_alone,
                    std::size_t width, const OfPiece& values);

/// Functions N_k at the points of pieces, as in multipliers_at_points, then rows with one unknown
/// each, or with none.
/// @param alone unknowns of the latter rows, -1 for none
void multipliers_of_pieces(GapOperator::Side& out, const Pieces& pieces,
                           std::span<const std::int64_t> alone);

/// Slip at the points of pieces, with the shapes of RaySlip; `turn` is the rotation of
/// turn_since(), [piece][3][3].
struct SlipOfPieces
{
  std::vector<double> slip, normal, slides, chord, works, slope, arc, gap, turn;

  /// Collective. @param slave, master positions of the bodies' nodes when slip began, as vectors of
  /// the bodies; master is null for a rigid tool
  /// @param of_tool affine map from present positions on the rigid tool to those when slip began,
  /// rows, [3][4]
  SlipOfPieces(const Pieces& pieces, Vec slave, Vec master, std::span<const double> of_tool);
};

/// Gradients of the slip, or the variation that tractions work on, width 9.
OfPiece slips_of(const Pieces& pieces, const SlipOfPieces& slip, bool works);

} // namespace qsdolfinx
