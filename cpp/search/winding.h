// Test whether places at a closed surface lie within the body that it encloses, by ray casting.
#pragma once

#include "surface/surface.h"

#include <cstdint>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Whether the places just outside of points of a closed surface are within the body, as where one
/// part of it has penetrated another, [point]. A place is within the body if a ray from it to
/// infinity leaves the body through more facets than it enters by. The majority of three rays
/// decides; their directions are chosen so that they are not parallel to facets. Collective.
/// @param surface the whole boundary of a body, except the axis of a ring
/// @param x, normal points of this rank's facets and outward normals there
/// @param facet which facets these are
std::vector<std::uint8_t> within_body(const Surface& surface, std::span<const Vec3> x,
                                      std::span<const Vec3> normal,
                                      std::span<const std::size_t> facet);

} // namespace qsdolfinx
