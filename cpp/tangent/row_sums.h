// Dense blocks that are added up row by row before a matrix gets them.
#pragma once

#include <petscmat.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Adds many small dense blocks to a matrix, which is not assembled here: blocks of neighbours, as
/// pieces of facets have, share most of their entries, and PETSc gets each of these once. Zeros are
/// entries, too. Call insert() at the end.
class RowSums
{
public:
  explicit RowSums(Mat matrix) : matrix_(matrix) {}

  /// Negative numbers of rows and columns are left out. @param values [row][column]
  void add(std::span<const PetscInt> rows, std::span<const PetscInt> columns,
           std::span<const double> values);
  /// Blocks that follow each other in memory, [block][row][column]; numbers are [block][row].
  void add_squares(std::span<const std::int64_t> numbers, std::span<const double> values,
                   std::size_t size);
  /// Entries in any order, of any rank's rows; negative numbers are left out.
  void add_entries(std::span<const std::int64_t> rows, std::span<const std::int64_t> columns,
                   std::span<const double> values);
  void insert();

private:
  /// A row of a block: where its columns and values begin.
  struct Part
  {
    PetscInt row;
    std::size_t columns, values, size;
  };

  Mat matrix_;
  std::vector<Part> parts_;
  std::vector<PetscInt> columns_; ///< of each block
  std::vector<double> values_;
};

} // namespace qsdolfinx
