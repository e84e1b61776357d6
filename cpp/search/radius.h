// How far from each other points may be that are paired.
#pragma once

#include <algorithm>

namespace qsdolfinx
{

/// One distance everywhere; or the size of the larger of the facets that two points belong to, so
/// that what is coarse reaches further than what is fine, and at most that distance.
struct SearchRadius
{
  double largest;
  bool by_size;

  explicit SearchRadius(double largest_radius, bool by_facet_size = false)
      : largest(largest_radius), by_size(by_facet_size)
  {
  }

  /// @param here, there sizes of the facets
  double of(double here, double there) const
  {
    return by_size ? std::min(std::max(here, there), largest) : largest;
  }
};

} // namespace qsdolfinx
