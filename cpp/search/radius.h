// How far from each other points may be that are paired.
#pragma once

#include <algorithm>
#include <utility>

namespace qsdolfinx
{

/// One distance everywhere, or the size of the larger of the facets that two points belong to: what
/// is coarse reaches further than what is fine.
struct SearchRadius
{
  double largest;               ///< anywhere
  double least;                 ///< whatever the facets
  double most_here, most_there; ///< that the size of a facet of either surface counts for

  explicit SearchRadius(double everywhere)
      : largest(everywhere), least(everywhere), most_here(0), most_there(0)
  {
  }
  SearchRadius(double largest_of_all, double here, double there)
      : largest(largest_of_all), least(0), most_here(here), most_there(there)
  {
  }

  /// @param here, there sizes of the facets
  double of(double here, double there) const
  {
    return std::max({least, std::min(here, most_here), std::min(there, most_there)});
  }
  /// With the surfaces' roles exchanged.
  SearchRadius turned() const
  {
    SearchRadius out = *this;
    std::swap(out.most_here, out.most_there);
    return out;
  }
};

} // namespace qsdolfinx
