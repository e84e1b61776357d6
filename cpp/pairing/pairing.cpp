#include "pairing/pairing.h"
#include "pairing/corners.h"
#include "pairing/pieces.h"
#include "parallel/records.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

using namespace qsdolfinx;

namespace
{
/// Positions whose distance is less than this fraction of a facet are the same up to rounding.
constexpr double same_place = 1e-6;

/// Keep entries of `width` values for which `keep` is set.
template <typename T>
void filter(std::vector<T>& values, std::span<const std::uint8_t> keep, std::size_t width)
{
  std::size_t next = 0;
  for (std::size_t p = 0; p < keep.size(); ++p)
    if (keep[p])
    {
      std::copy_n(values.begin() + p * width, width, values.begin() + next * width);
      ++next;
    }
  values.resize(next * width);
}

/// Append the point within a facet that was found for node k.
void append_facet(PairingSide& side, const ClosestFacets& found, std::size_t k, int block)
{
  append_record(side.x, found.x, k, 3);
  append_record(side.dofs, found.dofs, k, side.num_nodes * block);
  append_record(side.owner, found.owner, k, side.num_nodes);
  append_record(side.shape_values, found.shape_values, k, side.num_nodes);
}

/// Whether a place is beside its closest facets: the surface ends there, or bends away.
/// @param size of facets, in which rounding is measured
bool is_beside(const Vec3& place, const ClosestFacets& found, std::size_t i, double size)
{
  const auto k = static_cast<int>(i);
  const Vec3 mean = facet_vertex(found.mean_normal, k), away = place - facet_vertex(found.x, k);
  const double length = norm(mean), height = dot(away, mean) / length;
  // At an edge whose facets all face the place, the place is within the cone of their normals.
  const double cone = std::sqrt(std::max(1 - length * length, 0.0)) / length;
  const double offset = norm(away - (height / length) * mean);
  return offset > cone * std::abs(height) + same_place * size;
}

/// Appends points at the nodes of one side, projected onto the other.
class NodalPoints
{
public:
  /// @param at_slave whether the nodes are the slave's
  /// @param share fraction of a node's area that is the weight
  NodalPoints(PairingPoints& points, const Surface& at, bool at_slave, double share,
              Normals normals)
      : points_(points), nodes_(at.nodes()), rank_(at.rank()),
        node_side_(at_slave ? points.slave : points.master),
        facet_side_(at_slave ? points.master : points.slave), at_slave_(at_slave), share_(share),
        normals_(normals)
  {
  }

  /// Append a point for node k and the facet found for it, or for one of its sides.
  /// @param of positions and areas of nodes
  /// @param normals normals of the nodes or, on sharp edges, of the sides that face the found facet
  /// @param entry index into `of`, `normals` and `found`
  void append(std::size_t k, const Nodes& of, const std::vector<double>& normals,
              const ClosestFacets& found, std::size_t entry, std::uint8_t side)
  {
    append_node(node_side_, nodes_, k, points_.block, rank_);
    append_facet(facet_side_, found, entry, points_.block);
    append_side(found, entry, side);
    // The facet's normal points out of its own body, and therefore into the slave if the facet is
    // the master's.
    const double sign = at_slave_ ? -1.0 : 1.0;
    const auto at = [entry](const std::vector<double>& v)
    { return facet_vertex(v, static_cast<int>(entry)); };
    // Both point into the node's body, as the facet's normal does.
    const Vec3 of_facet = at(found.normal), of_node = -1.0 * at(normals);
    const bool one = normals_ != Normals::bisector;
    const bool by_node = normals_ == Normals::master && !at_slave_;
    const Vec3 sum = !one ? of_facet + of_node : by_node ? of_node : of_facet;
    const Vec3 n = (sign / norm(sum)) * sum;
    points_.normal.insert(points_.normal.end(), n.begin(), n.end());
    points_.gap.push_back(sign * dot(n, at(of.x) - at(found.x)));
    points_.weight.push_back(share_ * of.area[entry]);
  }

private:
  void append_side(const ClosestFacets& found, std::size_t entry, std::uint8_t side)
  {
    const auto n = static_cast<std::size_t>(points_.num_multipliers);
    std::vector<std::uint8_t>& out = points_.multiplier_side;
    if (!at_slave_ && !found.side.empty())
      return append_record(out, found.side, entry, n);
    out.push_back(at_slave_ ? side : 0);
    out.insert(out.end(), n - 1, 0);
  }

  PairingPoints& points_;
  const Nodes& nodes_;
  int rank_;
  PairingSide &node_side_, &facet_side_;
  bool at_slave_;
  double share_;
  Normals normals_;
};

/// Store which nodes of the slave are in corners, and the areas of their sides.
void take_corners(PairingPoints& points, const Corners& corners)
{
  points.by_sides = true;
  points.in_corner = corners.at;
  points.node_side = corners.side;
  points.side_area.assign(corners.at.size() * points.gdim, 0.0);
  for (std::size_t i = 0; i < corners.sides.node.size(); ++i)
    points.side_area[corners.sides.node[i] * points.gdim + corners.sides.side[i]]
        = corners.sides.at.area[i];
}

/// Normals of nodes, [node][3]. On sharp edges they are those of the smooth side that faces the
/// found facet most: the mean with the faces beside it would tilt the normal of the pair.
std::vector<double> facing_normals(const Surface& at, const ClosestFacets& found)
{
  std::vector<double> out = at.nodes().normal;
  if (!at.has_creases())
    return out;
  const Sides sides = at.sides();
  std::size_t last = out.size(); // previous node
  double best = 0;
  for (std::size_t i = 0; i < sides.node.size(); ++i)
  {
    const std::size_t k = sides.node[i];
    if (!found.found[k])
      continue;
    const Vec3 n = facet_vertex(sides.at.normal, static_cast<int>(i));
    const double looks = -dot(n, facet_vertex(found.normal, static_cast<int>(k)));
    if (k != last || looks > best)
    {
      std::ranges::copy(n, out.begin() + static_cast<std::ptrdiff_t>(3 * k));
      best = looks;
    }
    last = k;
  }
  return out;
}

/// Append points at the nodes of one side, projected onto the other side; see NodalPoints.
/// @param sides of the facets' vertices, see closest_facets
void append_nodal_points(PairingPoints& points, const Surface& at, const Surface& onto,
                         bool at_slave, double share, const SearchRadius& radius, Normals normals,
                         bool with_corners, const std::vector<std::uint8_t>* sides)
{
  const ClosestFacets found = closest_facets(at, onto, radius, sides);
  Corners corners;
  if (with_corners && at.has_creases())
  {
    corners = find_corners(at, onto, radius, found, sides);
    points.num_corners += std::ranges::count(corners.at, 1);
    if (at_slave)
      take_corners(points, corners);
  }
  NodalPoints out(points, at, at_slave, share, normals);
  const Nodes& nodes = at.nodes();
  const std::vector<double> facing
      = normals == Normals::facet ? nodes.normal : facing_normals(at, found);
  points.reserve(points.size() + nodes.size());
  std::size_t entry = 0; // of the sides of nodes on sharp edges
  for (std::size_t k = 0; k < nodes.size(); ++k)
  {
    for (; entry < corners.sides.node.size() && corners.sides.node[entry] == k; ++entry)
      if (corners.walls.found[entry])
        out.append(k, corners.sides.at, corners.sides.at.normal, corners.walls, entry,
                   corners.sides.side[entry]);
    if (!found.found[k])
      ++points.num_unpaired;
    else if (corners.at.empty() || !corners.at[k])
      out.append(k, nodes, facing, found, k, 0);
  }
}
} // namespace

void qsdolfinx::append_own_multipliers(PairingPoints& points)
{
  const auto n = static_cast<std::size_t>(points.num_multipliers);
  points.multiplier_values.assign(points.size() * n, 0.0);
  for (std::size_t p = 0; p < points.size(); ++p)
    points.multiplier_values[p * n] = 1;
}

void qsdolfinx::append_node(PairingSide& side, const Nodes& nodes, std::size_t k, int block,
                            int rank)
{
  append_record(side.x, nodes.x, k, 3);
  append_record(side.dofs, nodes.dofs, k, block);
  side.dofs.insert(side.dofs.end(), (side.num_nodes - 1) * block, -1);
  side.owner.push_back(rank);
  side.owner.insert(side.owner.end(), side.num_nodes - 1, -1);
  side.shape_values.push_back(1);
  side.shape_values.insert(side.shape_values.end(), side.num_nodes - 1, 0.0);
}

PairingPoints::PairingPoints(const Surface& s, const Surface* m)
    : gdim(s.gdim()), block(s.block()), num_multipliers(s.num_vertices())
{
  if (m && s.gdim() != m->gdim())
    throw std::invalid_argument("slave and master have different geometric dimensions");
  slave.num_nodes = s.num_trace();
  master.num_nodes = m ? m->num_trace() : 0;
}

void PairingPoints::reserve(std::size_t n)
{
  for_each_array([n](auto& values, std::size_t width) { values.reserve(n * width); });
}

void PairingPoints::keep(std::span<const std::uint8_t> which)
{
  if (which.size() != size())
    throw std::invalid_argument("one flag for each point");
  for_each_array([which](auto& values, std::size_t width) { filter(values, which, width); });
}

PairingPoints PairingPoints::with_alone(std::span<const std::int64_t> unknown,
                                        std::span<const double> added, double far) const
{
  const std::size_t n = unknown.size(), first = size();
  if (added.size() != n)
    throw std::invalid_argument("one area for each unknown");
  PairingPoints out = *this;
  out.for_each_array([total = first + n](auto& values, std::size_t width)
                     { values.resize(total * width); });
  out.num_alone = n;
  const auto s = static_cast<std::size_t>(slave.num_nodes), m = static_cast<std::size_t>(block),
             nk = static_cast<std::size_t>(num_multipliers);
  for (PairingSide* side : {&out.slave, &out.master})
  {
    const auto places = static_cast<std::ptrdiff_t>(first) * side->num_nodes;
    std::fill(side->dofs.begin() + places * block, side->dofs.end(), -1);
    std::fill(side->owner.begin() + places, side->owner.end(), -1);
  }
  std::fill(out.faced.begin() + static_cast<std::ptrdiff_t>(first) * num_faced, out.faced.end(),
            -1);
  for (std::size_t i = 0; i < n; ++i)
  {
    const std::size_t p = first + i;
    out.slave.dofs[p * s * m] = unknown[i];
    out.multiplier_values[p * nk] = 1.0;
    out.gap[p] = far;
    out.weight[p] = added[i];
  }
  return out;
}

PairingPoints PairingPoints::scaled(std::span<const double> factor) const
{
  if (factor.size() != size())
    throw std::invalid_argument("one factor for each point");
  PairingPoints out = *this;
  std::ranges::transform(weight, factor, out.weight.begin(), std::multiplies<>());
  return out;
}

PairingPoints PairingPoints::turning(std::span<const double> slave,
                                     std::span<const double> master) const
{
  PairingPoints out = *this;
  out.turns = true;
  const auto set = [&](PairingSide& side, std::span<const double> turn)
  {
    if (turn.size() != side.shape_values.size() * block * block)
      throw std::invalid_argument("turning: a matrix for each node of each point");
    side.turn.assign(turn.begin(), turn.end());
  };
  set(out.slave, slave);
  set(out.master, master);
  return out;
}

PairingPoints PairingPoints::with_traces(int block, const Trace& slave, const Trace& master) const
{
  PairingPoints out = *this;
  out.block = block;
  const auto replace = [&](PairingSide& side, const Trace& trace)
  {
    const std::size_t entries = trace.owner.size(), points = std::max<std::size_t>(size(), 1);
    if (trace.dofs.size() != entries * block || trace.shape_values.size() != entries
        || entries % points != 0 || (size() == 0 && entries > 0))
      throw std::invalid_argument("with_traces: values for each node of each point");
    if (size() > 0)
      side.num_nodes = static_cast<int>(entries / points);
    side.dofs.assign(trace.dofs.begin(), trace.dofs.end());
    side.owner.assign(trace.owner.begin(), trace.owner.end());
    side.shape_values.assign(trace.shape_values.begin(), trace.shape_values.end());
  };
  replace(out.slave, slave);
  replace(out.master, master);
  out.by_sides = false;
  std::ranges::fill(out.multiplier_side, 0);
  for (auto* of_nodes : {&out.in_corner, &out.node_side})
    of_nodes->clear();
  out.side_area.clear();
  return out;
}

PairingPoints PairingPoints::none_like() const
{
  PairingPoints out;
  out.gdim = gdim;
  out.block = block;
  out.num_multipliers = num_multipliers;
  out.slave.num_nodes = slave.num_nodes;
  out.master.num_nodes = master.num_nodes;
  return out;
}

PairingPoints qsdolfinx::pair_surfaces(const Surface& slave, const Surface& master,
                                       Sampling sampling, const SearchRadius& radius,
                                       Normals normals, bool corners)
{
  if (slave.degree() != 1 || master.degree() != 1)
    throw std::invalid_argument("nodal pairing points need traces of degree 1");
  PairingPoints points(slave, &master);
  const double share = sampling == Sampling::both ? 0.5 : 1.0;
  append_nodal_points(points, slave, master, true, share, radius, normals, corners, nullptr);
  if (sampling == Sampling::both)
  {
    std::vector<std::uint8_t> sides; // of the slave's facets, where a node has several multipliers
    if (points.by_sides)
      sides = slave.sides_of_facets(points.in_corner);
    append_nodal_points(points, master, slave, false, share, radius, normals, corners,
                        points.by_sides ? &sides : nullptr);
  }
  points.multiplier_values = points.slave.shape_values; // the trace is P1 or Q1
  return points;
}

namespace
{
/// Nodes of a surface, and the closest facet for each.
struct Faced
{
  std::vector<std::size_t> node, entry; ///< numbers of nodes, and of their entries in `found`
  Nodes places;                         ///< of each entry
  ClosestFacets found;
};

/// Find the facets that some nodes face, with the nodes' own normals or with those of each of their
/// smooth sides; the closest facet is taken. Collective. @param which whether an owned node is used
Faced face_vertices(const Surface& slave, const Surface& master,
                    std::span<const std::uint8_t> which, const SearchRadius& radius)
{
  const Nodes& nodes = slave.nodes();
  if (which.size() != nodes.size())
    throw std::invalid_argument("one flag for each owned node");
  Faced out;
  const Sides sides = slave.has_creases() ? slave.sides() : Sides{};
  std::vector<std::size_t> at;
  Nodes& places = out.places;
  const auto append = [&](std::size_t k, const std::vector<double>& normals, std::size_t entry)
  {
    at.push_back(k);
    append_record(places.x, nodes.x, k, 3);
    append_record(places.normal, normals, entry, 3);
    places.area.push_back(nodes.area[k]);
    places.facet_size.push_back(nodes.facet_size[k]);
  };
  for (std::size_t k = 0, entry = 0; k < which.size(); ++k)
  {
    while (entry < sides.node.size() && sides.node[entry] < k)
      ++entry;
    if (!which[k])
      continue;
    append(k, nodes.normal, k);
    for (; entry < sides.node.size() && sides.node[entry] == k; ++entry)
      append(k, sides.at.normal, entry);
  }
  out.found = closest_facets({places.x, places.normal, places.facet_size}, slave, master, radius);
  const auto distance = [&](std::size_t i)
  {
    const auto k = static_cast<int>(i);
    return norm(facet_vertex(places.x, k) - facet_vertex(out.found.x, k));
  };
  for (std::size_t i = 0; i < at.size();)
  {
    std::size_t best = at.size(), end = i;
    for (; end < at.size() && at[end] == at[i]; ++end)
      if (out.found.found[end] && (best == at.size() || distance(end) < distance(best))
          && !is_beside(facet_vertex(places.x, static_cast<int>(end)), out.found, end,
                        places.facet_size[end]))
        best = end;
    if (best < at.size())
    {
      out.node.push_back(at[i]);
      out.entry.push_back(best);
    }
    i = end;
  }
  return out;
}
} // namespace

PairingPoints qsdolfinx::pair_vertices(const Surface& slave, const Surface& master,
                                       std::span<const std::uint8_t> which,
                                       const SearchRadius& radius)
{
  PairingPoints points(slave, &master);
  const Faced faced = face_vertices(slave, master, which, radius);
  NodalPoints out(points, slave, true, 1.0, Normals::facet);
  for (std::size_t i = 0; i < faced.node.size(); ++i)
    out.append(faced.node[i], faced.places, faced.places.normal, faced.found, faced.entry[i], 0);
  append_own_multipliers(points);
  return points;
}

Pieces qsdolfinx::vertex_pieces(const Surface& slave, const Surface& master, bool of_master,
                                std::span<const std::uint8_t> which, std::span<const double> weight,
                                const SearchRadius& radius)
{
  const Surface &own = of_master ? master : slave, &opposite = of_master ? slave : master;
  const Nodes& nodes = own.nodes();
  if (weight.size() != nodes.size())
    throw std::invalid_argument("vertex_pieces: a weight for each owned node");
  const Faced faced = face_vertices(own, opposite, which, radius);
  Pieces out;
  out.gdim = slave.gdim();
  out.num_multipliers = slave.num_vertices();
  out.along_other = true;
  out.slave = {slave.type(), slave.degree(), slave.num_trace(), {}, {}, {}, {}};
  out.master = {master.type(), master.degree(), master.num_trace(), {}, {}, {}, {}};
  PieceSide &at = of_master ? out.master : out.slave, &facet = of_master ? out.slave : out.master;
  const auto d = static_cast<std::size_t>(out.gdim),
             n = static_cast<std::size_t>(opposite.num_trace());
  for (std::size_t i = 0; i < faced.node.size(); ++i)
  {
    const std::size_t k = faced.node[i], e = faced.entry[i];
    const ClosestFacets& found = faced.found;
    for (int j = 0; j < own.num_trace(); ++j) // the node is its first vertex, others are unused
    {
      append_record(at.x, nodes.x, k, 3);
      if (j > 0)
        at.x[at.x.size() - 3] += nodes.facet_size[k];
      append_record(at.dofs, nodes.dofs, k, d);
      at.owner.push_back(own.rank());
    }
    at.orientation.push_back(1.0);
    append_record(facet.x, found.nodes_x, e, 3 * n);
    append_record(facet.dofs, found.dofs, e, n * d);
    append_record(facet.owner, found.owner, e, n);
    const std::array<double, 2> zeta{found.xi[2 * e], found.xi[2 * e + 1]};
    const auto vertices
        = std::span(found.nodes_x).subspan(3 * n * e, 3 * static_cast<std::size_t>(facet.type));
    const Vec3 area = area_vector(facet.type, vertices, zeta),
               outward = facet_vertex(found.normal, static_cast<int>(e));
    facet.orientation.push_back(dot(area, outward) > 0 ? 1.0 : -1.0);
    out.multiplier_side.insert(out.multiplier_side.end(),
                               static_cast<std::size_t>(out.num_multipliers), 0);
    out.cut_is_slave.push_back(of_master ? 0 : 1);
    out.points.push_back({{0.0, 0.0}, zeta, weight[k]});
    out.vertex.push_back(static_cast<std::int64_t>(k));
    out.end.push_back(out.points.size());
  }
  solve_pieces(out);
  return out;
}

PairingPoints qsdolfinx::points_between(const Surface& slave, const Surface* master,
                                        const OnFacets& on_slave, const OnFacets& on_master,
                                        std::span<const double> multiplier_values,
                                        std::span<const std::uint8_t> side,
                                        std::span<const double> normal, std::span<const double> gap,
                                        std::span<const double> weight)
{
  PairingPoints out(slave, master);
  const std::size_t n = weight.size(), nv = static_cast<std::size_t>(out.num_multipliers);
  const auto take = [&](PairingSide& side, const OnFacets& on)
  {
    const std::size_t nodes = n * static_cast<std::size_t>(side.num_nodes);
    if (on.x.size() != 3 * n || on.owner.size() != nodes || on.shape_values.size() != nodes
        || on.dofs.size() != nodes * static_cast<std::size_t>(out.block))
      throw std::invalid_argument("points_between: one entry for each point, or node of it");
    side.x.assign(on.x.begin(), on.x.end());
    side.dofs.assign(on.dofs.begin(), on.dofs.end());
    side.owner.assign(on.owner.begin(), on.owner.end());
    side.shape_values.assign(on.shape_values.begin(), on.shape_values.end());
  };
  if (multiplier_values.size() != n * nv || side.size() != n || normal.size() != 3 * n
      || gap.size() != n || std::ranges::any_of(side, [&](auto s) { return s >= out.block; }))
    throw std::invalid_argument("points_between: one entry for each point");
  take(out.slave, on_slave);
  take(out.master, on_master);
  out.multiplier_values.assign(multiplier_values.begin(), multiplier_values.end());
  for (std::uint8_t s : side)
    out.multiplier_side.insert(out.multiplier_side.end(), nv, s);
  out.normal.assign(normal.begin(), normal.end());
  out.gap.assign(gap.begin(), gap.end());
  out.weight.assign(weight.begin(), weight.end());
  out.num_of_slave = n;
  return out;
}
