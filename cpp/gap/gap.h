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

/// What is weighted: the normal part of the jump, less the initial gap, or the whole jump.
enum class GapKind
{
  normal, ///< one value a row: ḡ_k = (1/S_k) Σ w_p N_k(ξ_p) [(u_s - u_m)·n_p - δ_p]
  jump    ///< block values a row: (1/S_k) Σ w_p N_k(ξ_p) (u_s - u_m), and what turns, if it does
};

/// What the rows of the operator are, and what their gaps are divided by.
enum class GapRows
{
  nodes,         ///< slave nodes with a pairing point; S_k
  covered_nodes, ///< the same; what the points cover of S_k, Σ_p w_p N_k(ξ_p)
  points         ///< the pairing points, w_p taking the place of S_k: nothing is averaged
};

struct FunctionsOfPieces;
struct Pieces;
struct Slots;

/// Weighted gaps of the slave nodes that this rank owns, one row per node with at least one pairing
/// point, in the order of the slave surface's nodes, or in corners one for each side of the node;
/// or gaps of the pairing points of this rank.
class GapOperator
{
public:
  /// Unknowns of one body that the rows of this rank use.
  struct Side
  {
    std::vector<PetscInt> dofs;       ///< global unknowns, [column node][block]
    std::vector<PetscInt> free_dofs;  ///< the same, -1 where a Dirichlet condition holds
    std::vector<std::int64_t> offset; ///< entries of row i: [offset[i], offset[i + 1])
    std::vector<std::int32_t> column; ///< column node of each entry
    std::vector<double> coefficient;  ///< [entry][entry_size()]; master negative
    Vec local = nullptr;              ///< values at `dofs`
    VecScatter scatter = nullptr;     ///< from the body's vector to `local`
  };

  /// Collective. @param master null for a rigid tool, which has no unknowns
  /// @param points pairing points, anywhere on the communicator
  GapOperator(const Surface& slave, const Surface* master, const PairingPoints& points,
              GapKind kind, GapRows rows);
  /// Derivative of the gaps of pieces that follow the bodies, at where they are and rays have been
  /// solved for: a row for each point on this rank, and for some that are alone: each sees one
  /// multiplier, and no facet. `initial_gap` is −g. Collective.
  /// @param alone unknowns of the slave that stand for their sides of nodes @param weight their
  /// areas @param far their gaps, open
  GapOperator(const Surface& slave, const Surface* master, const Pieces& pieces,
              std::span<const std::int64_t> alone, std::span<const double> weight, double far);
  /// x_slave − x_master at the same rows, with places on the facets that stay. Collective.
  GapOperator(const Surface& slave, const Surface* master, const Pieces& pieces,
              std::span<const std::int64_t> alone, std::span<const double> weight);
  /// Derivative of the gaps with what points move by on the facets, at the same rows. Collective.
  GapOperator(const Surface& slave, const Surface* master, const Pieces& pieces,
              std::span<const double> weight);
  /// Of other gradients at the same rows, see point_rows.h. Collective.
  GapOperator(const Surface& slave, const Surface* master, const Pieces& pieces,
              const FunctionsOfPieces& functions, std::span<const double> weight);
  /// Derivative of the slip at the same rows, or what tractions work on there. Collective.
  GapOperator(const Surface& slave, const Surface* master, const Pieces& pieces,
              const std::vector<double>& gradient, std::span<const double> weight);
  ~GapOperator();
  GapOperator(const GapOperator&) = delete;
  GapOperator& operator=(const GapOperator&) = delete;

  GapKind kind() const { return kind_; }
  /// Unknowns of a node: gdim, or 1 of a scalar field.
  int block() const { return block_; }
  /// Values per row: 1, or those of a node for a jump.
  int width() const { return kind_ == GapKind::normal ? 1 : block_; }
  std::size_t num_rows() const { return row_area_.size(); }
  /// Whether a jump turns with facets: its components have columns of all unknowns of a node.
  bool turns() const { return turns_; }
  /// Coefficients of an entry: of the node's unknowns for the normal part, one for all components
  /// of a jump, or a matrix [component][unknown] if it turns.
  std::size_t entry_size() const
  {
    const auto d = static_cast<std::size_t>(block_);
    return kind_ == GapKind::normal ? d : turns_ ? d * d : 1;
  }
  /// Index of each row's node in the slave surface's nodes; empty if rows are points.
  const std::vector<std::int64_t>& row_node() const { return row_node_; }
  /// Smooth side of the slave that the row stands for at its node, if this is in a corner;
  /// otherwise the side that looks at the master. Empty if there are no sides to tell apart, as at
  /// points.
  const std::vector<std::uint8_t>& row_side() const { return row_side_; }
  /// Whether the row's node is in a corner, and may have several rows; likewise.
  const std::vector<std::uint8_t>& row_in_corner() const { return row_in_corner_; }
  /// What each row's gap is divided by: S_k, its covered part, or w_p.
  const std::vector<double>& row_area() const { return row_area_; }
  /// Initial weighted gap d of each row (zero for a jump).
  const std::vector<double>& initial_gap() const { return initial_gap_; }
  /// Sum of the slave's coefficients of each row: for the normal part the mean normal times what is
  /// covered of the row's area, [row][gdim]; for the jump that part itself, [row].
  std::vector<double> slave_sum() const;
  /// Sides with unknowns: 2, or 1 if the master is rigid.
  int num_sides() const { return num_sides_; }
  /// 0: slave, 1: master.
  const Side& side(int i) const { return sides_[i]; }
  /// N_k at the points, of a component for each side of a node; empty if rows are not points.
  const Side& multipliers() const { return multipliers_; }

  /// Linear part G_s u_s + G_m u_m, [row][width]. Collective.
  /// @param x vectors of the two bodies; a rigid one's is ignored
  /// @param scale displacement per unknown of each of them: u = scale · x
  std::vector<double> apply(std::array<Vec, 2> x, std::array<double, 2> scale);
  /// b += Gᵀ f on both bodies. Collective. @param f [row][width]
  void add_transpose(std::span<const double> f, std::array<Vec, 2> b);
  /// Σ_k N_k(ξ_p) v_k at the points, [row]. v_k is a component at a node of the slave: that with
  /// the number of the point's smooth side there. Collective; of rows that are points.
  std::vector<double> at_points(Vec nodal);
  /// Σ_p N_k(ξ_p) f_p in these components, added. Collective; as above. @param f [row]
  void add_to_nodes(std::span<const double> f, Vec nodal);
  /// Largest f_p of the points with N_k(ξ_p) ≠ 0 in these components, if it exceeds what is
  /// there. Collective; as above. @param f [row]
  void raise_nodes(std::span<const double> f, Vec nodal);
  /// Say which unknowns carry Dirichlet conditions: nonzero entries of the markers. Collective.
  void constrain(std::array<Vec, 2> markers);

private:
  /// Without rows yet, and scatters. @param weight of points that are alone
  GapOperator(const Surface* master, const Pieces& pieces, GapKind kind,
              std::span<const double> weight);
  std::span<Side> used_sides()
  {
    return std::span(sides_).first(static_cast<std::size_t>(num_sides_));
  }
  void build_scatters(const Surface& slave, const Surface* master);
  void build_rows(const Surface& slave, const std::array<const PairingPoints*, 2>& sets,
                  bool by_cover);
  void name_rows(const PairingPoints& points, const Slots& slots,
                 std::span<const std::size_t> row_slot);
  void build_points(const PairingPoints& points);
  /// visit(value of a node, N_k, f_p) for all N_k at all points, then to the nodes' owners.
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
