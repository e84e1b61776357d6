// Gaps along rays from fixed points of one facet to another facet, and their derivatives by the
// nodes of both facets. No MPI.
#pragma once

#include "geometry/facet.h"

#include <array>
#include <span>

namespace qsdolfinx
{

/// A facet in its current configuration.
struct RayFacet
{
  FacetType type;
  int degree;                ///< of its trace functions, 1 or 2
  std::span<const double> x; ///< its trace nodes, [node][3]; in 2D z = 0
  double orientation;        ///< 1 or −1: orientation times the area vector points out of the body

  int num_vertices() const { return static_cast<int>(type); }
  int num_nodes() const { return trace_size(type, degree); }
};

/// Two facets. Rays start on the facet that is cut, along its normal n, and end on the other facet.
/// n is constant on the facet: the normal at its centre, computed from its vertices. With
/// `along_other` rays go against the normal of the other facet instead; this is for rays from
/// vertices, whose own facets face elsewhere.
struct RayPair
{
  RayFacet cut, other;
  bool cut_is_slave;
  bool along_other = false; ///< whether rays go against the other facet's normal
  /// For forces along the normals of a curved surface over the other facet, at its vertices: the
  /// slope towards another vertex, times the length of that edge, [vertex][vertex]. Empty if
  /// normals are interpolated.
  std::span<const double> rise{};
  /// Its normals there, 0 if unknown, [vertex][3]. Empty if forces are along the normals of the
  /// facet itself.
  std::span<const double> rise_normal{};

  bool is_raised() const { return !rise_normal.empty(); }
  /// Whether the normals of the curved surface are interpolated: on facets of degree 1 in 3D.
  bool interpolates() const { return other.degree == 1 && other.type != FacetType::interval; }

  /// The facet whose normal is the direction of the rays.
  RayFacet along() const
  {
    return along_other ? RayFacet{other.type, other.degree, other.x, -other.orientation} : cut;
  }
  const RayFacet& slave() const { return cut_is_slave ? cut : other; }
  /// Number of nodes of both. The slave's come first.
  int num_nodes() const { return cut.num_nodes() + other.num_nodes(); }
};

/// Slopes by ζ of a curved surface above the other facet, outward, and their derivatives. Gaps are
/// those to the facet; forces are along the normal of the surface. In 2D, and on facets of degree
/// 2, the slopes are those of a height that is cubic along edges, h = Σ_ij s_ij N_i² N_j. Across an
/// edge in 3D the slopes of such heights jump; see rise.cpp for those of facets of degree 1.
struct RayLift
{
  std::array<double, 2> slope{};
  std::array<std::array<double, 2>, 2> bending{}; ///< [slope][by ζ]; not symmetric in 3D
};
RayLift lift_of(const RayPair& pair, const std::array<double, 2>& zeta);

/// Start and end of a ray.
struct RayPoint
{
  std::array<double, 2> xi;   ///< on the facet that is cut; fixed
  std::array<double, 2> zeta; ///< on the other facet
  double weight;              ///< area; fixed
  double t = 0;               ///< length along n: the gap is g = −t, positive in penetration
};

/// The rays of two facets with all that follows from their positions, see forms.h.
struct Rays;

/// Solve for the ends of the rays, ζ and t, starting from the given ζ. The functions below need
/// them.
/// @return whether all ends were found; t is NaN where the end was not found
bool solve_rays(const RayPair& pair, std::span<RayPoint> points);

/// The slave's outward normal, along the direction of the rays.
Vec3 normal_of(const RayPair& pair);

/// Gradient of the slave's outward normal, see normal_of. @param out [component][node][3]
void normal_gradient(const RayPair& pair, std::span<double> out);

/// Gradients of the gaps of single points, ξ fixed; with a curved surface those of h − t. @param
/// out [point][node][3]
void gap_gradients(const Rays& rays, std::span<double> out);

/// Positions of the nodes of both facets when slip began, [node][3].
struct RayStart
{
  std::span<const double> cut, other;
};

/// Slip of the slave against the master at points, and its derivatives. Let d₀ be the vector
/// between the material points at the start and at the end of a ray when slip began. Now only the
/// ray, −t n, is between them. With the rotation R of the frame of the facet that is cut, the slip
/// is the tangential part of −(d₀ + t R⁻¹n), rotated by R (master to slave). On curved facets this
/// is the part across the normal at the point: a gap that closes along it is no slip. Common rigid
/// motions of both facets cause no slip. If the facets rotate against each other by θ, the slip is
/// a chord of the path along the facets; the arc is θ/sin θ times as long.
struct RaySlip
{
  std::span<double> slip;   ///< [point][3]
  std::span<double> normal; ///< n, outward of the slave, [point][3]
  std::span<double> slides; ///< gradient of the slip in its frame, ξ fixed, see slip_rows
  std::span<double> chord;  ///< components of the slip in its frame, [point][2]
  std::span<double> works;  ///< variation on which tractions do work: Σ a_α δζ_α of the end, see
                            ///< slip_rows
  std::span<double> slope;  ///< derivatives of the slip by ξ, nodes fixed, [point][2][3]
  std::span<double> arc;    ///< θ/sin θ, [point]
  std::span<double> gap;    ///< component of d₀ along n when slip began, positive in penetration,
                            ///< [point]
};
void slip_of_points(const Rays& rays, const RayStart& start, const RaySlip& out);

/// Rows by the nodes of both facets of each component of the slip, or of the variation that
/// tractions work on.
/// @param slides c of the forms c·v of the components, see forms.h, [3][3]
/// @param chord the slip's components in its frame, which turns; empty for that variation
/// @param out [3][node][3]
void slip_rows(const Rays& rays, std::size_t point, std::span<const double> slides,
               std::span<const double> chord, std::span<double> out);

/// Rotation of vectors that turn with the facet along whose normal the rays are, since slip began:
/// its normal and the direction of its first edge in the plane turn with it. @param out rows,
/// [3][3]
void turn_since(const RayPair& pair, const RayStart& start, std::span<double> out);

/// Gradient of the angle of this rotation about the normal, which all rotations of the facet in its
/// plane have in common. A vector v in the plane changes by n × v times this, and along n.
/// @param out [node][3]
void spin_gradient(const RayPair& pair, std::span<double> out);

} // namespace qsdolfinx
