#include "tangent/friction.h"
#include "parallel/petsc.h"

#include <algorithm>
#include <stdexcept>

using namespace qsdolfinx;

namespace
{
/// Unknowns of the columns of one row, -1 where a Dirichlet condition holds.
void gather_dofs(const GapOperator::Side& side, std::size_t row, int d, std::vector<PetscInt>& out)
{
  out.clear();
  for (std::int64_t e = side.offset[row]; e < side.offset[row + 1]; ++e)
  {
    const auto first = side.free_dofs.begin() + static_cast<std::ptrdiff_t>(side.column[e]) * d;
    out.insert(out.end(), first, first + d);
  }
}

/// D J + c G of one row, [component of τ][unknown of one side].
void response(std::span<const double> D, std::span<const double> c, const GapOperator::Side& J,
              const GapOperator::Side& G, std::size_t row, double scale, std::vector<double>& out)
{
  const std::size_t d = c.size(), n = (J.offset[row + 1] - J.offset[row]) * d;
  out.assign(d * n, 0);
  for (std::size_t i = 0; i < d; ++i)
    for (std::size_t j = 0; j < n; ++j)
    {
      const std::size_t e = J.offset[row] + j / d;
      out[i * n + j]
          = scale * (D[i * d + j % d] * J.coefficient[e] + c[i] * G.coefficient[e * d + j % d]);
    }
}
} // namespace

void qsdolfinx::insert_friction(const GapOperator& jump, const GapOperator& normal,
                                std::span<const double> stiffness, std::span<const double> coupling,
                                ContactBlocks blocks, std::array<double, 2> scale)
{
  const auto d = static_cast<std::size_t>(jump.block());
  const std::size_t rows = jump.num_rows();
  if (jump.kind() != GapKind::jump || jump.turns() || normal.kind() != GapKind::normal
      || normal.num_rows() != rows || stiffness.size() != rows * d * d
      || coupling.size() != rows * d)
    throw std::invalid_argument(
        "friction: one block and one vector for each row of both operators");
  for (int s = 0; s < jump.num_sides(); ++s)
    if (jump.side(s).column != normal.side(s).column || jump.side(s).dofs != normal.side(s).dofs)
      throw std::invalid_argument("friction: the operators are not of the same pairing points");

  std::array<std::vector<PetscInt>, 2> dofs;
  std::vector<double> column;
  std::vector<PetscScalar> outer;
  const auto zero = [](double x) { return x == 0; };
  for (std::size_t r = 0; r < rows; ++r)
  {
    const auto D = stiffness.subspan(r * d * d, d * d), c = coupling.subspan(r * d, d);
    if (std::ranges::all_of(D, zero) && std::ranges::all_of(c, zero))
      continue;
    for (int s = 0; s < jump.num_sides(); ++s)
      gather_dofs(jump.side(s), r, jump.block(), dofs[s]);
    for (int b = 0; b < jump.num_sides(); ++b)
    {
      response(D, c, jump.side(b), normal.side(b), r, scale[b], column);
      for (int a = 0; a < jump.num_sides(); ++a)
      {
        const std::size_t m = dofs[a].size(), n = dofs[b].size(), first = jump.side(a).offset[r];
        outer.resize(m * n);
        for (std::size_t i = 0; i < m; ++i)
          for (std::size_t j = 0; j < n; ++j)
            outer[i * n + j] = jump.side(a).coefficient[first + i / d] * column[(i % d) * n + j];
        check(MatSetValues(blocks[2 * a + b], static_cast<PetscInt>(m), dofs[a].data(),
                           static_cast<PetscInt>(n), dofs[b].data(), outer.data(), ADD_VALUES));
      }
    }
  }
}
