// Sums of outer products of short rows. They are most of the cost of a tangent with many points.
#pragma once

#include <cstddef>
#include <span>
#include <type_traits>

namespace qsdolfinx
{

/// Add Σ_p f_p l_pᵀ r_p to a matrix, symmetric to the last bit where l is r.
/// @param left, right rows [p][n] and [p][m] @param factor f_p, [p], or empty if all are 1
/// @param out [n][stride], of which the first m columns are used @param stride m if it is 0
inline void add_outer_products(std::span<const double> left, std::span<const double> right,
                               std::span<const double> factor, std::size_t n, std::size_t m,
                               double* out, std::size_t stride = 0)
{
  constexpr std::size_t tile = 8; // columns whose sums stay in registers
  const std::size_t count = n > 0 ? left.size() / n : 0;
  const auto add = [&](std::size_t i, std::size_t first, auto width, auto product)
  {
    double sum[tile] = {};
    const double *l = left.data() + i, *r = right.data() + first;
    for (std::size_t p = 0; p < count; ++p, l += n, r += m)
      for (std::size_t j = 0; j < width; ++j)
        sum[j] += product(p, *l * r[j]);
    for (std::size_t j = 0; j < width; ++j)
      out[i * (stride > 0 ? stride : m) + first + j] += sum[j];
  };
  const auto add_all = [&](auto product)
  {
    for (std::size_t i = 0; i < n; ++i)
    {
      std::size_t first = 0;
      for (; first + tile <= m; first += tile)
        add(i, first, std::integral_constant<std::size_t, tile>(), product);
      for (; first + 4 <= m; first += 4)
        add(i, first, std::integral_constant<std::size_t, 4>(), product);
      if (first < m)
        add(i, first, m - first, product);
    }
  };
  if (factor.empty())
    add_all([](std::size_t, double value) { return value; });
  else
    add_all([factor](std::size_t p, double value) { return factor[p] * value; });
}

} // namespace qsdolfinx
