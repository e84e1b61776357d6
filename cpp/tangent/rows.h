// Rows of one body's matrix in the matrix of all bodies.
#pragma once

#include <petscmat.h>

#include <cstdint>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Where a body's unknowns are in a larger system: those of rank r, from ranges[r] on, have
/// shifts[r] added to their number.
struct Numbering
{
  std::span<const std::int64_t> ranges; ///< one more than there are ranks
  std::span<const std::int64_t> shifts;
};

enum class RowMode
{
  zero,   ///< replace the entries by zeros
  insert, ///< replace entries
  add
};

/// Put rows of a block into a larger matrix; neither is assembled here.
///
/// @param block rows of one body, columns of one body; assembled
/// @param matrix takes the rows, which this rank owns
/// @param rows local numbers of rows of the block
/// @param row_numbers of the body of the rows
/// @param column_numbers of the body of the columns
void put_rows(Mat block, Mat matrix, std::span<const std::int32_t> rows,
              const Numbering& row_numbers, const Numbering& column_numbers, RowMode mode);

/// Number of entries in each of this rank's rows of a block: in columns that this rank owns for all
/// rows, then in others for all rows.
std::vector<std::int32_t> count_entries(Mat block);

/// Fix the pattern of a matrix with sizes and type: places of entries, on any rank's rows; those
/// that are there several times are added up. Collective.
void set_places(Mat matrix, std::span<const std::int64_t> rows,
                std::span<const std::int64_t> columns);

/// Replace the entries of a matrix, in the order of the places, and assemble it. Collective.
void set_values(Mat matrix, std::span<const double> values);

} // namespace qsdolfinx
