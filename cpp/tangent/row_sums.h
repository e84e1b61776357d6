// Dense blocks that are summed row by row before they are inserted into a matrix.
#pragma once

#include <petscmat.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Adds many small dense blocks to a matrix, which is not assembled here. Blocks of neighbouring
/// pieces of facets share most of their entries; each entry is passed to PETSc only once. Zeros are
/// inserted as entries, too. Call insert() at the end.
class RowSums
{
public:
  explicit RowSums(Mat matrix) : matrix_(matrix) {}

  /// Add a block; negative numbers of rows and columns are left out. @param values [row][column]
  void add(std::span<const PetscInt> rows, std::span<const PetscInt> columns,
           std::span<const double> values);
  /// Add square blocks, contiguous in memory, [block][row][column]; numbers are [block][row].
  void add_squares(std::span<const std::int64_t> numbers, std::span<const double> values,
                   std::size_t size);
  /// Add entries in any order, in rows of any rank; negative numbers are left out.
  void add_entries(std::span<const std::int64_t> rows, std::span<const std::int64_t> columns,
                   std::span<const double> values);
  void insert();

private:
  /// A row of a block: the positions at which its columns and values begin.
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
