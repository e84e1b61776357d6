// Which points of a closed surface lie within the body that it encloses.
#pragma once

#include "surface/surface.h"

#include <cstdint>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Whether the places just outside of points of a closed surface are within the body, as where one
/// part of it has gone into another: those are from which more facets are left than entered, on the
/// way to infinity. Most of three ways decide, none of which is parallel to anything. [point].
/// Collective.
/// @param surface all of the boundary of a body, but for the axis of a ring
/// @param x, normal points of this rank's facets and outward normals there
/// @param facet which facets these are
std::vector<std::uint8_t> within_body(const Surface& surface, std::span<const Vec3> x,
                                      std::span<const Vec3> normal,
                                      std::span<const std::size_t> facet);

} // namespace qsdolfinx
