// Records of equal width in flat arrays: one for each facet, node or point.
#pragma once

#include <cstddef>
#include <vector>

namespace qsdolfinx
{

/// Append record i of an array of records.
template <typename T>
void append_record(std::vector<T>& out, const auto& in, std::size_t i, std::size_t width)
{
  const auto first = in.begin() + i * width;
  out.insert(out.end(), first, first + width);
}

} // namespace qsdolfinx
