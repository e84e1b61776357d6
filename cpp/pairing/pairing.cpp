#include "pairing/pairing.h"
#include "parallel/records.h"

#include <algorithm>
#include <stdexcept>

using namespace qsdolfinx;

namespace
{
/// A point within a facet, as found for node k.
void append_facet(PairingSide& side, const ClosestFacets& found, std::size_t k, int gdim)
{
  append_record(side.x, found.x, k, 3);
  append_record(side.dofs, found.dofs, k, side.num_nodes * gdim);
  append_record(side.owner, found.owner, k, side.num_nodes);
  append_record(side.shape_values, found.shape_values, k, side.num_nodes);
}

/// Points at the nodes of one side, projected onto the other.
/// @param at_slave whether the nodes are the slave's
/// @param share part of the nodal area that is the weight
void append_nodal_points(PairingPoints& points, const Surface& at, const Surface& onto,
                         bool at_slave, double share, double radius, Normals normals)
{
  const ClosestFacets found = closest_facets(at, onto, radius);
  PairingSide& node_side = at_slave ? points.slave : points.master;
  PairingSide& facet_side = at_slave ? points.master : points.slave;
  // The facet's normal is outward of its own body: it points into the slave if the master has the
  // facet.
  const double sign = at_slave ? -1.0 : 1.0;
  const Nodes& nodes = at.nodes();
  points.reserve(points.size() + nodes.size());
  for (std::size_t k = 0; k < nodes.size(); ++k)
  {
    if (!found.found[k])
    {
      ++points.num_unpaired;
      continue;
    }
    append_node(node_side, nodes, k, points.gdim, at.rank());
    append_facet(facet_side, found, k, points.gdim);
    const auto at_k
        = [k](const std::vector<double>& v) { return facet_vertex(v, static_cast<int>(k)); };
    // Into the node, as the facet's normal.
    const Vec3 of_facet = at_k(found.normal), of_node = -1.0 * at_k(nodes.normal);
    const Vec3 sum = normals == Normals::facet ? of_facet : of_facet + of_node;
    const Vec3 n = (sign / norm(sum)) * sum;
    points.normal.insert(points.normal.end(), n.begin(), n.end());
    points.gap.push_back(sign * dot(n, at_k(nodes.x) - at_k(found.x)));
    points.weight.push_back(share * nodes.area[k]);
  }
}
} // namespace

void qsdolfinx::append_node(PairingSide& side, const Nodes& nodes, std::size_t k, int gdim,
                            int rank)
{
  append_record(side.x, nodes.x, k, 3);
  append_record(side.dofs, nodes.dofs, k, gdim);
  side.dofs.insert(side.dofs.end(), (side.num_nodes - 1) * gdim, -1);
  side.owner.push_back(rank);
  side.owner.insert(side.owner.end(), side.num_nodes - 1, -1);
  side.shape_values.push_back(1);
  side.shape_values.insert(side.shape_values.end(), side.num_nodes - 1, 0.0);
}

PairingPoints::PairingPoints(const Surface& s, const Surface* m)
    : gdim(s.gdim()), num_multipliers(s.num_vertices())
{
  if (m && s.gdim() != m->gdim())
    throw std::invalid_argument("slave and master have different geometric dimensions");
  slave.num_nodes = s.num_trace();
  master.num_nodes = m ? m->num_trace() : 0;
}

void PairingPoints::reserve(std::size_t n)
{
  for_each_array([n](auto& values, std::size_t width) { values.reserve(n * width); });
}

PairingPoints PairingPoints::scaled(std::span<const double> factor) const
{
  if (factor.size() != size())
    throw std::invalid_argument("one factor for each point");
  PairingPoints out = *this;
  std::ranges::transform(weight, factor, out.weight.begin(), std::multiplies<>());
  return out;
}

PairingPoints PairingPoints::none_like() const
{
  PairingPoints out;
  out.gdim = gdim;
  out.num_multipliers = num_multipliers;
  out.slave.num_nodes = slave.num_nodes;
  out.master.num_nodes = master.num_nodes;
  return out;
}

PairingPoints qsdolfinx::pair_surfaces(const Surface& slave, const Surface& master,
                                       Sampling sampling, double radius, Normals normals)
{
  if (slave.degree() != 1 || master.degree() != 1)
    throw std::invalid_argument("nodal pairing points need traces of degree 1");
  PairingPoints points(slave, &master);
  const double share = sampling == Sampling::both ? 0.5 : 1.0;
  append_nodal_points(points, slave, master, true, share, radius, normals);
  if (sampling == Sampling::both)
    append_nodal_points(points, master, slave, false, share, radius, normals);
  points.multiplier_values = points.slave.shape_values; // the trace is P1 or Q1
  points.multiplier_side.assign(points.multiplier_values.size(), 0);
  return points;
}
