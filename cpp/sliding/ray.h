// Gaps along rays from fixed points of one facet to another, and their derivatives by the nodes of
// both. No MPI.
#pragma once

#include "geometry/facet.h"

#include <array>
#include <span>

namespace qsdolfinx
{

/// A facet at its present place.
struct RayFacet
{
  FacetType type;
  int degree;                ///< of its trace functions, 1 or 2
  std::span<const double> x; ///< its trace nodes, [node][3]; in 2D z = 0
  double orientation;        ///< 1 or −1: the area vector times it points out of the body

  int num_vertices() const { return static_cast<int>(type); }
  int num_nodes() const { return trace_size(type, degree); }
};

/// Two facets. Rays leave the one that is cut, along its normal n, and end on the other one. n is
/// constant on the facet, that of its vertices at its centre. Or rays go against the normal of the
/// other facet: from vertices, whose own facets look elsewhere.
struct RayPair
{
  RayFacet cut, other;
  bool cut_is_slave;
  bool along_other = false; ///< whether rays go against the other facet's normal
  /// Of a curved surface that the other facet stands for, at its vertices: the slope towards
  /// another vertex, times the length of that edge, [vertex][vertex]; empty of the facet itself.
  std::span<const double> rise{};
  std::span<const double> rise_normal{}; ///< normals that it has there, 0 for none, [vertex][3]

  /// The facet whose normal they go along.
  RayFacet along() const
  {
    return along_other ? RayFacet{other.type, other.degree, other.x, -other.orientation} : cut;
  }
  const RayFacet& slave() const { return cut_is_slave ? cut : other; }
  /// Number of nodes of both. The slave's come first.
  int num_nodes() const { return cut.num_nodes() + other.num_nodes(); }
};

/// Height of a curved surface above the other facet, outward, and its derivatives by ζ: cubic along
/// edges, with the slopes at vertices that are given, h = Σ_ij s_ij N_i² N_j. Rays along the
/// facet's normal that end on the facet pass the curved surface at t − h.
struct RayLift
{
  double height = 0;
  std::array<double, 2> slope{};
  std::array<double, 3> bending{}; ///< [∂₁∂₁, ∂₁∂₂, ∂₂∂₂]
};
RayLift lift_of(const RayPair& pair, const std::array<double, 2>& zeta);

/// Where a ray begins and ends.
struct RayPoint
{
  std::array<double, 2> xi;   ///< on the facet that is cut; fixed
  std::array<double, 2> zeta; ///< on the other one
  double weight;              ///< area; fixed
  double t = 0;               ///< length along n: the gap is g = −t, positive in penetration
};

/// Find the ends: ζ and t, from the ζ that is given. All that follows needs them.
/// @return whether all are found; t is not a number where one is not
bool solve_rays(const RayPair& pair, std::span<RayPoint> points);

/// The slave's outward normal where rays leave.
Vec3 normal_of(const RayPair& pair);

/// Gradient of the slave's outward normal where rays leave. @param out [component][node][3]
void normal_gradient(const RayPair& pair, std::span<double> out);

/// Gradients of the gaps of single points, ξ fixed. @param out [point][node][3]
void gap_gradients(const RayPair& pair, std::span<const RayPoint> points, std::span<double> out);

/// Derivatives of the gaps by ξ, nodes fixed. @param out [point][2]
void gap_slopes(const RayPair& pair, std::span<const RayPoint> points, std::span<double> out);

/// The same of the slave's vertex functions. @param out [point][k][2]
void function_slopes(const RayPair& pair, std::span<const RayPoint> points, std::span<double> out);

/// Gradients of the slave's vertex functions at points by the nodes of both: none if the slave is
/// cut. @param out [point][k][node][3]
void function_gradients(const RayPair& pair, std::span<const RayPoint> points,
                        std::span<double> out);

/// Add Σ_p w_p p_p ∂²g_p, ξ and w fixed. What is added is symmetric to the last bit.
/// @param pressure p_p, [point] @param hessian [node][3][node][3]
void add_curvature_of_points(const RayPair& pair, std::span<const RayPoint> points,
                             std::span<const double> pressure, std::span<double> hessian);

/// Places of the nodes of both facets when slip began, [node][3].
struct RayStart
{
  std::span<const double> cut, other;
};

/// Slip of the slave against the master at points, and its derivatives. Where a point and the end
/// of its ray were when slip began, d₀ was between them, and now nothing is but the ray along n:
/// the tangential part of −d₀ (master to slave) is the slip, by the frame of the facet that is cut,
/// which turns with it. Rigid motions of both have none. That is a chord of the way along the
/// facets where these turn against each other: by θ, so that an arc is θ/sin θ times as long.
struct RaySlip
{
  std::span<double> slip;     ///< [point][3]
  std::span<double> normal;   ///< n, outward of the slave, [point][3]
  std::span<double> gradient; ///< by the nodes of both, ξ fixed, [point][node][3][3]; rows: slip
  std::span<double> works;    ///< what tractions work on: Σ a_α δζ_α of the end, likewise
  std::span<double> slope;    ///< of the slip by ξ, nodes fixed, [point][2][3]
  std::span<double> arc;      ///< θ/sin θ, [point]
  std::span<double> gap;      ///< d₀ along n as it was then, positive in penetration, [point]
};
void slip_of_points(const RayPair& pair, const RayStart& start, std::span<const RayPoint> points,
                    const RaySlip& out);

/// Add the derivative of Σ_p w_p τ_p·(what it works on), tractions held, ξ and w fixed.
/// @param traction τ_p, [point][3] @param hessian [node][3][node][3], rows are those of the slip's
/// variation; not symmetric
void add_slip_curvature_of_points(const RayPair& pair, std::span<const RayPoint> points,
                                  std::span<const double> traction, std::span<double> hessian);

} // namespace qsdolfinx
