// How gaps and forces at vertices change as the curved surface turns that the facet opposite stands
// for. No MPI.
#pragma once

#include "sliding/ray.h"

#include <span>

namespace qsdolfinx
{

/// Derivatives of the gaps by what heights depend on: places of nodes, and normals at vertices.
/// @param by_nodes added, [point][node][3] @param by_normals added, [point][vertex][3]
void add_gaps_by_rise(const RayPair& pair, std::span<const RayPoint> points,
                      std::span<double> by_nodes, std::span<double> by_normals);

/// Derivatives of the forces Σ_p w_p p_p ∂g_p, likewise. @param pressure p_p, [point]
/// @param by_nodes added, [node][3][node][3] @param by_normals added, [node][3][vertex][3]
void add_forces_by_rise(const RayPair& pair, std::span<const RayPoint> points,
                        std::span<const double> pressure, std::span<double> by_nodes,
                        std::span<double> by_normals);

/// The same of Σ_p w_p τ_p·(what tractions work on), see RaySlip. @param traction τ_p, [point][3]
void add_slip_forces_by_rise(const RayPair& pair, std::span<const RayPoint> points,
                             std::span<const double> traction, std::span<double> by_nodes,
                             std::span<double> by_normals);

} // namespace qsdolfinx
