#include "linear/block_product.h"
#include "geometry/processors.h"
#include "parallel/petsc.h"

#include <cstring>

using namespace qsdolfinx;

namespace
{
/// Block rows of a matrix, as PETSc stores them: column numbers of blocks, and the entries of each
/// block column by column.
struct Rows
{
  PetscInt count;
  const PetscInt *begin, *column;
};

/// Four numbers, for one vector instruction.
using Four = double __attribute__((vector_size(4 * sizeof(double))));

/// Read four numbers.
inline void read(Four& v, const double* p) { std::memcpy(&v, p, sizeof v); }

/// Products with rows of blocks of three. The fourth number of each column belongs to the next
/// column and is not used; no number is read behind the last entry but one of it, `end`.
inline void rows_of_three(const Rows& rows, const double* v, const double* end, const double* x,
                          double* y, bool first)
{
  for (PetscInt i = 0; i < rows.count; ++i)
  {
    Four a = {}, b = {}, c = {}, p0, p1, p2;
    for (PetscInt k = rows.begin[i]; k < rows.begin[i + 1]; ++k)
    {
      const double* p = v + 9 * k;
      const double* u = x + 3 * rows.column[k];
      read(p0, p);
      read(p1, p + 3);
      if (p + 10 <= end)
        read(p2, p + 6);
      else // the last block of PETSc's entries
        p2 = Four{double(p[6]), double(p[7]), double(p[8]), 0.0};
      a += p0 * u[0];
      b += p1 * u[1];
      c += p2 * u[2];
    }
    a += b + c;
    for (int r = 0; r < 3; ++r)
      y[3 * i + r] = (first ? 0.0 : y[3 * i + r]) + a[r];
  }
}

/// The same for blocks of two.
inline void rows_of_two(const Rows& rows, const double* v, const double* x, double* y, bool first)
{
  for (PetscInt i = 0; i < rows.count; ++i)
  {
    Four a = {}, p;
    for (PetscInt k = rows.begin[i]; k < rows.begin[i + 1]; ++k)
    {
      const double* u = x + 2 * rows.column[k];
      read(p, v + 4 * k);
      a += p * Four{u[0], u[0], u[1], u[1]};
    }
    for (int r = 0; r < 2; ++r)
      y[2 * i + r] = (first ? 0.0 : y[2 * i + r]) + a[r] + a[r + 2];
  }
}

QSDOLFINX_FOR_PROCESSORS
void multiply(PetscInt block, const Rows& rows, const double* v, const double* end, const double* x,
              double* y, bool first)
{
  if (block == 3)
    rows_of_three(rows, v, end, x, y, first);
  else
    rows_of_two(rows, v, x, y, first);
}

/// Block rows of a sequential matrix, while this object exists.
class Graph
{
public:
  explicit Graph(Mat matrix) : matrix_(matrix)
  {
    check(MatGetRowIJ(matrix_, 0, PETSC_FALSE, PETSC_TRUE, &rows_.count, &rows_.begin,
                      &rows_.column, &done_));
  }
  ~Graph()
  {
    (void)MatRestoreRowIJ(matrix_, 0, PETSC_FALSE, PETSC_TRUE, &rows_.count, &rows_.begin,
                          &rows_.column, &done_);
  }
  Graph(const Graph&) = delete;
  Graph& operator=(const Graph&) = delete;
  const Rows& rows() const { return rows_; }

private:
  Mat matrix_;
  Rows rows_ = {0, nullptr, nullptr};
  PetscBool done_ = PETSC_FALSE;
};

bool is_type(Mat matrix, const char* type)
{
  PetscBool is = PETSC_FALSE;
  check(PetscObjectTypeCompare(reinterpret_cast<PetscObject>(matrix), type, &is));
  return is;
}
} // namespace

bool BlockProduct::is_for(Mat matrix)
{
  PetscInt block = 1;
  check(MatGetBlockSize(matrix, &block));
  return (block == 2 || block == 3) && (is_type(matrix, MATSEQBAIJ) || is_type(matrix, MATMPIBAIJ));
}

BlockProduct::BlockProduct(Mat matrix) : own_(matrix)
{
  check(MatGetBlockSize(matrix, &block_));
  if (is_type(matrix, MATMPIBAIJ))
  {
    const PetscInt* ghosts = nullptr;
    check(MatMPIBAIJGetSeqBAIJ(matrix, &own_, &others_, &ghosts));
    PetscInt count = 0;
    check(MatGetLocalSize(others_, nullptr, &count));
    check(VecCreateSeq(PETSC_COMM_SELF, count, &ghosts_));
    IS from = nullptr;
    Vec x = nullptr;
    check(ISCreateBlock(PETSC_COMM_SELF, block_, count / block_, ghosts, PETSC_COPY_VALUES, &from));
    check(MatCreateVecs(matrix, &x, nullptr));
    check(VecScatterCreate(x, from, ghosts_, nullptr, &scatter_));
    check(VecDestroy(&x));
    check(ISDestroy(&from));
  }
}

BlockProduct::~BlockProduct()
{
  if (!petsc_is_running())
    return;
  (void)VecScatterDestroy(&scatter_);
  (void)VecDestroy(&ghosts_);
}

void BlockProduct::add(Mat part, const double* x, double* y, bool first) const
{
  const Graph graph(part);
  const Rows& rows = graph.rows();
  double* v = nullptr;
  check(MatSeqBAIJGetArray(part, &v));
  multiply(block_, rows, v, v + rows.begin[rows.count] * block_ * block_, x, y, first);
  check(MatSeqBAIJRestoreArray(part, &v));
}

void BlockProduct::apply(Vec x, Vec y)
{
  const double* from = nullptr;
  double* to = nullptr;
  if (scatter_)
    check(VecScatterBegin(scatter_, x, ghosts_, INSERT_VALUES, SCATTER_FORWARD));
  check(VecGetArrayRead(x, &from));
  check(VecGetArray(y, &to));
  add(own_, from, to, true);
  check(VecRestoreArrayRead(x, &from));
  if (scatter_)
  {
    check(VecScatterEnd(scatter_, x, ghosts_, INSERT_VALUES, SCATTER_FORWARD));
    check(VecGetArrayRead(ghosts_, &from));
    add(others_, from, to, false);
    check(VecRestoreArrayRead(ghosts_, &from));
  }
  check(VecRestoreArray(y, &to));
}
