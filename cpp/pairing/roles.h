// Which facet of a surface that touches itself is the slave of which, and which are one wall.
#pragma once

#include "surface/surface.h"

#include <span>

namespace qsdolfinx
{

/// Distance, over the size of a facet, at which two facets of one surface touch, whichever of them
/// is behind: no wall is as thin.
inline constexpr double flush_tolerance = 1e-5;

/// Roles of two facets of a surface that touches itself: whether the first one is the slave. Facets
/// that looked at each other when contact was made differ by their normals, others by their places
/// along one direction: either way neighbours have the same role. 0 if there is no telling.
int is_slave_of(std::span<const double> key, std::span<const double> other);

/// Whether of two facets of a surface that touches itself one is the other side of the other's
/// wall, being behind it by a depth: it was when contact was made, both looking at what was free,
/// and has not come much nearer. @param size of the facet
bool is_own_wall(std::span<const double> key, std::span<const double> other, double depth,
                 double size);

} // namespace qsdolfinx
