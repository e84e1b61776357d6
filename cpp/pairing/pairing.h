// Pairing points: the contact quadrature points, with their weights, normals and initial gaps.
#pragma once

#include "search/search.h"
#include <cstdint>
#include <span>
#include <vector>

namespace qsdolfinx
{
struct Pieces;

/// One side of the pairing points: for each point the trace nodes of the facet on which it lies.
/// The vertices come first. A point at a node has a single node with value 1; the unused entries
/// have owner -1 and value 0.
struct PairingSide
{
  int num_nodes = 0;                ///< entries per point
  std::vector<double> x;            ///< position, [point][3]
  std::vector<std::int64_t> dofs;   ///< unknowns of the nodes, [point][node][block]
  std::vector<int> owner;           ///< their owners, [point][node]
  std::vector<double> shape_values; ///< trace functions, [point][node]
  /// Contributions of the nodes to a jump that is co-rotated with a facet,
  /// [point][node][block][block]; empty unless PairingPoints::turns.
  std::vector<double> turn;
};

/// Pairing points of one pass (one choice of the slave). Each point is on the rank that owns the
/// node or facet it comes from. The slave is the side that carries the multiplier, at the vertices
/// of its facets.
struct PairingPoints
{
  PairingPoints() = default;
  /// Create an empty set of points. @param master null for a rigid tool, which has no unknowns
  /// @throws std::invalid_argument on surfaces of different geometric dimension
  PairingPoints(const Surface& slave, const Surface* master);

  int gdim = 0;
  int block = 0;           ///< unknowns of a node
  int num_multipliers = 0; ///< vertices of a slave facet
  PairingSide slave, master;
  std::vector<double> multiplier_values;     ///< P1 or Q1 functions N_k, [point][slave vertex]
  std::vector<std::uint8_t> multiplier_side; ///< smooth side of the slave at the vertex,
                                             ///< [point][slave vertex]; 0 for nodal points that are
                                             ///< not in a corner
  int num_faced = 0;                         ///< vertices of a facet of a rigid tool; 0 without one
  std::vector<std::int64_t> faced;           ///< first numbers of the vertices of the tool's facet,
                                             ///< −1 for none, [point][vertex]
  std::vector<double> normal;                ///< outward of the slave, into the master, [point][3]
  std::vector<double> gap;    ///< signed distance (x_master - x_slave)·n, positive when open
  std::vector<double> weight; ///< area
  bool turns = false;         ///< whether jumps are co-rotated: both sides have `turn`; same on all
                              ///< ranks
  std::size_t num_of_slave
      = 0;                   ///< overlay: number of points on facets of the slave, which come first
  std::size_t num_alone = 0; ///< number of stand-alone points, which come last: one multiplier, no
                             ///< facet
  std::int64_t num_unpaired = 0; ///< owned nodes (overlay: facets) that found no partner
  /// Owned nodes of both surfaces that are in corners of the other one.
  std::int64_t num_corners = 0;
  /// Whether owned nodes of the slave may have a multiplier for each smooth side.
  bool by_sides = false;
  std::vector<std::uint8_t> in_corner; ///< whether the node has several multipliers, [node]; empty
                                       ///< if not by_sides
  std::vector<std::uint8_t> node_side; ///< for the other nodes, the side that faces the master,
                                       ///< [node]; empty likewise
  std::vector<double> side_area;       ///< areas of the sides of nodes in corners, [node][gdim];
                                       ///< empty likewise

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
    visit(faced, num_faced);
    visit(normal, 3);
    visit(gap, 1);
    visit(weight, 1);
  }
  /// Reserve memory for n points in total, so that appending does not allocate.
  void reserve(std::size_t n);
  /// Remove points. @param which whether a point is kept, [point]
  void keep(std::span<const std::uint8_t> which);
  /// Return an empty set of points with the same numbers of nodes and multipliers per point.
  PairingPoints none_like() const;
  /// Trace of another field on the same facets, which replaces that of one side.
  struct Trace
  {
    std::span<const std::int64_t> dofs;   ///< [point][node][block]
    std::span<const std::int32_t> owner;  ///< [point][node]
    std::span<const double> shape_values; ///< [point][node]
  };
  /// Return the same points for such a field, without corners. @param block unknowns of a node
  /// @throws std::invalid_argument on numbers of values that do not fit
  PairingPoints with_traces(int block, const Trace& slave, const Trace& master) const;
  /// Return the same points with jumps that are co-rotated with a facet. @param slave, master see
  /// PairingSide::turn
  /// @throws std::invalid_argument on numbers of values that do not fit
  PairingPoints turning(std::span<const double> slave, std::span<const double> master) const;
  /// Return the same points and some stand-alone points with no facet opposite, each of which has
  /// the multiplier of one side of a node.
  /// @param unknown unknown of the slave that represents the side, [point]
  /// @param added areas of the stand-alone points
  /// @param far their gap, positive (open)
  /// @throws std::invalid_argument on different numbers of them
  PairingPoints with_alone(std::span<const std::int64_t> unknown, std::span<const double> added,
                           double far) const;
  /// Return the same points with other weights. @param factor factors of the weights, [point]
  PairingPoints scaled(std::span<const double> factor) const;
};

/// Append a point at an owned node: the node itself is its only vertex.
void append_node(PairingSide& side, const Nodes& nodes, std::size_t k, int block, int rank);

/// Set the multiplier functions of points at nodes: each point belongs only to its node's
/// multiplier.
void append_own_multipliers(PairingPoints& points);

/// Normals along which the gap is measured.
enum class Normals
{
  facet,    ///< of the facet that was cut, or found closest to a node
  bisector, ///< bisector of the normals of both surfaces; at nodes, of the node and the facet
  master    ///< normal of the master, a rigid tool: that of its facet or of its node
};

/// Nodes at which the gap is sampled.
enum class Sampling
{
  slave_nodes, ///< master-slave, (5): every slave node k with w = S_k
  both         ///< quasi-symmetric, (11), (12): slave nodes with S_k/2 and master nodes with S_l/2
};

/// Compute the nodal pairing points of two surfaces. Collective.
/// @param normals choice of the normals n_p
/// @param radius nodes further than this from the other surface are unpaired
/// @param corners whether a node in the corner of several walls has a contact pair for each wall
/// and the side of the node that faces it, with the side's area; otherwise every node has one
/// contact pair
/// @throws std::invalid_argument on traces of degree 2, or as PairingPoints does
PairingPoints pair_surfaces(const Surface& slave, const Surface& master, Sampling sampling,
                            const SearchRadius& radius, Normals normals, bool corners);

/// Compute points at some vertices of the slave, with the closest points on the master and the
/// normals there. Collective.
/// @param which whether an owned node of the slave is used, [node]
/// @param radius as for pair_surfaces
/// @throws std::invalid_argument as PairingPoints does, or on another number of nodes
PairingPoints pair_vertices(const Surface& slave, const Surface& master,
                            std::span<const std::uint8_t> which, const SearchRadius& radius);

/// Compute points at vertices as pieces, for surfaces with updated geometry. Each piece has one
/// point, at a vertex, whose ray goes against the normal of the facet opposite. Its multiplier is
/// the first of its node, or, for vertices of the master, those of the nodes of the slave's facet.
/// Collective.
/// @param of_master whether the vertices are the master's
/// @param which, weight whether an owned node of that surface is used, and its area, [node]
Pieces vertex_pieces(const Surface& slave, const Surface& master, bool of_master,
                     std::span<const std::uint8_t> which, std::span<const double> weight,
                     const SearchRadius& radius);

/// One side of points with given positions.
struct OnFacets
{
  std::span<const double> x;            ///< positions, [point][3]
  std::span<const std::int64_t> dofs;   ///< unknowns, [point][node][block]
  std::span<const int> owner;           ///< their owners, [point][node]
  std::span<const double> shape_values; ///< trace functions, [point][node]
};

/// Create points from given positions on the slave and on the master. Local.
/// @param master null for a rigid tool, for which only positions are used
/// @param multiplier_values functions of the multipliers, [point][slave vertex]
/// @param side number of the multiplier at each vertex that the point uses (elsewhere that of a
/// smooth side), [point]
/// @param normal outward of the slave, [point][3] @param gap signed distances @param weight areas
/// @throws std::invalid_argument on numbers of values that do not fit
PairingPoints points_between(const Surface& slave, const Surface* master, const OnFacets& on_slave,
                             const OnFacets& on_master, std::span<const double> multiplier_values,
                             std::span<const std::uint8_t> side, std::span<const double> normal,
                             std::span<const double> gap, std::span<const double> weight);

} // namespace qsdolfinx
