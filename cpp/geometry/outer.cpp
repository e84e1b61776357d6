#include "geometry/outer.h"
#include "geometry/processors.h"

#include <type_traits>

namespace
{
template <std::size_t value>
using Constant = std::integral_constant<std::size_t, value>;

/// Adds the products to parts of the matrix whose sums stay in registers.
template <bool has_factors>
struct Tiles
{
  const double *left, *right, *factor;
  std::size_t count, n, m;
  double* out;
  std::size_t stride;

  template <typename Rows, typename Columns>
  [[gnu::always_inline]] void add(std::size_t i, std::size_t j, Rows rows, Columns columns) const
  {
    double sum[rows * columns] = {};
    const double *l = left + i, *r = right + j;
    for (std::size_t p = 0; p < count; ++p, l += n, r += m)
      for (std::size_t a = 0; a < rows; ++a)
        for (std::size_t b = 0; b < columns; ++b)
          if constexpr (has_factors)
            sum[a * columns + b] += factor[p] * (l[a] * r[b]);
          else
            sum[a * columns + b] += l[a] * r[b];
    for (std::size_t a = 0; a < rows; ++a)
      for (std::size_t b = 0; b < columns; ++b)
        out[(i + a) * stride + j + b] += sum[a * columns + b];
  }

  template <typename Rows>
  [[gnu::always_inline]] void add_rows(std::size_t i, Rows rows) const
  {
    std::size_t j = 0;
    for (; j + 12 <= m; j += 12)
      add(i, j, rows, Constant<12>());
    for (; j + 4 <= m; j += 4)
      add(i, j, rows, Constant<4>());
    for (; j < m; ++j)
      add(i, j, rows, Constant<1>());
  }

  [[gnu::always_inline]] void add_all() const
  {
    std::size_t i = 0;
    for (; i + 2 <= n; i += 2)
      add_rows(i, Constant<2>());
    for (; i < n; ++i)
      add_rows(i, Constant<1>());
  }
};
} // namespace

QSDOLFINX_FOR_PROCESSORS
void qsdolfinx::add_outer_products(std::span<const double> left, std::span<const double> right,
                                   std::span<const double> factor, std::size_t n, std::size_t m,
                                   double* out, std::size_t stride)
{
  const std::size_t count = n > 0 ? left.size() / n : 0;
  if (factor.empty())
    Tiles<false>{left.data(), right.data(), nullptr, count, n, m, out, stride}.add_all();
  else
    Tiles<true>{left.data(), right.data(), factor.data(), count, n, m, out, stride}.add_all();
}
