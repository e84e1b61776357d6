// The weighted gap as a distributed linear operator: g = G_s u_s + G_m u_m - d.
#pragma once

#include "pairing/pairing.h"
#include <array>
#include <petscmat.h>
#include <petscvec.h>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Quantity that is weighted: the normal part of the jump (the relative displacement u_s - u_m)
/// less the initial gap, or the whole jump.
enum class GapKind
{
  normal, ///< one value per row: ḡ_k = (1/S_k) Σ w_p N_k(ξ_p) [(u_s - u_m)·n_p - δ_p]
  jump    ///< block values per row: (1/S_k) Σ w_p N_k(ξ_p) (u_s - u_m); co-rotated if
          ///< PairingPoints::turns
};

/// Rows of the operator (nodes or points), and the areas by which their gaps are divided.
enum class GapRows
{
  nodes,         ///< slave nodes with a pairing point; divided by S_k
  covered_nodes, ///< same nodes; divided by the covered part of S_k, Σ_p w_p N_k(ξ_p)
  points         ///< the pairing points; divided by w_p in place of S_k: no averaging
};

struct Pieces;
struct SlipOfPieces;
struct Slots;

/// Operator of the weighted gaps of the slave nodes that this rank owns, or of the gaps at the
/// pairing points of this rank. With rows at nodes there is one row per node with at least one
/// pairing point, in the order of the slave surface's nodes; a node in a corner has one row for
/// each of its smooth sides.
class GapOperator
{
public:
  /// Unknowns of one body that the rows of this rank use.
  struct Side
  {
    std::vector<PetscInt> dofs;       ///< global unknowns, [column node][block]
    std::vector<PetscInt> free_dofs;  ///< same as `dofs`, -1 where a Dirichlet condition holds
    std::vector<std::int64_t> offset; ///< entries of row i: [offset[i], offset[i + 1])
    std::vector<std::int32_t> column; ///< column node of each entry
    std::vector<double> coefficient;  ///< [entry][entry_size()]; master negative
    Vec local = nullptr;              ///< values at `dofs`; made when it is first used
    VecScatter scatter = nullptr;     ///< from the body's vector to `local`
  };

  /// Collective. @param master null for a rigid tool, which has no unknowns
  /// @param points pairing points, anywhere on the communicator
  GapOperator(const Surface& slave, const Surface* master, const PairingPoints& points,
              GapKind kind, GapRows rows);
  /// Derivative of the gaps of pieces with updated geometry, in the current configuration. The rays
  /// must have been solved. There is one row for each point on this rank, then one for each
  /// stand-alone point (`alone`), which has one multiplier and no facet. `initial_gap` is −g.
  /// @param master null for a rigid tool
  /// @param alone slave unknowns that represent the node sides of the stand-alone points, -1 for
  /// points that have no function of nodes
  /// @param weight areas of the stand-alone points
  /// @param far gap of the stand-alone points, positive (open)
  GapOperator(const Surface* master, const Pieces& pieces, std::span<const std::int64_t> alone,
              std::span<const double> weight, double far);
  /// Relative position x_slave − x_master for the same rows, with the points fixed on their facets.
  GapOperator(const Surface* master, const Pieces& pieces, std::span<const std::int64_t> alone,
              std::span<const double> weight);
  /// Derivative of the slip for the same rows, or the variation on which tractions do work.
  GapOperator(const Surface* master, const Pieces& pieces, const SlipOfPieces& slip, bool works,
              std::span<const double> weight);
  ~GapOperator();
  GapOperator(const GapOperator&) = delete;
  GapOperator& operator=(const GapOperator&) = delete;

  GapKind kind() const { return kind_; }
  /// Unknowns of a node: gdim, or 1 of a scalar field.
  int block() const { return block_; }
  /// Values per row: 1, or block() for a jump.
  int width() const { return kind_ == GapKind::normal ? 1 : block_; }
  std::size_t num_rows() const { return row_area_.size(); }
  /// Whether the jump is co-rotated with facets. Each of its components then has columns for all
  /// unknowns of a node.
  bool turns() const { return turns_; }
  /// Number of coefficients of an entry: one for each unknown of the node for the normal part, one
  /// for all components of a jump, or a matrix [component][unknown] for a co-rotated jump.
  std::size_t entry_size() const
  {
    const auto d = static_cast<std::size_t>(block_);
    return kind_ == GapKind::normal ? d : turns_ ? d * d : 1;
  }
  /// Index of each row's node in the slave surface's nodes; empty if rows are points.
  const std::vector<std::int64_t>& row_node() const { return row_node_; }
  /// Smooth side of the slave at the row's node: the side that the row belongs to if the node is in
  /// a corner, otherwise the side that faces the master. Empty if sides are not distinguished, as
  /// with rows at points.
  const std::vector<std::uint8_t>& row_side() const { return row_side_; }
  /// Whether the row's node is in a corner and may have several rows. Empty if sides are not
  /// distinguished.
  const std::vector<std::uint8_t>& row_in_corner() const { return row_in_corner_; }
  /// Area by which each row's gap is divided: S_k, its covered part, or w_p.
  const std::vector<double>& row_area() const { return row_area_; }
  /// Initial weighted gap d of each row (zero for a jump).
  const std::vector<double>& initial_gap() const { return initial_gap_; }
  /// Sum of the slave's coefficients of each row: for the normal part the mean normal times the
  /// covered part of the row's area, [row][gdim]; for the jump this covered part itself, [row].
  std::vector<double> slave_sum() const;
  /// Sides with unknowns: 2, or 1 if the master is rigid.
  int num_sides() const { return num_sides_; }
  /// 0: slave, 1: master.
  const Side& side(int i) const { return sides_[i]; }
  /// N_k at the points. The columns are components of a nodal field, one component for each smooth
  /// side of a node. Empty if rows are not points.
  const Side& multipliers() const { return multipliers_; }

  /// Linear part G_s u_s + G_m u_m, [row][width]. Collective.
  /// @param x vectors of the two bodies; the vector of a rigid master is ignored
  /// @param scale displacement per unknown of each body: u = scale · x
  std::vector<double> apply(std::array<Vec, 2> x, std::array<double, 2> scale);
  /// b += Gᵀ f on both bodies. Collective. @param f [row][width]
  void add_transpose(std::span<const double> f, std::array<Vec, 2> b);
  /// Σ_k N_k(ξ_p) v_k at the points, [row]. v_k is a component of the field at a slave node; its
  /// number is that of the point's smooth side at the node. Collective. Only if rows are points.
  std::vector<double> at_points(Vec nodal);
  /// Add Σ_p N_k(ξ_p) f_p to the components that at_points() reads. Collective. Only if rows are
  /// points.
  /// @param f [row]
  void add_to_nodes(std::span<const double> f, Vec nodal);
  /// Raise the components that at_points() reads to the largest f_p of the points with
  /// N_k(ξ_p) ≠ 0, if it exceeds their value. Collective. Only if rows are points.
  /// @param f [row]
  void raise_nodes(std::span<const double> f, Vec nodal);
  /// Set the unknowns with Dirichlet conditions: the nonzero entries of the markers. Collective.
  void constrain(std::array<Vec, 2> markers);

private:
  /// Initialise without rows and scatters. @param weight areas of the stand-alone points
  GapOperator(const Surface* master, const Pieces& pieces, GapKind kind,
              std::span<const double> weight);
  std::span<Side> used_sides()
  {
    return std::span(sides_).first(static_cast<std::size_t>(num_sides_));
  }
  void build_rows(const Surface& slave, const std::array<const PairingPoints*, 2>& sets,
                  bool by_cover);
  void name_rows(const PairingPoints& points, const Slots& slots,
                 std::span<const std::size_t> row_slot);
  void build_points(const PairingPoints& points);
  /// Call visit(value of a node, N_k, f_p) for all N_k at all points, then send the values of the
  /// nodes to their owners.
  template <typename Visit>
  void reduce_to_nodes(std::span<const double> f, Vec nodal, double start, InsertMode mode,
                       Visit visit);

  GapKind kind_;
  int block_, num_sides_;
  bool turns_ = false;
  std::vector<std::int64_t> row_node_;
  std::vector<std::uint8_t> row_side_, row_in_corner_;
  std::vector<double> row_area_, initial_gap_;
  std::array<Side, 2> sides_;
  Side multipliers_; ///< N_k at the points, if these are the rows
};

} // namespace qsdolfinx
