// Pairing points: where the gap is sampled, with which weight, normal and initial distance.
#pragma once

#include "search.h"
#include <cstdint>
#include <vector>

namespace qsdolfinx
{

/// One side of the pairing points: the facet a point lies on, by its vertices. A point at a node
/// has one vertex with value 1; the unused places have owner -1 and value 0.
struct PairingSide
{
  int num_vertices = 0;             ///< places per point
  std::vector<double> x;            ///< position, [point][3]
  std::vector<std::int64_t> dofs;   ///< unknowns of the vertices, [point][vertex][gdim]
  std::vector<int> owner;           ///< their owners, [point][vertex]
  std::vector<double> shape_values; ///< shape functions, [point][vertex]
};

/// Pairing points of one pass, on the rank that owns the node each of them comes from. The slave is
/// the side that carries the multiplier.
struct PairingPoints
{
  int gdim = 0;
  PairingSide slave, master;
  std::vector<double> normal;    ///< outward of the slave, into the master, [point][3]
  std::vector<double> gap;       ///< signed distance (x_master - x_slave)·n, positive when open
  std::vector<double> weight;    ///< area
  std::int64_t num_unpaired = 0; ///< owned nodes of the searched side(s) without a partner

  std::size_t size() const { return weight.size(); }
};

/// Which nodes sample the gap.
enum class Sampling
{
  slave_nodes, ///< master-slave, (5): every slave node k with w = S_k
  both         ///< quasi-symmetric, (11), (12): slave nodes with S_k/2 and master nodes with S_l/2
};

/// Nodal pairing points of two surfaces. Collective.
/// @param radius nodes further than this from the other surface are unpaired
/// @throws std::invalid_argument on surfaces of different geometric dimension
PairingPoints pair_surfaces(const Surface& slave, const Surface& master, Sampling sampling,
                            double radius);

} // namespace qsdolfinx
