// Condensation of the multipliers of nodes whose support is hardly covered by pairing points.
#pragma once

#include "pairing/pairing.h"

namespace qsdolfinx
{

/// Condense the multipliers of hardly covered nodes onto their neighbours, for instance at the
/// boundary of the master surface. Their rows would be nearly the same as those of the neighbours,
/// and the multipliers nearly undetermined. Collective.
///
/// Where Σ_p w_p N_k(ξ_p) is less than `least` S_k, N_k is distributed among the well covered
/// vertices of each facet, or added to the vertex that is covered most if no vertex is covered
/// well. Multiplier functions still sum up to 1.
/// @return number of hardly covered nodes of this rank (in corners: of their sides)
std::int64_t share_out_hardly_covered(PairingPoints& points, const Surface& slave, double least);

} // namespace qsdolfinx
