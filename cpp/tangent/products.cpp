#include "tangent/products.h"
#include "geometry/outer.h"

#include <algorithm>
#include <cstdint>
#include <stdexcept>
#include <utility>

using namespace qsdolfinx;

namespace
{
/// Rows of a point, or one row, as a dense matrix.
class DenseRows
{
public:
  /// Read some rows. Returns whether their columns differ from those of the previous rows.
  bool take(const StackedRows& rows, std::size_t first, std::size_t count)
  {
    size_ = count;
    if (take_as_before(rows, first, count))
      return false;
    find_columns(rows, first, count);
    take_as_before(rows, first, count);
    return true;
  }

  /// Number of rows.
  std::size_t size() const { return size_; }
  /// Columns, ascending.
  const std::vector<PetscInt>& columns() const { return columns_; }
  /// Values of row k in these columns.
  const double* row(std::size_t k) const { return values_.data() + k * (columns_.size() + 1); }
  /// The first column in which row k may have values, and the one after the last.
  const std::pair<std::size_t, std::size_t>& range(std::size_t k) const { return ranges_[k]; }

private:
  /// Read the rows if their columns are those of the previous rows; returns whether they are.
  bool take_as_before(const StackedRows& rows, std::size_t first, std::size_t count)
  {
    const std::size_t n = columns_.size();
    values_.assign(count * (n + 1), 0.0);
    std::size_t i = 0;
    const std::int32_t* place = place_.data();
    bool same = true;
    for (std::size_t k = 0; k < count && same; ++k)
      rows.visit_runs(first + k,
                      [&](const Run& run)
                      {
                        same = same && i < runs_.size() && runs_[i++].same_columns(run);
                        if (!same)
                          return;
                        double* to = &values_[k * (n + 1)];
                        for (std::size_t j = 0; j < run.count; ++j)
                          for (std::size_t c = 0; c < run.width; ++c)
                            to[*place++] += run.factor * run.values[j * run.step + c];
                      });
    return same && i == runs_.size();
  }

  void find_columns(const StackedRows& rows, std::size_t first, std::size_t count)
  {
    runs_.clear();
    found_.clear();
    std::vector<std::size_t> ends;
    for (std::size_t k = 0; k < count; ++k)
    {
      rows.visit_runs(first + k,
                      [&](const Run& run)
                      {
                        runs_.push_back(run);
                        for (std::size_t j = 0; j < run.count; ++j)
                          found_.insert(found_.end(), run.group(j), run.group(j) + run.width);
                      });
      ends.push_back(found_.size());
    }
    columns_ = found_;
    std::erase_if(columns_, [](PetscInt c) { return c < 0; });
    std::ranges::sort(columns_);
    const auto rest = std::ranges::unique(columns_);
    columns_.erase(rest.begin(), rest.end());
    place_.resize(found_.size());
    std::ranges::transform(found_, place_.begin(),
                           [this](PetscInt c)
                           {
                             const auto at = std::ranges::lower_bound(columns_, c);
                             return static_cast<std::int32_t>((c < 0 ? columns_.end() : at)
                                                              - columns_.begin());
                           });
    ranges_.assign(count, {0, 0});
    for (std::size_t k = 0, i = 0; k < count; ++k)
      for (auto& [begin, end] = ranges_[k]; i < ends[k]; ++i)
        if (const auto at = static_cast<std::size_t>(place_[i]); at < columns_.size())
        {
          begin = end > 0 ? std::min(begin, at) : at;
          end = std::max(end, at + 1);
        }
  }

  std::size_t size_ = 0;
  std::vector<PetscInt> found_, columns_;
  std::vector<Run> runs_;
  std::vector<std::int32_t> place_; ///< of each found column; after the last for ignored ones
  std::vector<std::pair<std::size_t, std::size_t>> ranges_;
  std::vector<double> values_; ///< [row][column], and the sum of ignored values
};

/// Sums of the products of points with the same columns.
class Blocks
{
public:
  explicit Blocks(RowSums& sums) : sums_(sums) {}

  /// Begin a block of points whose rows have the columns of these rows.
  void begin(const DenseRows& left, const DenseRows& right)
  {
    end();
    rows_ = left.columns();
    columns_ = right.columns();
    components_.resize(left.size());
    for (std::size_t k = 0; k < left.size(); ++k)
      components_[k].range = left.range(k);
    is_open_ = true;
  }

  /// Add the products D of rows of a point. @param D [row][row], or a number for each row
  void add(const DenseRows& left, std::span<const double> D, const DenseRows& right)
  {
    if (std::ranges::all_of(D, [](double value) { return value == 0; }))
      return;
    const std::size_t count = left.size(), n = columns_.size();
    const bool coupled = count > 1 && D.size() == count * count;
    for (std::size_t k = 0; k < count; ++k)
    {
      if (!coupled && D[k] == 0)
        continue;
      auto& [range, of_left, of_right, factor] = components_[k];
      if (&left == &right) // the products are symmetric
        factor.push_back(coupled ? 1.0 : D[k]);
      for (std::size_t i = range.first; i < range.second; ++i)
        of_left.push_back(coupled || &left == &right ? left.row(k)[i] : D[k] * left.row(k)[i]);
      const std::size_t first = of_right.size();
      of_right.insert(of_right.end(), right.row(k), right.row(k) + n);
      for (std::size_t j = 0; j < n && coupled; ++j)
      {
        double sum = 0;
        for (std::size_t l = 0; l < count; ++l)
          sum += D[k * count + l] * right.row(l)[j];
        of_right[first + j] = sum;
      }
    }
  }

  /// Add the current block to the matrix.
  void end()
  {
    if (!is_open_)
      return;
    values_.assign(rows_.size() * columns_.size(), 0.0);
    for (auto& [range, left, right, factor] : components_)
    {
      add_outer_products(left, right, factor, range.second - range.first, columns_.size(),
                         values_.data() + range.first * columns_.size(), columns_.size());
      for (auto* of_points : {&left, &right, &factor})
        of_points->clear();
    }
    sums_.add(rows_, columns_, values_);
    is_open_ = false;
  }

private:
  /// Rows of one component of the points so far.
  struct Component
  {
    std::pair<std::size_t, std::size_t> range; ///< as DenseRows::range, of the left rows
    std::vector<double> left, right, factor;   ///< `left` in this range only
  };

  RowSums& sums_;
  bool is_open_ = false;
  std::vector<PetscInt> rows_, columns_;
  std::vector<Component> components_;
  std::vector<double> values_;
};
} // namespace

void StackedRows::add_gaps(const GapOperator& gap, int side, std::vector<PetscInt> numbers,
                           double factor, std::size_t first)
{
  const std::size_t num_columns = gap.side(side).dofs.size();
  if (gap.num_rows() != num_points_ || numbers.size() != num_columns)
    throw std::invalid_argument("expected one row for each point and one number for each unknown");
  gaps_.push_back({&gap, side, std::move(numbers), factor, first});
}

void StackedRows::add_rows(const CompressedRows& rows, double factor, std::size_t first,
                           std::size_t width)
{
  if (rows.offset.size() != num_points_ * width + 1)
    throw std::invalid_argument("expected `width` rows for each point");
  others_.push_back({&rows, factor, first, width});
}

void qsdolfinx::add_products(RowSums& sums, const StackedRows& left, const StackedRows& right,
                             std::span<const double> D)
{
  const std::size_t num_rows = right.num_rows(), components = right.components();
  const bool coupled = components > 1 && D.size() == num_rows * components;
  if (left.num_rows() != num_rows || left.components() != components
      || (!coupled && D.size() != num_rows))
    throw std::invalid_argument("D must hold a number for each row, or a matrix for each point");
  // Rows of a point are treated together; usually their columns are those of the previous point.
  const std::size_t count = components, of_point = coupled ? count * count : count;
  DenseRows by_left, by_right;
  const bool same = &left == &right;
  Blocks blocks(sums);
  for (std::size_t first = 0; first < num_rows; first += count)
  {
    bool is_new = by_right.take(right, first, count);
    if (!same)
      is_new = by_left.take(left, first, count) || is_new;
    const DenseRows& works_on = same ? by_right : by_left;
    if (is_new || first == 0)
      blocks.begin(works_on, by_right);
    blocks.add(works_on, D.subspan(first / count * of_point, of_point), by_right);
  }
  blocks.end();
}
