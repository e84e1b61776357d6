#include "tangent/products.h"
#include "parallel/petsc.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

using namespace qsdolfinx;

namespace
{
/// Rows of a point, or one row, as a dense matrix.
class DenseRows
{
public:
  /// Take some rows. Whether their columns are others than those of the rows before.
  bool take(const StackedRows& rows, std::size_t first, std::size_t count)
  {
    next_.clear();
    entries_.clear();
    for (std::size_t k = 0; k < count; ++k)
      rows.visit(first + k,
                 [&](PetscInt column, double value)
                 {
                   next_.push_back(column);
                   entries_.emplace_back(k, value);
                 });
    const bool is_new = next_ != found_;
    if (is_new)
      find_columns();
    const std::size_t n = columns_.size();
    values_.assign(count * n, 0.0);
    for (std::size_t e = 0; e < entries_.size(); ++e)
      values_[entries_[e].first * n + place_[e]] += entries_[e].second;
    return is_new;
  }

  /// Columns, ascending.
  const std::vector<PetscInt>& columns() const { return columns_; }
  /// Row k by these columns.
  const double* row(std::size_t k) const { return values_.data() + k * columns_.size(); }

private:
  void find_columns()
  {
    found_ = next_;
    columns_ = found_;
    std::ranges::sort(columns_);
    const auto rest = std::ranges::unique(columns_);
    columns_.erase(rest.begin(), rest.end());
    place_.resize(found_.size());
    std::ranges::transform(
        found_, place_.begin(), [this](PetscInt c)
        { return std::size_t(std::ranges::lower_bound(columns_, c) - columns_.begin()); });
  }

  std::vector<PetscInt> found_, next_, columns_;
  std::vector<std::pair<std::size_t, double>> entries_; ///< row and value of each
  std::vector<std::size_t> place_;                      ///< of each entry among the columns
  std::vector<double> values_;
};

/// Sum of products of points with the same columns.
class Block
{
public:
  explicit Block(Mat matrix) : matrix_(matrix) {}

  void begin(const std::vector<PetscInt>& rows, const std::vector<PetscInt>& columns)
  {
    insert();
    rows_ = rows;
    columns_ = columns;
    values_.assign(rows.size() * columns.size(), 0.0);
  }

  /// Add a number times the product of two rows.
  void add(const double* left, double factor, const double* right)
  {
    const std::size_t n = columns_.size();
    for (std::size_t i = 0; i < rows_.size() && factor != 0; ++i)
      for (std::size_t j = 0; j < n; ++j)
        values_[i * n + j] += factor * (left[i] * right[j]); // symmetric to the last bit
  }

  void insert()
  {
    if (!values_.empty())
      check(MatSetValues(matrix_, static_cast<PetscInt>(rows_.size()), rows_.data(),
                         static_cast<PetscInt>(columns_.size()), columns_.data(), values_.data(),
                         ADD_VALUES));
    values_.clear();
  }

private:
  Mat matrix_;
  std::vector<PetscInt> rows_, columns_;
  std::vector<PetscScalar> values_;
};
} // namespace

void StackedRows::add_gaps(const GapOperator& gap, int side, std::vector<PetscInt> numbers,
                           double factor, std::size_t first)
{
  const std::size_t num_columns = gap.side(side).dofs.size();
  if (gap.num_rows() != num_points_ || numbers.size() != num_columns)
    throw std::invalid_argument("a row for each point, and a number for each unknown");
  gaps_.push_back({&gap, side, std::move(numbers), factor, first});
}

void StackedRows::add_rows(const CompressedRows& rows, double factor, std::size_t first,
                           std::size_t width)
{
  if (rows.offset.size() != num_points_ * width + 1)
    throw std::invalid_argument("as many rows for each point");
  others_.push_back({&rows, factor, first, width});
}

void qsdolfinx::add_products(Mat matrix, const StackedRows& left, const StackedRows& right,
                             std::span<const double> D)
{
  const std::size_t num_rows = right.num_rows(), components = right.components();
  const bool coupled = components > 1 && D.size() == num_rows * components;
  if (left.num_rows() != num_rows || left.components() != components
      || (!coupled && D.size() != num_rows))
    throw std::invalid_argument("D must hold a number for each row, or a matrix for each point");
  const std::size_t count = coupled ? components : 1;
  DenseRows by_left, by_right;
  const bool same = &left == &right;
  Block block(matrix);
  for (std::size_t first = 0; first < num_rows; first += count)
  {
    bool is_new = by_right.take(right, first, count);
    if (!same)
      is_new = by_left.take(left, first, count) || is_new;
    const DenseRows& works_on = same ? by_right : by_left;
    if (is_new || first == 0)
      block.begin(works_on.columns(), by_right.columns());
    for (std::size_t k = 0; k < count; ++k)
      for (std::size_t l = 0; l < count; ++l)
        block.add(works_on.row(k), D[(first + k) * count + l], by_right.row(l));
  }
  block.insert();
}

void qsdolfinx::add_entries(Mat matrix, std::span<const std::int64_t> rows,
                            std::span<const std::int64_t> columns, std::span<const double> values)
{
  for (std::size_t e = 0; e < values.size(); ++e)
  {
    const auto i = static_cast<PetscInt>(rows[e]), j = static_cast<PetscInt>(columns[e]);
    if (i >= 0 && j >= 0)
      check(MatSetValues(matrix, 1, &i, 1, &j, &values[e], ADD_VALUES));
  }
}
