#include "pairing/pairing.h"
#include "bindings/arrays.h"
#include "bindings/module.h"
#include "gap/piece_forces.h"
#include "pairing/cover.h"
#include "pairing/overlay.h"
#include "pairing/rigid.h"

#include <cmath>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <tuple>

namespace nb = nanobind;
using namespace nb::literals;
using namespace qsdolfinx;

namespace
{
/// Quadrature rule from points [point][dim] and weights, scaled to sum to 1.
Rule rule(const In<double>& x, const In<double>& w)
{
  const auto points = x.view(), weights = w.view();
  const std::size_t n = weights.size(), dim = points.size() / n;
  Rule out{{}, {weights.begin(), weights.end()}};
  double total = 0;
  for (std::size_t i = 0; i < n; ++i)
  {
    out.x.push_back({points[i * dim], dim > 1 ? points[i * dim + 1] : 0.0});
    total += out.w[i];
  }
  for (double& value : out.w)
    value /= total;
  return out;
}

/// Rows, columns and values.
auto entries(ByNormals&& found)
{
  const std::size_t n = found.value.size();
  return std::tuple(copy(std::move(found.row), {n}), copy(std::move(found.column), {n}),
                    copy(std::move(found.value), {n}));
}

/// Heights of a surface's facets. @throws nb::value_error if they have another shape
Heights heights_of(const Surface& surface, const std::optional<In<double>>& heights)
{
  const auto nodes = static_cast<std::size_t>(trace_size(surface.type(), 2));
  if (heights && heights->array.size() != surface.num_facets() * nodes)
    throw nb::value_error("heights: one for each node of degree 2 of each facet");
  return heights ? Heights(heights->view()) : Heights();
}

using Side = nb::typed<nb::dict, nb::str, nb::any>;

Side as_dict(const PairingPoints& points, const PairingSide& side)
{
  const std::size_t n = points.size(), nv = side.num_nodes;
  Side out;
  out["x"] = copy(side.x, {n, 3});
  out["dofs"] = copy(side.dofs, {n, nv, static_cast<std::size_t>(points.block)});
  out["owner"] = copy(side.owner, {n, nv});
  out["shape_values"] = copy(side.shape_values, {n, nv});
  return out;
}
} // namespace

void qsdolfinx::bind_pairing(nb::module_& m)
{
  nb::class_<PairingPoints>(m, "PairingPoints",
                            "Contact quadrature points of one choice of the slave; see "
                            "pairing/pairing.h.")
      .def_prop_ro("size", &PairingPoints::size)
      .def_prop_ro(
          "slave", [](const PairingPoints& p) { return as_dict(p, p.slave); },
          "Arrays of the slave's side: x, dofs, owner, shape_values.")
      .def_prop_ro(
          "master", [](const PairingPoints& p) { return as_dict(p, p.master); },
          "Arrays of the master's side: x, dofs, owner, shape_values.")
      .def_prop_ro(
          "multiplier_values",
          [](const PairingPoints& p)
          {
            return copy(p.multiplier_values,
                        {p.size(), static_cast<std::size_t>(p.num_multipliers)});
          },
          "Functions of the multipliers, [point][slave vertex].")
      .def_prop_ro(
          "faced", [](const PairingPoints& p)
          { return copy(p.faced, {p.size(), static_cast<std::size_t>(p.num_faced)}); },
          "First numbers of the vertices of the facet of a rigid tool, -1 for none, "
          "[point][vertex].")
      .def_prop_ro(
          "normal", [](const PairingPoints& p) { return copy(p.normal, {p.size(), 3}); },
          "Unit normals outward of the slave, [point][3].")
      .def_prop_ro(
          "gap", [](const PairingPoints& p) { return copy(p.gap, {p.size()}); },
          "Signed distances, positive when open, [point].")
      .def_prop_ro(
          "weight", [](const PairingPoints& p) { return copy(p.weight, {p.size()}); },
          "Areas, [point].")
      .def(
          "with_alone",
          [](const PairingPoints& p, In<std::int64_t> unknown, In<double> weight, double far)
          { return p.with_alone(unknown.view(), weight.view(), far); }, "unknown"_a, "weight"_a,
          "far"_a,
          "The same points, and stand-alone points with one multiplier each; see "
          "pairing/pairing.h.")
      .def(
          "scaled",
          [](const PairingPoints& p, In<double> factor) { return p.scaled(factor.view()); },
          "factor"_a, "The same points, their weights multiplied by factors [point].")
      .def(
          "turning", [](const PairingPoints& p, In<double> slave, In<double> master)
          { return p.turning(slave.view(), master.view()); }, "slave"_a, "master"_a,
          "The same points with co-rotated jumps, from the contributions of the nodes of each side "
          "to a jump, [point][node][block][block].")
      .def_ro("num_of_slave", &PairingPoints::num_of_slave,
              "Number of points of the overlay on facets of the slave; they come first.")
      .def_ro("num_unpaired", &PairingPoints::num_unpaired,
              "Number of owned nodes (overlay: facets) for which no partner was found.")
      .def_ro("num_corners", &PairingPoints::num_corners,
              "Number of owned nodes of both surfaces in the corner of several walls.")
      .def_ro("by_sides", &PairingPoints::by_sides,
              "Whether nodes in corners have a multiplier for each smooth side.")
      .def_prop_ro(
          "in_corner",
          [](const PairingPoints& p) { return copy(p.in_corner, {p.in_corner.size()}); },
          "Whether an owned node has several multipliers, [node]; empty if not by_sides.");

  m.def(
      "pair_surfaces",
      [](const Surface& slave, const Surface& master, bool both, const SearchRadius& radius,
         int normals, bool corners)
      {
        return pair_surfaces(slave, master, both ? Sampling::both : Sampling::slave_nodes, radius,
                             static_cast<Normals>(normals), corners);
      },
      "slave"_a, "master"_a, "both"_a, "radius"_a, "normals"_a, "corners"_a = false,
      "Nodal pairing points; collective.");
  m.def(
      "pair_vertices",
      [](const Surface& slave, const Surface& master, In<std::uint8_t> which,
         const SearchRadius& radius) { return pair_vertices(slave, master, which.view(), radius); },
      "slave"_a, "master"_a, "which"_a, "radius"_a,
      "Points at some owned nodes of the slave, [node], with the closest places on the master; "
      "collective.");
  m.def(
      "points_between",
      [](const Surface& slave, const Surface* master, In<double> x, In<std::int64_t> dofs,
         In<int> owner, In<double> values, In<double> master_x, In<std::int64_t> master_dofs,
         In<int> master_owner, In<double> master_values, In<double> multiplier_values,
         In<std::uint8_t> side, In<double> normal, In<double> gap, In<double> weight)
      {
        return points_between(
            slave, master, {x.view(), dofs.view(), owner.view(), values.view()},
            {master_x.view(), master_dofs.view(), master_owner.view(), master_values.view()},
            multiplier_values.view(), side.view(), normal.view(), gap.view(), weight.view());
      },
      "slave"_a, "master"_a.none(), "x"_a, "dofs"_a, "owner"_a, "values"_a, "master_x"_a,
      "master_dofs"_a, "master_owner"_a, "master_values"_a, "multiplier_values"_a, "side"_a,
      "normal"_a, "gap"_a, "weight"_a,
      "Points from given positions: for both sides positions [point][3], unknowns "
      "[point][node][block], owners and trace functions [point][node]; the functions of the "
      "multipliers [point][slave vertex], the number of the vertex' multiplier they belong to "
      "[point], normals, gaps and areas. A rigid master has no unknowns.");
  m.def(
      "keep_points",
      [](PairingPoints& points, In<std::uint8_t> which) { points.keep(which.view()); }, "points"_a,
      "which"_a, "Keep only the points that are marked in `which`, [point].");
  m.def(
      "with_traces",
      [](const PairingPoints& points, int block, In<std::int64_t> slave_dofs,
         In<std::int32_t> slave_owner, In<double> slave_values, In<std::int64_t> master_dofs,
         In<std::int32_t> master_owner, In<double> master_values)
      {
        return points.with_traces(block,
                                  {slave_dofs.view(), slave_owner.view(), slave_values.view()},
                                  {master_dofs.view(), master_owner.view(), master_values.view()});
      },
      "points"_a, "block"_a, "slave_dofs"_a, "slave_owner"_a, "slave_values"_a, "master_dofs"_a,
      "master_owner"_a, "master_values"_a,
      "The same points for another field on the same facets, without corners.");
  m.def(
      "overlay_surfaces",
      [](const Surface& slave, const Surface& master, bool both, const SearchRadius& radius,
         int normals, In<double> piece_x, In<double> piece_w, In<double> edge_x, In<double> edge_w,
         std::optional<In<double>> slave_heights, std::optional<In<double>> master_heights)
      {
        const OverlayRules rules{rule(piece_x, piece_w), rule(edge_x, edge_w)};
        return overlay_surfaces(slave, master, both, radius, static_cast<Normals>(normals), rules,
                                heights_of(slave, slave_heights),
                                heights_of(master, master_heights));
      },
      "slave"_a, "master"_a, "both"_a, "radius"_a, "normals"_a, "piece_x"_a, "piece_w"_a,
      "edge_x"_a, "edge_w"_a, "slave_heights"_a.none() = nb::none(),
      "master_heights"_a.none() = nb::none(),
      "Pairing points on the overlay; heights of curved facets, [facet][node]; collective.");
  nb::class_<Pieces>(m, "Pieces", "Pieces (segments) of the overlay; see pairing/pieces.h.")
      .def_prop_ro("size", &Pieces::size)
      .def_ro("gdim", &Pieces::gdim)
      .def_prop_ro(
          "num_missed", [](const Pieces& p) { return std::ranges::count(p.is_missed, 1); },
          "Number of pieces with a ray that meets no point.")
      .def_prop_ro("num_points", [](const Pieces& p) { return p.points.size(); })
      .def(
          "cover",
          [](const Pieces& p)
          {
            auto out = cover_of(p);
            const std::size_t n = out.size();
            return copy(std::move(out), {n});
          },
          "Covered areas of the slave's nodes, [piece, k].")
      .def(
          "side_dofs",
          [](const Pieces& p)
          {
            auto out = side_dofs(p);
            const std::size_t n = out.size();
            return copy(std::move(out), {n});
          },
          "Unknowns that represent the sides of these nodes, [piece, k].")
      .def(
          "gaps", [](const Pieces& p) { return copy(distances_of(p), {p.points.size()}); },
          "Distances along the rays, positive when open, [point].")
      .def(
          "raise_facets", [](Pieces& p, Handle normals)
          { raise_facets(p, reinterpret_cast<Vec>(normals)); }, "normals"_a,
          "Let forces at vertices act along the normals of a curved surface; collective.")
      .def(
          "forces_by_normals",
          [](const Pieces& p, In<double> stress, bool slips)
          {
            auto [slave, master] = forces_by_normals(p, stress.view(), slips);
            return std::tuple(entries(std::move(slave)), entries(std::move(master)));
          },
          "stress"_a, "slips"_a,
          "Derivatives of forces of pressures or tractions, on both bodies, by these normals; "
          "rows are unknowns.")
      .def(
          "functions",
          [](const Pieces& p)
          {
            const auto nk = static_cast<std::size_t>(p.num_multipliers);
            std::vector<double> out;
            for (std::size_t i = 0; i < p.size(); ++i)
              for (const RayPoint& point : p.points_of(i))
              {
                const auto N
                    = shape_functions(p.slave.type, p.cut_is_slave[i] ? point.xi : point.zeta);
                out.insert(out.end(), N.begin(), N.begin() + p.num_multipliers);
              }
            return copy(std::move(out), {p.points.size(), nk});
          },
          "Functions of the slave's vertices at the points, [point][k].")
      .def(
          "facets",
          [](const Pieces& p)
          {
            const auto d = static_cast<std::size_t>(p.gdim);
            const std::size_t vertices
                = static_cast<std::size_t>(p.slave.type) + static_cast<std::size_t>(p.master.type);
            std::vector<std::int64_t> out;
            for (std::size_t i = 0; i < p.size(); ++i)
              for (std::size_t q = 0; q < p.points_of(i).size(); ++q)
              {
                out.push_back(p.cut_is_slave[i]);
                for (const PieceSide* side : {&p.slave, &p.master})
                  for (std::size_t j = 0; j < static_cast<std::size_t>(side->type); ++j)
                    out.push_back(
                        side->dofs[(i * static_cast<std::size_t>(side->num_nodes) + j) * d]);
              }
            return copy(std::move(out), {p.points.size(), vertices + 1});
          },
          "Identification of the two facets of each point and of the facet that was cut, "
          "[point][n].")
      .def_prop_ro(
          "vertex", [](const Pieces& p) { return copy(p.vertex, {p.vertex.size()}); },
          "Numbers of the owned nodes that are the points; empty for facets that were cut.")
      .def(
          "slave_sizes",
          [](const Pieces& p)
          {
            std::vector<double> out;
            for (std::size_t i = 0; i < p.size(); ++i)
            {
              const auto vertices
                  = p.slave.x_of(i).first(3 * static_cast<std::size_t>(p.slave.type));
              const double size = std::sqrt(squared_size(p.slave.type, vertices));
              out.insert(out.end(), p.points_of(i).size(), size);
            }
            return copy(std::move(out), {p.points.size()});
          },
          "Size of the slave's facet at each point, [point].")
      .def(
          "x",
          [](const Pieces& p)
          {
            std::vector<double> out;
            for (std::size_t i = 0; i < p.size(); ++i)
            {
              const PieceSide& cut = p.cut_is_slave[i] ? p.slave : p.master;
              const auto nodes = cut.x_of(i);
              for (const RayPoint& point : p.points_of(i))
              {
                const auto T = trace_functions(cut.type, cut.degree, point.xi);
                Vec3 x{0, 0, 0};
                for (int j = 0; j < cut.num_nodes; ++j)
                  x = x + T[j] * facet_vertex(nodes, j);
                out.insert(out.end(), x.begin(), x.end());
              }
            }
            return copy(std::move(out), {p.points.size(), 3});
          },
          "Positions of the points, [point][3].");
  m.def(
      "overlay_pieces",
      [](const Surface& slave, const Surface& master, bool both, KeptPairs& pairs,
         In<double> piece_x, In<double> piece_w, In<double> edge_x, In<double> edge_w)
      {
        const OverlayRules rules{rule(piece_x, piece_w), rule(edge_x, edge_w)};
        return overlay_pieces(slave, master, both, pairs, rules);
      },
      "slave"_a, "master"_a, "both"_a, "pairs"_a, "piece_x"_a, "piece_w"_a, "edge_x"_a, "edge_w"_a,
      "Pieces of the overlay of surfaces with updated geometry; collective.");
  m.def(
      "vertex_pieces",
      [](const Surface& slave, const Surface& master, bool of_master, In<std::uint8_t> which,
         In<double> weight, const SearchRadius& radius)
      { return vertex_pieces(slave, master, of_master, which.view(), weight.view(), radius); },
      "slave"_a, "master"_a, "of_master"_a, "which"_a, "weight"_a, "radius"_a,
      "Points at vertices of the slave or the master, for surfaces with updated geometry; "
      "collective.");
  m.def(
      "conforming_points",
      [](const Surface& slave, const Surface& master, const SearchRadius& radius,
         In<double> piece_x, In<double> piece_w, In<double> edge_x, In<double> edge_w,
         bool slave_is_flat, bool master_is_flat)
      {
        const OverlayRules rules{rule(piece_x, piece_w), rule(edge_x, edge_w)};
        Conforming found
            = conforming_points(slave, master, radius, rules, {slave_is_flat, master_is_flat});
        std::vector<double> out;
        for (const ConformingPoint& p : found.found)
          out.insert(out.end(), {p.slave, p.master, p.gap, p.weight});
        return std::pair(std::move(found.points), copy(std::move(out), {found.found.size(), 4}));
      },
      "slave"_a, "master"_a, "radius"_a, "piece_x"_a, "piece_w"_a, "edge_x"_a, "edge_w"_a,
      "slave_is_flat"_a, "master_is_flat"_a,
      "Paired points of the slave, whose gap is the change of the gap by chord errors, and those "
      "where both surfaces are curved the same way, [point][slave, master, gap, weight]; "
      "collective.");

  m.def(
      "heights_at",
      [](const Surface& surface, std::optional<In<double>> heights, In<double> x, In<double> w)
      {
        const auto out = heights_at(surface, heights_of(surface, heights), rule(x, w));
        return copy(out, {out.size()});
      },
      "surface"_a, "heights"_a.none(), "x"_a, "w"_a,
      "Heights above the flat facets at quadrature points, facet by facet, of curved facets with "
      "given heights at their nodes of degree 2, or from the angles between facets; collective.");
  m.def("sample_nodes", &sample_nodes, "slave"_a, "Points at the nodes, without a master.");
  m.def(
      "sample_vertices", [](const Surface& slave, In<std::uint8_t> which)
      { return sample_vertices(slave, which.view()); }, "slave"_a, "which"_a,
      "Points at some owned nodes, [node], of any degree, without a master.");
  m.def(
      "sample_facets", [](const Surface& slave, In<double> x, In<double> w)
      { return sample_facets(slave, rule(x, w)); }, "slave"_a, "x"_a, "w"_a,
      "Quadrature points on the facets, without a master.");
  m.def(
      "face_tool",
      [](PairingPoints& points, In<std::uint8_t> keep, In<double> normal, In<double> gap,
         std::size_t group) { face_tool(points, keep.view(), normal.view(), gap.view(), group); },
      "points"_a, "keep"_a, "normal"_a, "gap"_a, "group"_a,
      "Set normals and gaps, and remove points; see pairing/rigid.h.");
  m.def("share_out_hardly_covered", &share_out_hardly_covered, "points"_a, "slave"_a, "least"_a,
        "Condense the multipliers of hardly covered nodes onto their neighbours; collective.");
  m.def("forget_master", &forget_master, "points"_a,
        "Remove the unknowns of the master; `faced` identifies its facets from then on.");
}
