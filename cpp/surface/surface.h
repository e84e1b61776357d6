// A distributed surface: facets on the ranks that own their cells, nodes on the ranks that own
// their unknowns.
#pragma once

#include "geometry/boxes.h"
#include "geometry/facet.h"
#include "parallel/exchange.h"
#include <cstdint>
#include <memory>
#include <mpi.h>
#include <numbers>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Facets of a contact surface on this rank. Every facet is on exactly one rank (its cell's owner);
/// its vertices may be owned by other ranks. The nodes of the trace on a facet are its vertices,
/// then, for degree 2, those of trace_functions.
struct Facets
{
  std::vector<double> x;                 ///< vertex coordinates, [facet][vertex][3]
  std::vector<std::int64_t> dofs;        ///< global unknowns of the trace, [facet][node][block]
  std::vector<int> owner;                ///< rank that owns the unknowns, [facet][node]
  std::vector<std::int64_t> vertex_dofs; ///< the part of `dofs` at vertices, [facet][vertex][block]
  std::vector<int> vertex_owner;         ///< owners of `vertex_dofs`, [facet][vertex]
  std::vector<double> orientation;       ///< ±1, times the area vector points outward
  std::vector<double> size;              ///< largest distance of two vertices
  std::vector<std::uint8_t> edge_on_boundary;   ///< edge belongs to one facet only, [facet][edge]
  std::vector<std::uint8_t> vertex_on_boundary; ///< vertex touches such an edge, [facet][vertex]
  /// Number of the smooth side of the surface, at the vertex, to which the facet belongs, below
  /// gdim; 0 where there is no sharp edge. Determined in the initial configuration. [facet][vertex]
  std::vector<std::uint8_t> vertex_side;
  /// Coordinates of all nodes of the trace, [facet][node][3], for surfaces with updated geometry.
  std::vector<double> trace_x;
};

/// Nodes of a contact surface whose unknowns this rank owns, in ascending order of `dofs`. This
/// rank need not have any facet at them.
struct Nodes
{
  std::vector<std::int64_t> dofs; ///< global unknowns, [node][block]
  std::vector<double> x;          ///< coordinates, [node][3]
  std::vector<double> area;       ///< nodal area S_k = ∫ N_k ds
  std::vector<double> normal;     ///< outward unit normal, average weighted with N_k, [node][3]
  std::vector<double> facet_size; ///< of the largest facet at the node

  std::size_t size() const { return area.size(); }
};

/// Smooth sides of the nodes on sharp edges whose unknowns this rank owns.
struct Sides
{
  std::vector<std::size_t> node;  ///< index into the surface's nodes, ascending, [entry]
  std::vector<std::uint8_t> side; ///< as Facets::vertex_side, [entry]
  Nodes at;                       ///< areas and normals of the single sides; without dofs, [entry]
  std::vector<double> inward;     ///< from the node to the middle of the side's facets, [entry][3]
};

/// Cosine of the angle by which normals of neighbouring facets at a node may differ within one
/// smooth side, a little more than 30° whatever the rounding. Facets with a larger difference are
/// beyond a sharp edge.
inline constexpr double smooth_cosine = 0.866025;

/// The boxes of all ranks. Collective.
std::vector<Box> boxes_of_ranks(MPI_Comm comm, const Box& box);

/// Number of values in a facet's key, which describes the facet when the self-contact was made: its
/// outward normal, its middle, and 1 if the place just outside of the middle was free, 0 if it was
/// within the body.
inline constexpr std::size_t key_size = 7;

/// Contact surface of one body.
class Surface
{
public:
  /// Collective. Arrays are row-major, one entry per facet of this rank.
  /// @param comm communicator, duplicated
  /// @param gdim geometric dimension, 2 or 3
  /// @param block unknowns of a node: gdim, or 1 of a scalar field
  /// @param type shape of all facets
  /// @param x vertex coordinates, [facet][vertex][3]
  /// @param degree of the trace, 1 or 2
  /// @param dofs global unknowns of the trace, [facet][node][block]
  /// @param owner rank that owns the unknowns of a node, [facet][node]
  /// @param inside a point of the body behind the facet, [facet][3]
  /// @param local_size number of unknowns of the body that this rank owns
  /// @param axisymmetric coordinates are (r, z): facets represent rings, areas are 2πr times
  /// lengths
  /// @param touches_itself whether the surface is the whole boundary of a body in self-contact
  /// @param key for self-contact: values that determine the role of each facet, [facet][key_size],
  /// see pairing/roles.h; NaN for facets that take no part in contact, whose vertices are not nodes
  Surface(MPI_Comm comm, int gdim, int block, FacetType type, std::span<const double> x, int degree,
          std::span<const std::int64_t> dofs, std::span<const int> owner,
          std::span<const double> inside, std::int64_t local_size, bool axisymmetric,
          bool touches_itself = false, std::span<const double> key = {});
  ~Surface();
  /// Set new coordinates of the facets; collective. @param x, inside as in the constructor
  void move(std::span<const double> x, std::span<const double> inside);
  /// Set new coordinates of the trace nodes without updating areas and normals of nodes. The
  /// orientation of facets stays the same. Local. @param trace_x [facet][node][3]
  void follow(std::span<const double> trace_x);
  /// Compute areas and normals of the nodes for the coordinates set by follow(). Collective.
  void measure_nodes();
  /// Whether follow() has ever been called.
  bool follows() const { return follows_; }
  /// Values that determine the roles of facets in self-contact, [facet][key_size], NaN for facets
  /// that take no part in contact; empty without self-contact.
  const std::vector<double>& keys() const { return key_; }
  std::span<const double> key(std::size_t facet) const
  {
    return std::span(key_).subspan(facet * key_size, key_size);
  }
  /// Whether this is a surface for self-contact; same on all ranks.
  bool touches_itself() const { return touches_itself_; }
  Surface(const Surface&) = delete;
  Surface& operator=(const Surface&) = delete;

  MPI_Comm comm() const { return comm_; }
  int rank() const { return rank_; }
  int gdim() const { return gdim_; }
  /// Unknowns of a node: gdim, or 1 of a scalar field.
  int block() const { return block_; }
  FacetType type() const { return type_; }
  int num_vertices() const { return static_cast<int>(type_); }
  int degree() const { return degree_; }
  /// Area per unit length or area of a facet at x: 2πr for rings, otherwise 1.
  double area_factor(const Vec3& x) const
  {
    return axisymmetric_ ? 2 * std::numbers::pi * x[0] : 1.0;
  }
  bool axisymmetric() const { return axisymmetric_; }
  /// Nodes of the trace on a facet.
  int num_trace() const { return trace_size(type_, degree_); }
  std::size_t num_facets() const { return facets_.size.size(); }
  std::int64_t local_size() const { return local_size_; }
  const Facets& facets() const { return facets_; }
  const Nodes& nodes() const { return nodes_; }

  /// Coordinates of a facet's vertices.
  std::span<const double> facet_x(std::size_t facet) const
  {
    return std::span(facets_.x).subspan(facet * num_vertices() * 3, num_vertices() * 3);
  }
  /// Outward unit normal of a facet at ξ.
  Vec3 normal(std::size_t facet, std::array<double, 2> xi) const;
  /// Whether ξ lies on an edge or vertex of the facet that bounds the surface.
  bool on_surface_boundary(std::size_t facet, std::array<double, 2> xi) const;
  /// Tree of the boxes of this rank's facets, built in the first call.
  const BoxTree& tree() const { return tree_.of(type_, facets_.x); }
  /// Boxes around the facets of each rank, widened by the radius. Collective.
  std::vector<Box> rank_boxes(double radius) const;
  /// Smallest and largest size, over all ranks, of the facets that take part in contact.
  /// Collective.
  std::array<double, 2> facet_size_range() const;
  /// Whether there is a sharp edge on any rank.
  bool has_creases() const { return has_creases_; }
  /// Smooth sides of the owned nodes on sharp edges, in the current configuration. Collective.
  Sides sides() const;
  /// Facets::vertex_side at the chosen nodes, 0 at all others, [facet][vertex]. Collective.
  /// @param chosen flags of the owned nodes
  std::vector<std::uint8_t> sides_of_facets(std::span<const std::uint8_t> chosen) const;
  /// Index of the owned node with this first unknown. @throws std::logic_error if it is not here
  std::size_t node_index(std::int64_t first_dof) const;

private:
  void orient_and_measure(std::span<const double> inside);
  void number_nodes();
  /// Send the values of the vertices that are nodes to their owners. @param values [facet][vertex]
  template <typename T>
  std::vector<T> tell_owners(const std::vector<T>& values, int width) const
  {
    if (vertices_.size() == facets_.vertex_owner.size())
      return to_owner_->forward<T>(values, width);
    std::vector<T> some;
    some.reserve(vertices_.size() * width);
    for (std::size_t v : vertices_)
      some.insert(some.end(), values.begin() + static_cast<std::ptrdiff_t>(v * width),
                  values.begin() + static_cast<std::ptrdiff_t>((v + 1) * width));
    return to_owner_->forward<T>(some, width);
  }
  /// Send the owners' answers to tell_owners() back, [facet][vertex]; 0 for vertices that are not
  /// nodes.
  std::vector<std::uint8_t> answers_of_owners(const std::vector<std::uint8_t>& answers) const;
  void mark_boundary();
  void find_sides();

  MPI_Comm comm_;
  int rank_, gdim_, block_;
  FacetType type_;
  int degree_;
  bool axisymmetric_;
  std::int64_t local_size_;
  bool has_creases_ = false, follows_ = false, touches_itself_ = false;
  std::vector<double> key_;
  Facets facets_;
  Nodes nodes_;
  MovingTree tree_;                         ///< see tree()
  std::vector<std::size_t> vertices_;       ///< indices of the vertices of facets that take part in
                                            ///< contact
  std::unique_ptr<Exchange> to_owner_;      ///< from `vertices_` to their owners
  std::vector<std::size_t> node_of_record_; ///< node of each vertex that this rank has received
};

} // namespace qsdolfinx
