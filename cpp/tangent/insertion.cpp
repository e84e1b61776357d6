#include "tangent/insertion.h"
#include "parallel/petsc.h"

#include <algorithm>
#include <numeric>
#include <stdexcept>

using namespace qsdolfinx;

namespace
{
/// Entries of one side of the operator by their columns, in the order of the rows; rows that are
/// skipped have none.
struct Columns
{
  std::vector<std::size_t> end;    ///< entries of column c: [end[c - 1], end[c])
  std::vector<std::size_t> row;    ///< of each entry
  std::vector<std::int64_t> entry; ///< number of each entry in the side

  Columns(const GapOperator::Side& side, std::size_t num_columns, std::span<const double> factor)
      : end(num_columns + 1, 0)
  {
    const auto each = [&](auto visit)
    {
      for (std::size_t r = 0; r < factor.size(); ++r)
        for (std::int64_t e = side.offset[r]; factor[r] != 0 && e < side.offset[r + 1]; ++e)
          visit(r, e, static_cast<std::size_t>(side.column[e]));
    };
    each([this](std::size_t, std::int64_t, std::size_t c) { ++end[c + 1]; });
    std::partial_sum(end.begin(), end.end(), end.begin());
    row.resize(end.back());
    entry.resize(end.back());
    each(
        [this](std::size_t r, std::int64_t e, std::size_t c)
        {
          row[end[c]] = r;
          entry[end[c]++] = e;
        });
    end.pop_back(); // each entry of `end` has moved from the start of its column to the end
  }
};

/// Inserts one of the four blocks of Gᵀ D G, node by node. Equal entries of different rows are
/// added here, so that every entry is passed to PETSc only once, with columns in ascending order.
class BlockInsertion
{
public:
  /// @param components of a jump that are inserted: [first, last)
  BlockInsertion(const GapOperator& gap, int b, bool pattern,
                 std::pair<std::size_t, std::size_t> components)
      : gap_(gap), other_(gap.side(b)), d_(gap.block()), components_(components), pattern_(pattern),
        dofs_(pattern ? other_.dofs : other_.free_dofs), place_(other_.dofs.size() / d_, -1)
  {
  }

  /// @param a side of the rows @param factor D times the scale, of each row of the operator
  void run(Mat block, int a, const Columns& by_column, std::span<const double> factor)
  {
    const GapOperator::Side& side = gap_.side(a);
    const auto& rows = pattern_ ? side.dofs : side.free_dofs;
    for (std::size_t c = 0, first = 0; c < by_column.end.size(); first = by_column.end[c++])
    {
      if (first == by_column.end[c])
        continue;
      const auto range = std::pair(first, by_column.end[c]);
      find_columns(by_column, range);
      add_products(side, by_column, range, factor);
      insert(block, &rows[c * d_]);
      for (std::int32_t column : columns_)
        place_[column] = -1;
    }
  }

private:
  using Range = std::pair<std::size_t, std::size_t>;

  /// Whether an entry couples all unknowns of its node. For a jump it does only if the jump is
  /// co-rotated.
  bool couples() const { return gap_.kind() == GapKind::normal || gap_.turns(); }
  /// Unknowns of a node that an entry couples.
  std::size_t width() const { return couples() ? d_ : 1; }
  /// Components of a row that are coupled with all unknowns.
  std::pair<std::size_t, std::size_t> full_rows() const
  {
    return gap_.turns() ? components_ : std::pair<std::size_t, std::size_t>(0, 1);
  }

  /// All columns of the rows in a range, ascending.
  void find_columns(const Columns& by_column, Range range)
  {
    columns_.clear();
    for (std::size_t i = range.first; i < range.second; ++i)
    {
      const std::size_t r = by_column.row[i];
      for (std::int64_t e = other_.offset[r]; e < other_.offset[r + 1]; ++e)
        if (std::int32_t& place = place_[other_.column[e]]; place < 0)
        {
          place = 0;
          columns_.push_back(other_.column[e]);
        }
    }
    std::ranges::sort(columns_);
    for (std::size_t i = 0; i < columns_.size(); ++i)
      place_[columns_[i]] = static_cast<std::int32_t>(i);
  }

  void add_products(const GapOperator::Side& side, const Columns& by_column, Range range,
                    std::span<const double> factor)
  {
    const std::size_t w = width(), n = columns_.size() * w, size = gap_.entry_size();
    const auto [first, last] = full_rows();
    values_.assign(w * n, 0.0);
    for (std::size_t i = range.first; i < range.second && !pattern_; ++i)
    {
      const std::size_t r = by_column.row[i];
      const double* here = &side.coefficient[by_column.entry[i] * size];
      for (std::int64_t e = other_.offset[r]; e < other_.offset[r + 1]; ++e)
      {
        const double* there = &other_.coefficient[e * size];
        double* to = &values_[place_[other_.column[e]] * w];
        for (std::size_t c = first * w; c < last * w; c += w)
          for (std::size_t k = 0; k < w; ++k)
            for (std::size_t l = 0; l < w; ++l) // symmetric to the last bit
              to[k * n + l] += factor[r] * (here[c + k] * there[c + l]);
      }
    }
  }

  void insert(Mat block, const PetscInt* rows)
  {
    const auto num_columns = columns_.size();
    // The rows of a jump that is not co-rotated couple each component only with itself.
    const std::size_t per_call = width();
    const auto [begin, end] = couples() ? std::pair<std::size_t, std::size_t>(0, 1) : components_;
    for (std::size_t k = begin; k < end; ++k)
    {
      unknowns_.clear();
      for (std::int32_t column : columns_)
        for (std::size_t l = 0; l < per_call; ++l)
          unknowns_.push_back(dofs_[column * d_ + k + l]);
      check(MatSetValues(block, static_cast<PetscInt>(per_call), rows + k,
                         static_cast<PetscInt>(num_columns * per_call), unknowns_.data(),
                         values_.data(), ADD_VALUES));
    }
  }

  const GapOperator& gap_;
  const GapOperator::Side& other_;
  std::size_t d_;
  std::pair<std::size_t, std::size_t> components_;
  bool pattern_;
  const std::vector<PetscInt>& dofs_;
  std::vector<std::int32_t> place_; ///< place of a column among those of a node, or -1
  // Of the current node.
  std::vector<std::int32_t> columns_;
  std::vector<PetscScalar> values_;
  std::vector<PetscInt> unknowns_;
};
} // namespace

void qsdolfinx::insert_contact(const GapOperator& gap, std::span<const double> stiffness,
                               ContactBlocks blocks, std::array<double, 2> scale, bool pattern)
{
  // A value for each component of a jump, or the same for all of them.
  const std::size_t rows = gap.num_rows(), width = gap.width();
  const std::size_t parts = rows > 0 && stiffness.size() == rows * width && !pattern ? width : 1;
  if (stiffness.size() != rows * parts)
    throw std::invalid_argument("stiffness must hold one value per row, or `width`");
  for (std::size_t part = 0; part < parts; ++part)
  {
    const auto components
        = parts == 1 ? std::pair(std::size_t(0), width) : std::pair(part, part + 1);
    const auto value = [&](std::size_t r) { return stiffness[r * parts + part]; };
    for (int a = 0; a < gap.num_sides(); ++a)
    {
      std::vector<double> factor(rows, 1.0);
      for (std::size_t r = 0; r < rows && !pattern; ++r)
        factor[r] = value(r);
      const GapOperator::Side& side = gap.side(a);
      const Columns by_column(side, side.dofs.size() / gap.block(), factor);
      for (int b = 0; b < gap.num_sides(); ++b)
      {
        for (std::size_t r = 0; r < rows; ++r)
          factor[r] = value(r) * scale[b];
        BlockInsertion(gap, b, pattern, components).run(blocks[2 * a + b], a, by_column, factor);
      }
    }
  }
}
