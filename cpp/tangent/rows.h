// Insertion of rows of one body's matrix into the matrix of all bodies.
#pragma once

#include <petscmat.h>

#include <cstdint>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Numbers of a body's unknowns in a larger system: shifts[r] is added to the numbers of the
/// unknowns of rank r, which begin at ranges[r].
struct Numbering
{
  std::span<const std::int64_t> ranges; ///< one entry more than the number of ranks
  std::span<const std::int64_t> shifts;
};

enum class RowMode
{
  zero,   ///< replace the entries by zeros
  insert, ///< replace entries
  add
};

/// Insert rows of a block into a larger matrix; neither is assembled here.
///
/// @param block rows of one body, columns of one body; assembled
/// @param matrix takes the rows, which this rank owns
/// @param rows local numbers of rows of the block
/// @param row_numbers numbering of the body of the rows
/// @param column_numbers numbering of the body of the columns
void put_rows(Mat block, Mat matrix, std::span<const std::int32_t> rows,
              const Numbering& row_numbers, const Numbering& column_numbers, RowMode mode);

/// Numbers of entries in each of this rank's rows of a block: for all rows the number in columns
/// that this rank owns, then for all rows the number in other columns.
std::vector<std::int32_t> count_entries(Mat block);

/// Fix the non-zero pattern of a matrix whose sizes and type are set. The places of entries may be
/// in rows of any rank; values at repeated places are added. Collective.
void set_places(Mat matrix, std::span<const std::int64_t> rows,
                std::span<const std::int64_t> columns);

/// Replace the entries of a matrix, in the order of the places, and assemble it. Collective.
void set_values(Mat matrix, std::span<const double> values);

} // namespace qsdolfinx
