// Dense blocks that are summed row by row before they are inserted into a matrix.
#pragma once

#include "parallel/key_numbers.h"

#include <petscmat.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
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

  /// Numbers of parts, columns and values.
  struct Position
  {
    std::size_t parts = 0, columns = 0, values = 0;
  };

  std::int32_t number_of(PetscInt key);
  std::pair<std::vector<std::size_t>, std::vector<std::size_t>> by_rows(std::size_t first);
  void sum(const Position& from);
  void find_columns(std::span<const std::size_t> parts, std::vector<std::int32_t>& found);
  void sum_all();
  void send_to_owners();
  void set_pattern();

  Mat matrix_;
  KeyNumbers numbering_;
  std::vector<PetscInt> known_; ///< rows and columns in the order of their first appearance
  std::vector<Part> parts_;
  std::vector<std::int32_t> columns_; ///< of each block, or of several summed rows: numbers in
                                      ///< `known_`, or −1
  std::vector<double> values_;
  Position summed_;          ///< where the parts begin that have not been summed
  std::size_t num_sums_ = 0; ///< values after the last sum of all parts
  // For each known number, of use in sums: 0 between them.
  std::vector<std::size_t> count_;
  std::vector<double> sums_{0.0}; ///< that of −1 first
  std::vector<char> is_found_;
};

} // namespace qsdolfinx
