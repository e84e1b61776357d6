// Pairing points with a rigid tool, which has no unknowns: the master's side stores only positions.
#pragma once

#include "geometry/planar.h"
#include "pairing/pairing.h"
#include "surface/heights.h"

namespace qsdolfinx
{

/// Create points at the nodes of a slave surface, with weights S_k, outward normals and gap 0.
PairingPoints sample_nodes(const Surface& slave);

/// Create such points at some of its owned nodes, for any degree. @param which whether a node is
/// used, [node]
/// @throws std::invalid_argument on another number of nodes
PairingPoints sample_vertices(const Surface& slave, std::span<const std::uint8_t> which);

/// Create quadrature points on the facets of a slave surface, facet by facet, with outward normals
/// and gap 0. @param rule points on the reference facet, weights sum to 1
PairingPoints sample_facets(const Surface& slave, const Rule& rule);

/// Heights of curved facets above these points along outward normals, or, without heights, of the
/// surface that the flat facets approximate. Collective.
std::vector<double> heights_at(const Surface& surface, const Heights& heights, const Rule& rule);

/// Set normals and gaps, and remove points that have no point of the tool opposite. A node or facet
/// that loses all its points counts as unpaired.
/// @param keep whether a point stays, [point]
/// @param normal n_p, into the tool, [point][3]
/// @param gap signed distance, positive when open, [point]
/// @param group number of consecutive points that belong to one node or facet
void face_tool(PairingPoints& points, std::span<const std::uint8_t> keep,
               std::span<const double> normal, std::span<const double> gap, std::size_t group);

/// Remove the unknowns of the master; PairingPoints::faced identifies its facets from then on.
void forget_master(PairingPoints& points);

} // namespace qsdolfinx
