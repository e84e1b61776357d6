// Products of a body's block matrix and vectors, with vector instructions.
#pragma once

#include <petscmat.h>

namespace qsdolfinx
{

/// Products with a matrix of PETSc's type SEQBAIJ or MPIBAIJ and blocks of size 2 or 3, read where
/// PETSc stores it. PETSc's own products are compiled for any processor: with this format they take
/// four times as long, with the symmetric one, which has half the entries, twice as long
/// (bench/products.py). The matrix must outlive the object.
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
  void add(Mat part, const double* x, double* y, bool first) const;

  PetscInt block_ = 1;
  Mat own_, others_ = nullptr; ///< columns of this rank's unknowns, and of other ranks'
  Vec ghosts_ = nullptr;       ///< null on a single rank
  VecScatter scatter_ = nullptr;
};

} // namespace qsdolfinx
