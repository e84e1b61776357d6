#include "surface/heights.h"

using namespace qsdolfinx;

namespace
{
/// Call visit(ξ) at the nodes of degree 2 of a reference facet.
template <typename Visit>
void for_nodes(FacetType type, Visit visit)
{
  const auto corner = [type](int i) -> std::array<double, 2>
  {
    if (type == FacetType::quadrilateral)
      return {static_cast<double>(i & 1), static_cast<double>(i >> 1)};
    return {i == 1 ? 1.0 : 0.0, i == 2 ? 1.0 : 0.0};
  };
  for (int i = 0; i < static_cast<int>(type); ++i)
    visit(corner(i));
  for (const auto& [a, b] : facet_edges(type))
  {
    const auto p = corner(a), q = corner(b);
    visit({(p[0] + q[0]) / 2, (p[1] + q[1]) / 2});
  }
  if (type == FacetType::quadrilateral)
    visit({0.5, 0.5});
}

template <typename Value>
std::vector<double> at_nodes(const Surface& surface, Value value)
{
  std::vector<double> out;
  for (std::size_t f = 0; f < surface.num_facets(); ++f)
    for_nodes(surface.type(),
              [&](std::array<double, 2> xi)
              {
                const Vec3 v = value(f, xi);
                out.insert(out.end(), v.begin(), v.end());
              });
  return out;
}
} // namespace

std::vector<double> qsdolfinx::flat_nodes(const Surface& surface)
{
  return at_nodes(surface, [&](std::size_t f, std::array<double, 2> xi)
                  { return facet_point(surface.type(), surface.facet_x(f), xi); });
}

std::vector<double> qsdolfinx::flat_normals(const Surface& surface)
{
  return at_nodes(surface,
                  [&](std::size_t f, std::array<double, 2> xi) { return surface.normal(f, xi); });
}

double qsdolfinx::height_at(FacetType type, std::span<const double> heights,
                            std::array<double, 2> xi)
{
  const auto T = trace_functions(type, 2, xi);
  double sum = 0;
  for (std::size_t i = 0; i < heights.size(); ++i)
    sum += T[i] * heights[i];
  return sum;
}
