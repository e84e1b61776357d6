// Rows of the gap operator that are the pairing points themselves. No MPI.
#pragma once

#include "gap/gap.h"

namespace qsdolfinx
{

/// Rows of one side, one for each point: its trace functions, times the normal for the normal part
/// of the jump. The master's are negative. @param side 0: slave, 1: master
void rows_at_points(GapOperator::Side& out, const PairingPoints& points, int side, GapKind kind);

/// Functions N_k of the slave's vertices at each point, of a field with one value for each smooth
/// side of a node: its column is the component of the vertex' unknowns with the side's number.
void multipliers_at_points(GapOperator::Side& out, const PairingPoints& points);

} // namespace qsdolfinx
