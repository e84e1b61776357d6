// Weights of contact between facets that are inclined towards each other. No MPI.
#pragma once

namespace qsdolfinx
{

/// With updated geometry, facets are in contact up to this angle (66°). A gap along the normal n of
/// one facet changes by 1/|m·n| times the motion of the other facet, which has the normal m: a
/// facet beside a tool's corner, which leans towards the wall, would be pushed by a multiple of the
/// motion.
inline constexpr double steep_cosine = 0.4;

/// Up to this angle (45°) facets have their full weight. Between both it falls to 0: a facet that
/// leans on a wall more and more would otherwise get the force of the wall all at once, and there
/// would be no equilibrium with this force or without it.
inline constexpr double inclined_cosine = 0.7071067811865476;

/// Part of the area of a facet that counts, and its derivative.
struct FacingWeight
{
  double value, slope;
};

/// @param cosine −m·n of two facets
inline FacingWeight facing_weight(double cosine)
{
  const double width = inclined_cosine - steep_cosine, s = (cosine - steep_cosine) / width;
  if (s <= 0)
    return {0, 0};
  if (s >= 1)
    return {1, 0};
  return {s * s * (3 - 2 * s), 6 * s * (1 - s) / width};
}

} // namespace qsdolfinx
