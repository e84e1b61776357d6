// Rows of the gap operator that are the pairing points themselves. No MPI.
#pragma once

#include "gap/gap.h"

namespace qsdolfinx
{

/// Rows of one side, one for each point: its trace functions, times the normal for the normal part
/// of the jump. The master's are negative. @param side 0: slave, 1: master
void rows_at_points(GapOperator::Side& out, const PairingPoints& points, int side, GapKind kind);

/// Functions N_k of the slave's vertices at each point, of a field with one value a node: a column
/// is a vertex, by the first of its unknowns.
void multipliers_at_points(GapOperator::Side& out, const PairingPoints& points);

} // namespace qsdolfinx
