// Search distance: largest distance of points that are paired.
#pragma once

#include <algorithm>

namespace qsdolfinx
{

/// Search distance: either one value everywhere, or the size of the larger of the two facets, at
/// most this value. In the second case the search distance is larger for coarse facets than for
/// fine ones.
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
