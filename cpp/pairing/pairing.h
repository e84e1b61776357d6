// Pairing points: where the gap is sampled, with which weight, normal and initial distance.
#pragma once

#include "search/search.h"
#include <cstdint>
#include <span>
#include <vector>

namespace qsdolfinx
{
struct Pieces;

/// One side of the pairing points: the facet a point lies on, by the nodes of the body's trace
/// there. The vertices come first. A point at a node has one node with value 1; the unused places
/// have owner -1 and value 0.
struct PairingSide
{
  int num_nodes = 0;                ///< places per point
  std::vector<double> x;            ///< position, [point][3]
  std::vector<std::int64_t> dofs;   ///< unknowns of the nodes, [point][node][block]
  std::vector<int> owner;           ///< their owners, [point][node]
  std::vector<double> shape_values; ///< trace functions, [point][node]
  /// What the nodes add to a jump that turns with a facet, [point][node][block][block]; empty
  /// unless PairingPoints::turns.
  std::vector<double> turn;
};

/// Pairing points of one pass, on the rank that owns the node or facet each of them comes from. The
/// slave is the side that carries the multiplier, at the vertices of its facets.
struct PairingPoints
{
  PairingPoints() = default;
  /// No points yet. @param master null for a rigid tool, which has no unknowns
  /// @throws std::invalid_argument on surfaces of different geometric dimension
  PairingPoints(const Surface& slave, const Surface* master);

  int gdim = 0;
  int block = 0;           ///< unknowns of a node
  int num_multipliers = 0; ///< vertices of a slave facet
  PairingSide slave, master;
  std::vector<double> multiplier_values;     ///< P1 or Q1 functions N_k, [point][slave vertex]
  std::vector<std::uint8_t> multiplier_side; ///< smooth side of the slave there, likewise; of nodes
                                             ///< as of facets in a corner, otherwise 0
  std::vector<double> normal;                ///< outward of the slave, into the master, [point][3]
  std::vector<double> gap;    ///< signed distance (x_master - x_slave)·n, positive when open
  std::vector<double> weight; ///< area
  bool turns = false;         ///< whether jumps have `turn` of both sides, the same on all ranks
  std::size_t num_of_slave
      = 0;                   ///< overlay: the first ones, on facets of the slave; then the master's
  std::size_t num_alone = 0; ///< the last ones: each sees one multiplier, and no facet
  std::int64_t num_unpaired = 0; ///< owned nodes (overlay: facets) that found no partner
  /// Owned nodes of both surfaces that are in corners of the other one.
  std::int64_t num_corners = 0;
  /// Whether owned nodes of the slave may have a multiplier for each smooth side.
  bool by_sides = false;
  std::vector<std::uint8_t> in_corner; ///< whether they do, [node]; empty if not by_sides
  std::vector<std::uint8_t> node_side; ///< side of the others that looks at the master, likewise
  std::vector<double> side_area;       ///< areas of sides in corners, [node][gdim], likewise

  std::size_t size() const { return weight.size(); }
  /// Call visit(array, width) for all arrays, of `width` values per point.
  template <typename Visit>
  void for_each_array(Visit visit)
  {
    for (PairingSide* side : {&slave, &master})
    {
      const std::size_t nodes = side->num_nodes;
      visit(side->x, 3);
      visit(side->dofs, nodes * block);
      visit(side->owner, nodes);
      visit(side->shape_values, nodes);
    }
    visit(multiplier_values, num_multipliers);
    visit(multiplier_side, num_multipliers);
    visit(normal, 3);
    visit(gap, 1);
    visit(weight, 1);
  }
  /// Room for n points in all, so that appending allocates nothing.
  void reserve(std::size_t n);
  /// Forget points. @param which are kept, [point]
  void keep(std::span<const std::uint8_t> which);
  /// No points, but with as many places in each.
  PairingPoints none_like() const;
  /// What another field on the same facets has in the place of a side's.
  struct Trace
  {
    std::span<const std::int64_t> dofs;   ///< [point][node][block]
    std::span<const std::int32_t> owner;  ///< [point][node]
    std::span<const double> shape_values; ///< [point][node]
  };
  /// The same points for such a field, without corners. @param block unknowns of a node
  /// @throws std::invalid_argument on numbers of values that do not fit
  PairingPoints with_traces(int block, const Trace& slave, const Trace& master) const;
  /// The same points with jumps that turn with a facet. @param slave, master see PairingSide::turn
  /// @throws std::invalid_argument on numbers of values that do not fit
  PairingPoints turning(std::span<const double> slave, std::span<const double> master) const;
  /// The same points, and some that see the multiplier of one side of a node each, where nothing is
  /// opposite. @param unknown of the slave, stands for the side, [point] @param added areas
  /// @param far gaps, open
  /// @throws std::invalid_argument on different numbers of them
  PairingPoints with_alone(std::span<const std::int64_t> unknown, std::span<const double> added,
                           double far) const;
  /// The same points with other weights. @param factor by which they are multiplied, [point]
  PairingPoints scaled(std::span<const double> factor) const;
};

/// Append a point at an owned node: the node itself is its only vertex.
void append_node(PairingSide& side, const Nodes& nodes, std::size_t k, int block, int rank);

/// Let each point, at a node, belong to that node's multiplier alone.
void append_own_multipliers(PairingPoints& points);

/// Which normals the gap is measured along.
enum class Normals
{
  facet,    ///< of the facet that was cut, or found closest to a node
  bisector, ///< bisecting the normals of both surfaces; of the node and the facet
  master    ///< the master's, a rigid tool's: its facet's, or its node's
};

/// Which nodes sample the gap.
enum class Sampling
{
  slave_nodes, ///< master-slave, (5): every slave node k with w = S_k
  both         ///< quasi-symmetric, (11), (12): slave nodes with S_k/2 and master nodes with S_l/2
};

/// Nodal pairing points of two surfaces. Collective.
/// @param normals which normals n_p are
/// @param radius nodes further than this from the other surface are unpaired
/// @param corners whether a node in the corner of several walls has a pair for each of them and the
/// side of the node that faces it, with the side's area; otherwise every node has one pair
/// @throws std::invalid_argument on traces of degree 2, or as PairingPoints does
PairingPoints pair_surfaces(const Surface& slave, const Surface& master, Sampling sampling,
                            const SearchRadius& radius, Normals normals, bool corners);

/// Points at vertices of the slave alone, with the closest places on the master and the normals
/// there. Collective.
/// @param which of its owned nodes, [node]
/// @param radius as for pair_surfaces
/// @throws std::invalid_argument as PairingPoints does, or on another number of nodes
PairingPoints pair_vertices(const Surface& slave, const Surface& master,
                            std::span<const std::uint8_t> which, const SearchRadius& radius);

/// The same as pieces of surfaces that follow their bodies: each is a point at a vertex, whose ray
/// goes against the normal of the facet opposite. Its multiplier is the first of its node's, or of
/// the nodes of the slave's facet. Collective.
/// @param of_master whether they are the master's vertices
/// @param which, weight of the owned nodes of that surface, and their areas, [node]
Pieces vertex_pieces(const Surface& slave, const Surface& master, bool of_master,
                     std::span<const std::uint8_t> which, std::span<const double> weight,
                     const SearchRadius& radius);

/// One side of points whose places are known.
struct OnFacets
{
  std::span<const double> x;            ///< positions, [point][3]
  std::span<const std::int64_t> dofs;   ///< unknowns, [point][node][block]
  std::span<const int> owner;           ///< their owners, [point][node]
  std::span<const double> shape_values; ///< trace functions, [point][node]
};

/// Points between places of the slave and of the master that are known. Local.
/// @param master null for a rigid tool, of which only positions count
/// @param multiplier_values functions of the multipliers, [point][slave vertex]
/// @param side which of a vertex' multipliers, that of a smooth side elsewhere, [point]
/// @param normal outward of the slave, [point][3] @param gap signed distances @param weight areas
/// @throws std::invalid_argument on numbers of values that do not fit
PairingPoints points_between(const Surface& slave, const Surface* master, const OnFacets& on_slave,
                             const OnFacets& on_master, std::span<const double> multiplier_values,
                             std::span<const std::uint8_t> side, std::span<const double> normal,
                             std::span<const double> gap, std::span<const double> weight);

} // namespace qsdolfinx
