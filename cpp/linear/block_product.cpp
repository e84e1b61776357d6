#include "linear/block_product.h"
#include "geometry/processors.h"
#include "parallel/petsc.h"

#include <algorithm>
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

/// Numbers between the present block and the one that is asked for from memory: processors alone do
/// not look beyond a page of 512. In large matrices this halves the time; 128 to 2048 differ
/// little.
constexpr int AHEAD = 512;

/// Four numbers, for one vector instruction.
using Four = double __attribute__((vector_size(4 * sizeof(double))));

/// Read four numbers.
inline void read(Four& v, const double* p) { std::memcpy(&v, p, sizeof v); }

/// Read the columns of a block of three. The fourth number of each belongs to the next column and
/// is not used; no number is read behind the last entry, before `end`.
inline void read_block(Four& p0, Four& p1, Four& p2, const double* p, const double* end)
{
  __builtin_prefetch(p + AHEAD);
  __builtin_prefetch(p + AHEAD + 8);
  read(p0, p);
  read(p1, p + 3);
  if (p + 10 <= end)
    read(p2, p + 6);
  else // the last block of PETSc's entries
    p2 = Four{p[6], p[7], p[8], 0.0};
}

/// Products with rows of blocks of three.
inline void rows_of_three(const Rows& rows, const double* v, const double* end, const double* x,
                          double* y, bool first)
{
  for (PetscInt i = 0; i < rows.count; ++i)
  {
    Four a = {}, b = {}, c = {}, p0, p1, p2 = {};
    for (PetscInt k = rows.begin[i]; k < rows.begin[i + 1]; ++k)
    {
      const double* p = v + 9 * k;
      const double* u = x + 3 * rows.column[k];
      read_block(p0, p1, p2, p, end);
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
      __builtin_prefetch(v + 4 * k + AHEAD);
      read(p, v + 4 * k);
      a += p * Four{u[0], u[0], u[1], u[1]};
    }
    for (int r = 0; r < 2; ++r)
      y[2 * i + r] = (first ? 0.0 : y[2 * i + r]) + a[r] + a[r + 2];
  }
}

/// Products with a symmetric matrix, of which the blocks on the diagonal and right of it are
/// stored. Each block is read once, for its own row and for that of its transposed block.
inline void halves_of_three(const Rows& rows, const double* v, const double* end, const double* x,
                            double* y)
{
  for (PetscInt i = 0; i < rows.count; ++i)
  {
    const double* t = x + 3 * i;
    Four a = {}, b = {}, c = {}, p0, p1, p2 = {};
    for (PetscInt k = rows.begin[i]; k < rows.begin[i + 1]; ++k)
    {
      const double* p = v + 9 * k;
      const double* u = x + 3 * rows.column[k];
      read_block(p0, p1, p2, p, end);
      a += p0 * u[0];
      b += p1 * u[1];
      c += p2 * u[2];
      if (rows.column[k] == i)
        continue;
      double* w = y + 3 * rows.column[k];
      w[0] += p[0] * t[0] + p[1] * t[1] + p[2] * t[2];
      w[1] += p[3] * t[0] + p[4] * t[1] + p[5] * t[2];
      w[2] += p[6] * t[0] + p[7] * t[1] + p[8] * t[2];
    }
    a += b + c;
    for (int r = 0; r < 3; ++r)
      y[3 * i + r] += a[r];
  }
}

/// The same for blocks of two.
inline void halves_of_two(const Rows& rows, const double* v, const double* x, double* y)
{
  for (PetscInt i = 0; i < rows.count; ++i)
  {
    const double* t = x + 2 * i;
    Four a = {}, p;
    for (PetscInt k = rows.begin[i]; k < rows.begin[i + 1]; ++k)
    {
      const double* u = x + 2 * rows.column[k];
      __builtin_prefetch(v + 4 * k + AHEAD);
      read(p, v + 4 * k);
      a += p * Four{u[0], u[0], u[1], u[1]};
      if (rows.column[k] == i)
        continue;
      double* w = y + 2 * rows.column[k];
      w[0] += p[0] * t[0] + p[1] * t[1];
      w[1] += p[2] * t[0] + p[3] * t[1];
    }
    for (int r = 0; r < 2; ++r)
      y[2 * i + r] += a[r] + a[r + 2];
  }
}

/// Add to y the products with the transposed blocks of rows.
void add_transposed(PetscInt block, const Rows& rows, const double* v, const double* x, double* y)
{
  for (PetscInt i = 0; i < rows.count; ++i)
    for (PetscInt k = rows.begin[i]; k < rows.begin[i + 1]; ++k)
      for (PetscInt c = 0; c < block; ++c)
        for (PetscInt r = 0; r < block; ++r)
          y[block * rows.column[k] + c] += v[(k * block + c) * block + r] * x[block * i + r];
}

QSDOLFINX_FOR_PROCESSORS
void multiply_symmetric(PetscInt block, const Rows& rows, const double* v, const double* end,
                        const double* x, double* y)
{
  std::fill_n(y, block * rows.count, 0.0);
  if (block == 3)
    halves_of_three(rows, v, end, x, y);
  else
    halves_of_two(rows, v, x, y);
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
  const bool is_known = is_type(matrix, MATSEQBAIJ) || is_type(matrix, MATMPIBAIJ)
                        || is_type(matrix, MATSEQSBAIJ) || is_type(matrix, MATMPISBAIJ);
  return (block == 2 || block == 3) && is_known;
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
    scatter(matrix, std::span(ghosts, count / block_));
  }
  else if (is_type(matrix, MATMPISBAIJ))
  {
    check(MatGetDiagonalBlock(matrix, &own_));
    copy_right(matrix);
  }
}

void BlockProduct::scatter(Mat matrix, std::span<const PetscInt> ghosts)
{
  const PetscInt count = std::ssize(ghosts);
  check(VecCreateSeq(PETSC_COMM_SELF, block_ * count, &ghosts_));
  IS from = nullptr;
  Vec x = nullptr;
  check(ISCreateBlock(PETSC_COMM_SELF, block_, count, ghosts.data(), PETSC_COPY_VALUES, &from));
  check(MatCreateVecs(matrix, &x, nullptr));
  check(VecScatterCreate(x, from, ghosts_, nullptr, &scatter_));
  check(VecDestroy(&x));
  check(ISDestroy(&from));
}

void BlockProduct::copy_right(Mat matrix)
{
  PetscInt first = 0, end = 0;
  check(MatGetOwnershipRange(matrix, &first, &end));
  check(MatGetRowUpperTriangular(matrix));
  right_.begin.push_back(0);
  for (PetscInt row = first; row < end; ++row)
  {
    const PetscInt r = (row - first) % block_, begin = right_.begin.back();
    PetscInt count = 0;
    const PetscInt* columns = nullptr;
    const double* values = nullptr;
    check(MatGetRow(matrix, row, &count, &columns, &values));
    const PetscInt of_others
        = std::count_if(columns, columns + count, [end](PetscInt column) { return column >= end; });
    if (r == 0)
    {
      right_.column.resize(begin + of_others / block_);
      right_.values.resize(right_.column.size() * block_ * block_);
    }
    for (PetscInt k = count - of_others, n = 0; k < count; ++k, ++n)
    {
      right_.column[begin + n / block_] = columns[k] / block_;
      right_.values[((begin + n / block_) * block_ + n % block_) * block_ + r] = values[k];
    }
    check(MatRestoreRow(matrix, row, &count, &columns, &values));
    if (r == block_ - 1)
      right_.begin.push_back(std::ssize(right_.column));
  }
  check(MatRestoreRowUpperTriangular(matrix));
  std::vector<PetscInt> ghosts(right_.column);
  std::ranges::sort(ghosts);
  ghosts.erase(std::unique(ghosts.begin(), ghosts.end()), ghosts.end());
  for (PetscInt& column : right_.column)
    column = std::ranges::lower_bound(ghosts, column) - ghosts.begin();
  scatter(matrix, ghosts);
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
  const PetscInt count = rows.begin[rows.count] * block_ * block_;
  double* v = nullptr;
  if (is_type(part, MATSEQSBAIJ))
  {
    check(MatSeqSBAIJGetArray(part, &v));
    multiply_symmetric(block_, rows, v, v + count, x, y);
    check(MatSeqSBAIJRestoreArray(part, &v));
    return;
  }
  check(MatSeqBAIJGetArray(part, &v));
  multiply(block_, rows, v, v + count, x, y, first);
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
  if (scatter_)
  {
    check(VecScatterEnd(scatter_, x, ghosts_, INSERT_VALUES, SCATTER_FORWARD));
    double* ghosts = nullptr;
    check(VecGetArray(ghosts_, &ghosts));
    if (others_)
      add(others_, ghosts, to, false);
    else
      add_right(from, to, ghosts);
    check(VecRestoreArray(ghosts_, &ghosts));
  }
  check(VecRestoreArrayRead(x, &from));
  check(VecRestoreArray(y, &to));
  if (scatter_ && !others_)
  {
    check(VecScatterBegin(scatter_, ghosts_, y, ADD_VALUES, SCATTER_REVERSE));
    check(VecScatterEnd(scatter_, ghosts_, y, ADD_VALUES, SCATTER_REVERSE));
  }
}

void BlockProduct::add_right(const double* x, double* y, double* ghosts) const
{
  const PetscInt count = std::ssize(right_.begin) - 1;
  const Rows rows = {count, right_.begin.data(), right_.column.data()};
  const double* v = right_.values.data();
  multiply(block_, rows, v, v + right_.values.size(), ghosts, y, false);
  PetscInt size = 0;
  check(VecGetLocalSize(ghosts_, &size));
  std::fill_n(ghosts, size, 0.0);
  add_transposed(block_, rows, v, x, ghosts);
}
