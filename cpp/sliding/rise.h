// Derivatives of forces at vertices with respect to the curved surface whose normals they have. No
// MPI.
#pragma once

#include "sliding/ray.h"

#include <array>
#include <span>

namespace qsdolfinx
{

/// Factors of the nodes of a facet in its tangent at vertex i along the edge to vertex j. The
/// tangent of a straight edge is x_j − x_i.
std::array<double, max_trace> edge_tangent(FacetType type, int degree, int i, int j);

/// The tangent at vertex i along the edge to vertex j. @param x the nodes of the facet, [node][3]
Vec3 along_edge(FacetType type, int degree, std::span<const double> x, int i, int j);

/// Add derivatives of the forces Σ_p w_p p_p ∂g_p by the quantities on which the normals of the
/// curved surface depend: positions of nodes, and normals at vertices. @param pressure p_p, [point]
/// @param by_nodes added, [node][3][node][3] @param by_normals added, [node][3][vertex][3]
void add_forces_by_rise(const RayPair& pair, std::span<const RayPoint> points,
                        std::span<const double> pressure, std::span<double> by_nodes,
                        std::span<double> by_normals);

/// Add derivatives of Σ_p w_p τ_p·(variation that tractions work on), see RaySlip::works, by the
/// same quantities. @param traction τ_p, [point][3]
void add_slip_forces_by_rise(const RayPair& pair, std::span<const RayPoint> points,
                             std::span<const double> traction, std::span<double> by_nodes,
                             std::span<double> by_normals);

} // namespace qsdolfinx
