// Products of a body's block matrix and vectors, with vector instructions.
#pragma once

#include <petscmat.h>

#include <span>
#include <vector>

namespace qsdolfinx
{

/// Products with a matrix of PETSc's type BAIJ or SBAIJ and blocks of size 2 or 3, read where PETSc
/// stores it. PETSc's own products are compiled for any processor, and take two to four times as
/// long (bench/products.py). The matrix must outlive the object; if it is symmetric and on several
/// ranks, its entries must not change.
class BlockProduct
{
public:
  /// Collective, as is apply().
  explicit BlockProduct(Mat matrix);
  ~BlockProduct();
  BlockProduct(const BlockProduct&) = delete;
  BlockProduct& operator=(const BlockProduct&) = delete;

  /// Whether a matrix has such a type and blocks.
  static bool is_for(Mat matrix);
  /// y = K x.
  void apply(Vec x, Vec y);

private:
  /// Blocks of rows of this rank with columns of other ranks, which all come later: column numbers
  /// are those of ghosts; blocks are stored column by column.
  struct Right
  {
    std::vector<PetscInt> begin, column;
    std::vector<double> values;
  };

  void scatter(Mat matrix, std::span<const PetscInt> ghosts);
  void copy_right(Mat matrix);
  void add_right(const double* x, double* y, double* ghosts) const;
  void add(Mat part, const double* x, double* y, bool first) const;

  PetscInt block_ = 1;
  Mat own_, others_ = nullptr; ///< columns of this rank's unknowns, and of other ranks'
  Right right_;                ///< in place of others_, if the matrix is symmetric
  Vec ghosts_ = nullptr;       ///< null on a single rank
  VecScatter scatter_ = nullptr;
};

} // namespace qsdolfinx
