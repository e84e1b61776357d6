#include "insertion.h"

using namespace qsdolfinx;

namespace
{
/// One row of the operator, restricted to what a single component of it couples: unknowns and
/// values.
struct RowSide
{
  std::vector<PetscInt> dofs;
  std::vector<PetscScalar> values;
};

void gather_row(const GapOperator& gap, int s, std::size_t row, int component, bool pattern,
                RowSide& out)
{
  const GapOperator::Side& side = gap.side(s);
  const auto& dofs = pattern ? side.dofs : side.free_dofs;
  const int d = gap.gdim();
  out.dofs.clear();
  out.values.clear();
  for (std::int64_t e = side.offset[row]; e < side.offset[row + 1]; ++e)
  {
    const std::size_t first = static_cast<std::size_t>(side.column[e]) * d;
    if (gap.kind() == GapKind::jump)
    {
      out.dofs.push_back(dofs[first + component]);
      out.values.push_back(side.coefficient[e]);
      continue;
    }
    for (int i = 0; i < d; ++i)
    {
      out.dofs.push_back(dofs[first + i]);
      out.values.push_back(side.coefficient[e * d + i]);
    }
  }
}
} // namespace

void qsdolfinx::insert_contact(const GapOperator& gap, std::span<const double> stiffness,
                               ContactBlocks blocks, std::array<double, 2> scale, bool slave_only,
                               bool pattern)
{
  if (stiffness.size() != gap.num_rows())
    throw std::invalid_argument("stiffness must hold one value per row");
  std::array<RowSide, 2> row;
  std::vector<PetscScalar> outer;
  for (std::size_t r = 0; r < gap.num_rows(); ++r)
  {
    const double D = pattern ? 0.0 : stiffness[r];
    if (D == 0 && !pattern)
      continue;
    // A jump row couples each component with itself only.
    for (int component = 0; component < gap.width(); ++component)
    {
      for (int s = 0; s < gap.num_sides(); ++s)
        gather_row(gap, s, r, component, pattern, row[s]);
      for (int a = 0; a < (slave_only ? 1 : gap.num_sides()); ++a)
      {
        for (int b = 0; b < gap.num_sides(); ++b)
        {
          const auto m = row[a].dofs.size(), n = row[b].dofs.size();
          outer.resize(m * n);
          for (std::size_t i = 0; i < m; ++i)
            for (std::size_t j = 0; j < n; ++j)
              outer[i * n + j] = D * scale[b] * row[a].values[i] * row[b].values[j];
          check(MatSetValues(blocks[2 * a + b], static_cast<PetscInt>(m), row[a].dofs.data(),
                             static_cast<PetscInt>(n), row[b].dofs.data(), outer.data(),
                             ADD_VALUES));
        }
      }
    }
  }
}
