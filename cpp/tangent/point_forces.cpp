#include "tangent/point_forces.h"
#include "gap/piece_forces.h"
#include "tangent/piece_matrix.h"

#include <stdexcept>

using namespace qsdolfinx;

namespace
{
/// Adds matrices with the rows of a PieceMatrix to the matrix of all unknowns.
class Insertion
{
public:
  /// @throws std::invalid_argument if there is not a number for each unknown of the pieces
  Insertion(const Pieces& pieces, const FunctionUnknowns& functions, const Destination& to)
      : functions_(functions), to_(to), d_(static_cast<std::size_t>(pieces.gdim)),
        nodes_{static_cast<std::size_t>(pieces.slave.num_nodes),
               static_cast<std::size_t>(pieces.master.num_nodes)}
  {
    for (std::size_t s = 0; s < 2; ++s)
      if (!to.numbers[s].empty() && to.numbers[s].size() != pieces.size() * nodes_[s] * d_)
        throw std::invalid_argument("a number for each unknown");
  }

  /// Begin a matrix of the nodes of a piece.
  void begin(std::size_t piece)
  {
    clear();
    for (std::size_t s = 0, first = 0; s < 2; first += 3 * nodes_[s++])
      for (std::size_t i = 0; i < nodes_[s] * d_; ++i)
      {
        const std::size_t at = first + 3 * (i / d_) + i % d_;
        if (!to_.numbers[s].empty())
          append(rows_, columns_, to_.numbers[s][piece * nodes_[s] * d_ + i], at, to_.scale[s]);
        if (to_.tool < 0) // a motion of the tool is that of the slave in the other direction
          continue;
        if (s == 0)
          append(rows_, to_.tool, at, -to_.way[i % d_]);
        else
          append(columns_, to_.tool, at, to_.way[i % d_]);
      }
  }

  void clear()
  {
    rows_.clear();
    columns_.clear();
  }

  /// Append a multiplier. @param row see FunctionUnknowns @param at row of the matrix
  void append_function(std::size_t component, std::int64_t row, std::size_t at)
  {
    const CompressedRows& unknowns = *functions_.rows[component];
    for (std::int64_t e = unknowns.offset[row]; e < unknowns.offset[row + 1]; ++e)
    {
      append(rows_, unknowns.column[e], at, unknowns.value[e]);
      append(columns_, unknowns.column[e], at, unknowns.value[e]);
    }
  }

  /// @param size length of a row of the matrix
  void add(std::span<const double> matrix, std::size_t size)
  {
    if (rows_.is_all_of(size) && columns_.is_all_of(size))
      return to_.sums.add(rows_.number, columns_.number, matrix);
    block_.resize(rows_.number.size() * columns_.number.size());
    double* to = block_.data();
    for (std::size_t r = 0; r < rows_.number.size(); ++r)
    {
      const double* row = &matrix[rows_.at[r] * size];
      for (std::size_t c = 0; c < columns_.number.size(); ++c)
        *to++ = rows_.factor[r] * columns_.factor[c] * row[columns_.at[c]];
    }
    to_.sums.add(rows_.number, columns_.number, block_);
  }

private:
  /// Unknowns, and the rows of the matrix that are added to theirs with these factors.
  struct Unknowns
  {
    std::vector<PetscInt> number;
    std::vector<std::size_t> at;
    std::vector<double> factor;

    void clear()
    {
      number.clear();
      at.clear();
      factor.clear();
    }
    /// Whether they are those of all rows, in their order and without factors.
    bool is_all_of(std::size_t size) const
    {
      std::size_t i = 0;
      while (i < number.size() && at[i] == i && factor[i] == 1)
        ++i;
      return i == size && i == number.size();
    }
  };

  static void append(Unknowns& to, std::int64_t number, std::size_t at, double factor)
  {
    if (number < 0)
      return;
    to.number.push_back(static_cast<PetscInt>(number));
    to.at.push_back(at);
    to.factor.push_back(factor);
  }

  static void append(Unknowns& rows, Unknowns& columns, std::int64_t number, std::size_t at,
                     double scale)
  {
    append(rows, number, at, 1.0);
    append(columns, number, at, scale);
  }

  const FunctionUnknowns& functions_;
  const Destination& to_;
  std::size_t d_;
  std::array<std::size_t, 2> nodes_;
  Unknowns rows_, columns_;
  std::vector<double> block_;
};

/// Matrix of the multipliers of a point without a partner, [component][component].
std::vector<double> of_alone(const PointState& at, std::size_t point)
{
  const std::size_t m = at.components;
  std::vector<double> out(m * m);
  for (std::size_t c = 0; c < m; ++c)
  {
    for (std::size_t l = 0; l < m; ++l)
      out[c * m + l] = at.in_work[c] * at.D[(point * m + c) * m + l] * at.part[l];
    out[c * m + c] += at.own[point * m + c];
  }
  return out;
}
} // namespace

std::vector<std::int64_t> qsdolfinx::free_unknowns(const PieceSide& side, Vec markers)
{
  const std::vector<double> marked = values_at(markers, side.dofs);
  std::vector<std::int64_t> out = side.dofs;
  for (std::size_t i = 0; i < out.size(); ++i)
    if (marked[i] != 0)
      out[i] = -1;
  return out;
}

void qsdolfinx::add_point_forces(const Pieces& pieces, const SlipOfPieces* slip,
                                 const PointState& at, const FunctionUnknowns& functions,
                                 const Destination& to)
{
  if (at.components > 1 && !slip)
    throw std::invalid_argument("no slip");
  PieceMatrix matrix(pieces, slip, at, functions.own);
  Insertion insertion(pieces, functions, to);
  const std::size_t m = at.components, nk = matrix.num_functions();
  const bool has_functions = !at.own.empty();
  for (std::size_t i = 0, first = 0; i < pieces.size(); first = pieces.end[i++])
  {
    insertion.begin(i);
    for (std::size_t c = 0; c < m && has_functions; ++c)
      for (std::size_t k = 0; k < nk; ++k)
        insertion.append_function(c, functions.row[i * nk + k], matrix.row_of(c, k));
    insertion.add(matrix.of(i, first), matrix.size());
  }
  for (std::size_t p = pieces.points.size(); has_functions && p < at.own.size() / m; ++p)
  {
    insertion.clear();
    for (std::size_t c = 0; c < m; ++c)
      insertion.append_function(c, functions.row[pieces.size() * nk + p - pieces.points.size()], c);
    insertion.add(of_alone(at, p), m);
  }
}
