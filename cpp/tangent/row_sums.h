// Dense blocks that are summed row by row before they are inserted into a matrix.
#pragma once

#include "parallel/key_numbers.h"

#include <petscmat.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Adds many small dense blocks to a matrix. Blocks of neighbouring pieces of facets share most of
/// their entries; each entry is passed to PETSc only once. Zeros are entries, too. Call insert() at
/// the end.
class RowSums
{
public:
  explicit RowSums(Mat matrix) : matrix_(matrix) {}

  /// Add a block; negative numbers of rows and columns are left out. Rows may be those of other
  /// ranks. @param values [row][column]
  void add(std::span<const PetscInt> rows, std::span<const PetscInt> columns,
           std::span<const double> values);
  /// Add square blocks, contiguous in memory, [block][row][column]; numbers are [block][row].
  void add_squares(std::span<const std::int64_t> numbers, std::span<const double> values,
                   std::size_t size);
  /// Add entries in any order; negative numbers are left out.
  void add_entries(std::span<const std::int64_t> rows, std::span<const std::int64_t> columns,
                   std::span<const double> values);
  /// Insert the sums, and assemble the matrix: they are its pattern unless it has been assembled
  /// before. Collective.
  void insert();

private:
  /// A row of a block: the positions at which its columns and values begin.
  struct Part
  {
    std::int32_t row; ///< number of its number in `known_`
    std::size_t columns, values, size;
  };

  std::int32_t number_of(PetscInt key);
  void sum();
  void send_to_owners();
  void set_pattern();

  Mat matrix_;
  KeyNumbers numbering_;
  std::vector<PetscInt> known_; ///< rows and columns in the order of their first appearance
  std::vector<Part> parts_;
  std::vector<std::int32_t> columns_; ///< of each block, or of several summed rows: numbers in
                                      ///< `known_`, or −1
  std::vector<double> values_;
  std::size_t num_summed_ = 0; ///< values after the last sum
};

} // namespace qsdolfinx
