// Pairing points with a rigid tool, which has no unknowns: the master's side keeps positions alone.
#pragma once

#include "geometry/planar.h"
#include "pairing/pairing.h"
#include "surface/relief.h"

namespace qsdolfinx
{

/// Points at the nodes of a slave surface, with weights S_k, outward normals and no gap.
PairingPoints sample_nodes(const Surface& slave);

/// The same at some of its owned nodes, whatever the degree. @param which [node]
/// @throws std::invalid_argument on another number of nodes
PairingPoints sample_vertices(const Surface& slave, std::span<const std::uint8_t> which);

/// Quadrature points on the facets of a slave surface, facet by facet, with outward normals and no
/// gap. @param rule points on the reference facet, weights sum to 1
PairingPoints sample_facets(const Surface& slave, const Rule& rule);

/// How far the surface that the facets stand for is out of them at these points, along its outward
/// normal. Collective.
std::vector<double> heights_at(const Surface& surface, const Relief& relief, const Rule& rule);

/// Set normals and gaps, and drop points that see nothing of the tool. What loses all its points
/// counts as unpaired.
/// @param keep whether a point stays, [point]
/// @param normal n_p, into the tool, [point][3]
/// @param gap signed distance, positive when open, [point]
/// @param group number of points at each node or facet, one after the other
void face_tool(PairingPoints& points, std::span<const std::uint8_t> keep,
               std::span<const double> normal, std::span<const double> gap, std::size_t group);

/// Forget the unknowns of the master.
void forget_master(PairingPoints& points);

} // namespace qsdolfinx
