#include "bindings/arrays.h"
#include "bindings/module.h"
#include "sliding/changes.h"

#include <nanobind/stl/tuple.h>

#include <tuple>
#include <utility>
#include <vector>

namespace nb = nanobind;
using namespace nb::literals;
using namespace qsdolfinx;

namespace
{
/// A facet with nodes of its own.
struct Facet
{
  FacetType type;
  int degree;
  std::vector<double> x;
  double orientation;

  RayFacet view() const { return {type, degree, x, orientation}; }
};

/// @throws nb::value_error if there are too few coordinates or too many
Facet make_facet(int num_vertices, int degree, const In<double>& x, double orientation)
{
  const FacetType type = facet_type(num_vertices);
  const auto view = x.view();
  if (degree != 1 && degree != 2)
    throw nb::value_error("a facet is of degree 1 or 2");
  if (view.size() != 3 * static_cast<std::size_t>(trace_size(type, degree)))
    throw nb::value_error("a facet has 3 coordinates a node");
  return {type, degree, {view.begin(), view.end()}, orientation};
}

/// @throws nb::value_error if only one of the facets is in 2D
RayPair make_pair(const Facet& cut, const Facet& other, bool cut_is_slave)
{
  if ((cut.type == FacetType::interval) != (other.type == FacetType::interval))
    throw nb::value_error("both facets are in 2D, or both in 3D");
  return {cut.view(), other.view(), cut_is_slave};
}

struct RayPoints
{
  std::vector<RayPoint> points;
};

/// @throws nb::value_error if arrays differ in length
RayPoints make_points(const In<double>& xi, const In<double>& zeta, const In<double>& weight)
{
  const auto x = xi.view(), z = zeta.view(), w = weight.view();
  if (x.size() != 2 * w.size() || z.size() != 2 * w.size())
    throw nb::value_error("two coordinates for each weight");
  RayPoints out;
  for (std::size_t p = 0; p < w.size(); ++p)
    out.points.push_back({{x[2 * p], x[2 * p + 1]}, {z[2 * p], z[2 * p + 1]}, w[p]});
  return out;
}

/// @throws nb::value_error if there is not one value for each point
void check_size(const RayPoints& points, std::size_t size, std::size_t width)
{
  if (size != width * points.points.size())
    throw nb::value_error("one value for each point");
}

/// Derivative of the forces of constant stresses at points that do not move, [node][3][node][3].
template <typename Stress>
auto derivative_of(const RayPair& pair, const RayPoints& points, Stress stress_of)
{
  const std::size_t size = 3 * static_cast<std::size_t>(pair.num_nodes());
  const Rays rays(pair, points.points);
  std::vector<double> out(size * size);
  RayForces forces(rays, size, out);
  RayChange change;
  const std::array<WideRow, 4> constant{};
  for (std::size_t p = 0; p < points.points.size(); ++p)
  {
    const RayStress stress = stress_of(p);
    const double w = points.points[p].weight;
    change_of_ray(rays, p, {}, change);
    forces.add(p, change, {w * stress.pressure, w * stress.traction}, constant);
  }
  forces.finish();
  return copy(std::move(out), {size, size});
}
} // namespace

void qsdolfinx::bind_sliding(nb::module_& m)
{
  nb::class_<Facet>(m, "RayFacet", "A facet in its current configuration; see sliding/ray.h.")
      .def(
          "__init__",
          [](Facet* self, int num_vertices, int degree, In<double> x, double orientation)
          { new (self) Facet(make_facet(num_vertices, degree, x, orientation)); }, "num_vertices"_a,
          "degree"_a, "x"_a, "orientation"_a = 1.0, "From its trace nodes, [node][3].");
  nb::class_<RayPoints>(m, "RayPoints", "Starts and ends of rays.")
      .def(
          "__init__", [](RayPoints* self, In<double> xi, In<double> zeta, In<double> weight)
          { new (self) RayPoints(make_points(xi, zeta, weight)); }, "xi"_a, "zeta"_a, "weight"_a,
          "From reference coordinates on the facet that is cut, guesses on the other facet, both "
          "[point][2], and areas.")
      .def_prop_ro(
          "zeta",
          [](const RayPoints& p)
          {
            std::vector<double> out;
            for (const RayPoint& point : p.points)
              out.insert(out.end(), point.zeta.begin(), point.zeta.end());
            return copy(std::move(out), {p.points.size(), 2});
          },
          "Reference coordinates on the other facet, [point][2].")
      .def_prop_ro(
          "t",
          [](const RayPoints& p)
          {
            std::vector<double> out;
            for (const RayPoint& point : p.points)
              out.push_back(point.t);
            return copy(std::move(out), {p.points.size()});
          },
          "Lengths of the rays, negative in penetration, [point].");

  m.def(
      "solve_rays", [](const Facet& cut, const Facet& other, RayPoints& points)
      { return solve_rays(make_pair(cut, other, true), points.points); }, "cut"_a, "other"_a,
      "points"_a, "Solve for the ends of the rays; return whether all were found.");
  m.def(
      "ray_gaps",
      [](const Facet& cut, const Facet& other, bool cut_is_slave, const RayPoints& points)
      {
        const RayPair pair = make_pair(cut, other, cut_is_slave);
        const std::size_t n = points.points.size(), nodes = pair.num_nodes();
        std::vector<double> out(3 * n * nodes);
        gap_gradients(Rays(pair, points.points), out);
        return copy(std::move(out), {n, nodes, 3});
      },
      "cut"_a, "other"_a, "cut_is_slave"_a, "points"_a,
      "Gradients of the gaps of points, [point][node][3], the slave's nodes first.");
  m.def(
      "ray_functions",
      [](const Facet& cut, const Facet& other, bool cut_is_slave, const RayPoints& points)
      {
        const RayPair pair = make_pair(cut, other, cut_is_slave);
        const std::size_t n = points.points.size(), nodes = pair.num_nodes(),
                          nk = pair.slave().num_vertices();
        std::vector<double> out(3 * n * nk * nodes);
        const Rays rays(pair, points.points);
        RayChange change;
        for (std::size_t p = 0; p < n && !cut_is_slave; ++p)
        {
          change_of_ray(rays, p, {}, change);
          const auto dN = trace_gradients(pair.slave().type, 1, points.points[p].zeta);
          for (std::size_t k = 0; k < nk; ++k)
            for (std::size_t i = 0; i < 3 * nodes; ++i)
              out[(p * nk + k) * 3 * nodes + i]
                  = dN[k][0] * change.zeta[0][i] + dN[k][1] * change.zeta[1][i];
        }
        return copy(std::move(out), {n, nk, nodes, 3});
      },
      "cut"_a, "other"_a, "cut_is_slave"_a, "points"_a,
      "Gradients of the slave's vertex functions at points, [point][vertex][node][3].");
  m.def(
      "ray_curvature",
      [](const Facet& cut, const Facet& other, bool cut_is_slave, const RayPoints& points,
         In<double> pressure)
      {
        const auto p = pressure.view();
        check_size(points, p.size(), 1);
        return derivative_of(make_pair(cut, other, cut_is_slave), points,
                             [&](std::size_t i) { return RayStress{p[i], {}}; });
      },
      "cut"_a, "other"_a, "cut_is_slave"_a, "points"_a, "pressure"_a,
      "Second derivatives of the sum of weights times pressures times gaps, for constant weights "
      "and pressures.");
  m.def(
      "ray_slip",
      [](const Facet& cut, const Facet& other, bool cut_is_slave, const RayPoints& points,
         In<double> cut_start, In<double> other_start)
      {
        const RayPair pair = make_pair(cut, other, cut_is_slave);
        const std::size_t n = points.points.size(), nodes = pair.num_nodes();
        std::vector<double> slip(3 * n), normal(3 * n), slides(9 * n), chord(2 * n), works(9 * n),
            slope(6 * n), arc(n), gap(n), of_slip(9 * n * nodes), of_works(9 * n * nodes);
        const Rays rays(pair, points.points);
        slip_of_points(rays, {cut_start.view(), other_start.view()},
                       {slip, normal, slides, chord, works, slope, arc, gap});
        for (std::size_t p = 0; p < n; ++p)
        {
          const std::size_t size = 9 * nodes;
          slip_rows(rays, p, std::span(slides).subspan(9 * p, 9),
                    std::span(chord).subspan(2 * p, 2), std::span(of_slip).subspan(p * size, size));
          slip_rows(rays, p, std::span(works).subspan(9 * p, 9), {},
                    std::span(of_works).subspan(p * size, size));
        }
        return std::tuple(copy(std::move(slip), {n, 3}), copy(std::move(normal), {n, 3}),
                          copy(std::move(of_slip), {n, 3, nodes, 3}),
                          copy(std::move(of_works), {n, 3, nodes, 3}));
      },
      "cut"_a, "other"_a, "cut_is_slave"_a, "points"_a, "cut_start"_a, "other_start"_a,
      "Slip at points since the nodes were at the start positions, and the slave's normal, "
      "[point][3]; the gradient of the slip, and the variation that tractions work on, "
      "[point][slip][node][component].");
  m.def(
      "ray_slip_curvature",
      [](const Facet& cut, const Facet& other, bool cut_is_slave, const RayPoints& points,
         In<double> tractions)
      {
        const auto tau = tractions.view();
        check_size(points, tau.size(), 3);
        return derivative_of(make_pair(cut, other, cut_is_slave), points, [&](std::size_t i)
                             { return RayStress{0, facet_vertex(tau, static_cast<int>(i))}; });
      },
      "cut"_a, "other"_a, "cut_is_slave"_a, "points"_a, "tractions"_a,
      "Derivative of the sum of weights times the virtual work of constant tractions.");
}
