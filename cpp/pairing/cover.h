// Multipliers of nodes that pairing points hardly cover.
#pragma once

#include "pairing/pairing.h"

namespace qsdolfinx
{

/// Let the neighbours carry the multipliers of nodes that are hardly covered, as beyond the rim of
/// the master: their rows would nearly be those of the neighbours, and multipliers could not be
/// told apart. Collective.
///
/// Where Σ_p w_p N_k(ξ_p) is less than `least` S_k, N_k is shared out among the other vertices of
/// each facet, or given to that which is covered most if none of them is covered well. Multiplier
/// functions still sum up to 1.
/// @return number of such nodes (in corners: of their sides) of this rank
std::int64_t share_out_hardly_covered(PairingPoints& points, const Surface& slave, double least);

} // namespace qsdolfinx
