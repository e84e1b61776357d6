// Contact blocks of the tangent.
#pragma once

#include "gap/gap.h"

namespace qsdolfinx
{

/// Blocks (slave, slave), (slave, master), (master, slave), (master, master); only the first if the
/// master is rigid.
using ContactBlocks = std::array<Mat, 4>;

/// Add Gᵀ D G to the four blocks, D diagonal and non-negative, so that the sum stays symmetric
/// where both bodies have the same scale. Rows and columns of constrained unknowns are left out.
/// The blocks are not assembled here.
///
/// @param stiffness D, one value per row of the operator, or for jumps one for each component; rows
///        with 0 are skipped
/// @param scale displacement per unknown of the slave's and the master's body: multiplies columns
/// @param pattern insert explicit zeros in the whole pattern instead, constrained unknowns
/// included; this fixes the non-zero pattern for all rows that become active later
void insert_contact(const GapOperator& gap, std::span<const double> stiffness, ContactBlocks blocks,
                    std::array<double, 2> scale, bool pattern);

} // namespace qsdolfinx
