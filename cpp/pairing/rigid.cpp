#include "pairing/rigid.h"
#include "parallel/records.h"
#include "surface/curvature.h"

#include <algorithm>
#include <stdexcept>

using namespace qsdolfinx;

PairingPoints qsdolfinx::sample_nodes(const Surface& slave)
{
  if (slave.degree() != 1)
    throw std::invalid_argument("nodal pairing points need traces of degree 1");
  return sample_vertices(slave, std::vector<std::uint8_t>(slave.nodes().size(), 1));
}

PairingPoints qsdolfinx::sample_vertices(const Surface& slave, std::span<const std::uint8_t> which)
{
  const Nodes& nodes = slave.nodes();
  if (which.size() != nodes.size())
    throw std::invalid_argument("sample_vertices: one flag for each owned node");
  PairingPoints out(slave, nullptr);
  for (std::size_t k = 0; k < which.size(); ++k)
    if (which[k])
    {
      append_node(out.slave, nodes, k, out.block, slave.rank());
      append_record(out.normal, nodes.normal, k, 3);
      append_record(out.master.x, nodes.x, k, 3);
      out.weight.push_back(nodes.area[k]);
    }
  append_own_multipliers(out);
  out.multiplier_side.assign(out.multiplier_values.size(), 0);
  out.gap.assign(out.size(), 0.0);
  return out;
}

PairingPoints qsdolfinx::sample_facets(const Surface& slave, const Rule& rule)
{
  PairingPoints out(slave, nullptr);
  const FacetType type = slave.type();
  const std::size_t nv = slave.num_vertices(), nt = slave.num_trace(), d = nt * out.block;
  const double reference_area = type == FacetType::triangle ? 0.5 : 1.0;
  const Facets& facets = slave.facets();
  for (std::size_t f = 0; f < slave.num_facets(); ++f)
    for (std::size_t p = 0; p < rule.w.size(); ++p)
    {
      const Vec3 x = facet_point(type, slave.facet_x(f), rule.x[p]);
      const Vec3 n = slave.normal(f, rule.x[p]);
      const auto N = shape_functions(type, rule.x[p]);
      const auto T = trace_functions(type, slave.degree(), rule.x[p]);
      const double jacobian = norm(area_vector(type, slave.facet_x(f), rule.x[p]));
      append_record(out.slave.x, x, 0, 3);
      append_record(out.slave.dofs, facets.dofs, f, d);
      append_record(out.slave.owner, facets.owner, f, nt);
      append_record(out.slave.shape_values, T, 0, nt);
      append_record(out.multiplier_values, N, 0, nv);
      append_record(out.multiplier_side, facets.vertex_side, f, nv);
      append_record(out.normal, n, 0, 3);
      append_record(out.master.x, x, 0, 3);
      out.gap.push_back(0);
      out.weight.push_back(reference_area * rule.w[p] * jacobian * slave.area_factor(x));
    }
  return out;
}

std::vector<double> qsdolfinx::heights_at(const Surface& surface, const Heights& heights,
                                          const Rule& rule)
{
  const FacetType type = surface.type();
  const auto nodes = static_cast<std::size_t>(trace_size(type, 2));
  const auto K = heights ? std::vector<Curvature>{} : facet_curvature(surface);
  std::vector<double> out;
  for (std::size_t f = 0; f < surface.num_facets(); ++f)
    for (const auto& xi : rule.x)
      out.push_back(heights ? height_at(type, heights->subspan(f * nodes, nodes), xi)
                            : bulge(K[f], type, surface.facet_x(f), shape_functions(type, xi)));
  return out;
}

void qsdolfinx::face_tool(PairingPoints& points, std::span<const std::uint8_t> keep,
                          std::span<const double> normal, std::span<const double> gap,
                          std::size_t group)
{
  const std::size_t n = points.size();
  if (keep.size() != n || normal.size() != 3 * n || gap.size() != n || group == 0 || n % group != 0)
    throw std::invalid_argument("face_tool: one entry for each point");
  for (std::size_t first = 0; first < n; first += group)
    points.num_unpaired
        += std::ranges::count(keep.subspan(first, group), 0) == static_cast<std::ptrdiff_t>(group);
  points.normal.assign(normal.begin(), normal.end());
  points.gap.assign(gap.begin(), gap.end());
  for (std::size_t i = 0; i < 3 * n; ++i)
    points.master.x[i] = points.slave.x[i] + gap[i / 3] * normal[i];
  points.keep(keep);
}

void qsdolfinx::forget_master(PairingPoints& points)
{
  points.num_faced = points.master.num_nodes;
  points.faced.clear();
  for (std::size_t i = 0; i < points.master.owner.size(); ++i)
    points.faced.push_back(points.master.dofs[i * static_cast<std::size_t>(points.block)]);
  points.master.num_nodes = 0;
  points.master.dofs.clear();
  points.master.owner.clear();
  points.master.shape_values.clear();
}
