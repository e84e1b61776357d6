// Sums of outer products of short rows. They are most of the cost of a tangent with many points.
#pragma once

#include <cstddef>
#include <span>

namespace qsdolfinx
{

/// Add Σ_p f_p l_pᵀ r_p to a matrix, symmetric to the last bit where l is r.
/// @param left, right rows [p][n] and [p][m] @param factor f_p, [p], or empty if all are 1
/// @param out [n][stride], of which the first m columns are used
void add_outer_products(std::span<const double> left, std::span<const double> right,
                        std::span<const double> factor, std::size_t n, std::size_t m, double* out,
                        std::size_t stride);

} // namespace qsdolfinx
