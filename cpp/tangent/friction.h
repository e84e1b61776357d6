// Friction blocks of the tangent.
#pragma once

#include "tangent/insertion.h"

namespace qsdolfinx
{

/// Add Jᵀ (D J + c G) to the four blocks, J being the weighted jump and G its normal part. Not
/// symmetric unless c = 0. Stays within the pattern of insert_contact for G. Rows and columns of
/// constrained unknowns are left out. The blocks are not assembled here.
///
/// @param jump J, made of the same pairing points as `normal`; its constrained unknowns are used
/// @param normal G
/// @param stiffness D times the area of each row, [row][gdim][gdim]
/// @param coupling c times the area, [row][gdim]; rows in which both are zero are skipped
/// @param blocks ss, sm, ms, mm
/// @param scale displacement per unknown of the slave's and the master's body: multiplies columns
void insert_friction(const GapOperator& jump, const GapOperator& normal,
                     std::span<const double> stiffness, std::span<const double> coupling,
                     ContactBlocks blocks, std::array<double, 2> scale);

} // namespace qsdolfinx
