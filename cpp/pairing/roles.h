// Roles of facets in self-contact: which facet is the slave of which, and which facets are the two
// sides of one wall.
#pragma once

#include "surface/surface.h"

#include <span>

namespace qsdolfinx
{

/// Distance, relative to the size of a facet, below which two facets of one surface are in contact,
/// whichever of them is behind the other. No wall is that thin.
inline constexpr double flush_tolerance = 1e-5;

/// Roles of two facets in self-contact: 1 if the first is the slave, −1 if the second is, 0 if this
/// is undetermined. Facets that faced each other when the contact was made are distinguished by
/// their normals, others by their positions along one direction. In both cases neighbouring facets
/// have the same role.
int is_slave_of(std::span<const double> key, std::span<const double> other);

/// Whether two facets in self-contact are the two sides of one wall, where the other facet is
/// behind the first one by `depth`. They are if the other facet was behind the first one when the
/// contact was made, the places just outside of both were free, and it has not come much nearer
/// since.
/// @param size of the facet
bool is_own_wall(std::span<const double> key, std::span<const double> other, double depth,
                 double size);

} // namespace qsdolfinx
