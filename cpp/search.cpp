#include "search.h"
#include "boxes.h"
#include "exchange.h"
#include "projection.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

using namespace qsdolfinx;
namespace bg = boost::geometry;

namespace
{
BoxTree facet_tree(const Surface& surface)
{
  std::vector<Box> boxes;
  for (std::size_t f = 0; f < surface.num_facets(); ++f)
    boxes.push_back(box_of(surface.facet_x(f)));
  return BoxTree(boxes);
}

/// A facet's answer to one node.
struct Candidate
{
  std::size_t facet;
  ClosestPoint point;
  bool beside; ///< the node is beside the surface, see overhang_tolerance
};

/// Facets of this rank that are closest to p, ties included.
void local_candidates(const Surface& surface, const BoxTree& boxes, const Vec3& p,
                      const Vec3& normal, double radius, std::vector<Candidate>& out)
{
  out.clear();
  const BoxTree::Tree& tree = boxes.tree();
  if (tree.empty())
    return;
  double limit = radius;
  const BoxTree::Point query(p[0], p[1], p[2]);
  for (auto it = tree.qbegin(bg::index::nearest(query, static_cast<unsigned>(tree.size())));
       it != tree.qend(); ++it)
  {
    if (bg::distance(query, it->first) > limit)
      break;
    const std::size_t f = it->second;
    const ClosestPoint c = closest_point(surface.type(), surface.facet_x(f), p);
    if (c.distance > limit)
      continue;
    const Vec3 n = surface.normal(f, c.xi);
    if (!(dot(n, normal) < 0))
      continue;
    const double size = surface.facets().size[f];
    const Vec3 d = p - c.x;
    const double height = dot(d, n), offset = norm(d - height * n);
    const bool beside = offset > std::max(overhang_tolerance * size, 2 * std::abs(height))
                        && surface.on_surface_boundary(f, c.xi);
    out.push_back({f, c, beside});
    limit = std::min(limit, c.distance + tie_tolerance * size);
  }
  std::erase_if(out, [limit](const Candidate& c) { return c.point.distance > limit; });
}

/// A facet's vertices in lexicographic order: a name for the facet that no partition changes.
void sort_vertices(std::span<double> x)
{
  const auto vertex = [x](std::size_t i) { return x.subspan(3 * i, 3); };
  for (std::size_t i = 1; i < x.size() / 3; ++i)
    for (std::size_t j = i; j > 0 && std::ranges::lexicographical_compare(vertex(j), vertex(j - 1));
         --j)
      std::ranges::swap_ranges(vertex(j), vertex(j - 1));
}

/// Nodes sent to every rank whose facets might be within the radius.
struct Queries
{
  std::vector<std::int64_t> node; ///< local node of each query sent
  std::unique_ptr<Exchange> exchange;
  std::vector<double> data; ///< received: x, normal, [query][6]
};

/// Ranks whose facets may be within the radius of any of this rank's nodes.
std::vector<int> ranks_near(std::span<const double> boxes, std::span<const double> x, double radius)
{
  std::vector<int> out;
  if (x.empty())
    return out;
  const Box box = box_of(x);
  for (std::size_t r = 0; r < boxes.size() / 6; ++r)
    if (boxes_are_near(boxes.subspan(6 * r, 6), box, radius))
      out.push_back(static_cast<int>(r));
  return out;
}

Queries send_queries(const Surface& nodes, const Surface& surface, double radius)
{
  const auto boxes = all_bounding_boxes(surface.comm(), surface.facets().x);
  Queries q;
  std::vector<int> dest;
  std::vector<double> data;
  const Nodes& n = nodes.nodes();
  const std::vector<int> neighbours = ranks_near(boxes, n.x, radius);
  for (std::size_t k = 0; k < n.size(); ++k)
  {
    const std::span<const double> x = std::span(n.x).subspan(3 * k, 3);
    for (int r : neighbours)
    {
      if (!boxes_are_near(std::span(boxes).subspan(6 * r, 6), box_of(x), radius))
        continue;
      q.node.push_back(static_cast<std::int64_t>(k));
      dest.push_back(r);
      data.insert(data.end(), x.begin(), x.end());
      data.insert(data.end(), &n.normal[3 * k], &n.normal[3 * k] + 3);
    }
  }
  q.exchange = std::make_unique<Exchange>(surface.comm(), dest);
  q.data = q.exchange->forward<double>(data, 6);
  return q;
}

/// Candidates flattened for the way back: one record each.
struct Answers
{
  int nv, gdim;
  std::vector<std::int64_t> query; ///< query it answers, in the asking rank's numbering
  std::vector<double> values;      ///< distance, size, beside, x, normal, N, sorted vertices
  std::vector<std::int64_t> dofs;  ///< [record][vertex][gdim]
  std::vector<int> owner;          ///< [record][vertex]

  int width() const { return 9 + nv + 3 * nv; }
  std::span<const double> value(std::size_t i) const
  {
    return std::span(values).subspan(i * width(), width());
  }
  double distance(std::size_t i) const { return values[i * width()]; }
  bool beside(std::size_t i) const { return values[i * width() + 2] != 0; }
  double tie(std::size_t i) const { return tie_tolerance * values[i * width() + 1]; }
  std::span<const double> name(std::size_t i) const { return value(i).subspan(9 + nv); }

  void append(std::int64_t q, const Surface& s, const Candidate& c)
  {
    query.push_back(q);
    const Vec3 n = s.normal(c.facet, c.point.xi);
    const auto N = shape_functions(s.type(), c.point.xi);
    values.insert(values.end(), {c.point.distance, s.facets().size[c.facet], 1.0 * c.beside});
    values.insert(values.end(), c.point.x.begin(), c.point.x.end());
    values.insert(values.end(), n.begin(), n.end());
    values.insert(values.end(), N.begin(), N.begin() + nv);
    const auto v = s.facet_x(c.facet);
    values.insert(values.end(), v.begin(), v.end());
    sort_vertices(std::span(values).last(v.size()));
    const auto d = s.facets().vertex_dofs.begin() + c.facet * nv * gdim;
    dofs.insert(dofs.end(), d, d + nv * gdim);
    const auto o = s.facets().vertex_owner.begin() + c.facet * nv;
    owner.insert(owner.end(), o, o + nv);
  }
};

Answers answer_queries(const Surface& surface, const Queries& q, double radius)
{
  // The sender numbers its queries; the answer carries that number and the sender's rank back.
  int rank;
  MPI_Comm_rank(surface.comm(), &rank);
  std::vector<std::int64_t> numbers(2 * q.node.size());
  for (std::size_t i = 0; i < q.node.size(); ++i)
  {
    numbers[2 * i] = rank;
    numbers[2 * i + 1] = static_cast<std::int64_t>(i);
  }
  const auto received = q.exchange->forward<std::int64_t>(numbers, 2);

  Answers mine{surface.num_vertices(), surface.gdim(), {}, {}, {}, {}};
  std::vector<int> dest;
  const BoxTree tree = facet_tree(surface);
  std::vector<Candidate> candidates;
  for (std::size_t i = 0; i < q.exchange->num_received(); ++i)
  {
    const double* d = q.data.data() + 6 * i;
    local_candidates(surface, tree, {d[0], d[1], d[2]}, {d[3], d[4], d[5]}, radius, candidates);
    for (const Candidate& c : candidates)
    {
      dest.push_back(static_cast<int>(received[2 * i]));
      mine.append(received[2 * i + 1], surface, c);
    }
  }
  Exchange back(surface.comm(), dest);
  Answers out{mine.nv, mine.gdim, {}, {}, {}, {}};
  out.query = back.forward<std::int64_t>(mine.query, 1);
  out.values = back.forward<double>(mine.values, mine.width());
  out.dofs = back.forward<std::int64_t>(mine.dofs, mine.nv * mine.gdim);
  out.owner = back.forward<int>(mine.owner, mine.nv);
  return out;
}

/// Best answer for every node: smallest distance; among equal ones the first in the order of names.
std::vector<std::int64_t> choose(const Answers& a, const Queries& q, std::size_t num_nodes)
{
  std::vector<double> limit(num_nodes, std::numeric_limits<double>::infinity());
  for (std::size_t i = 0; i < a.query.size(); ++i)
  {
    double& l = limit[q.node[a.query[i]]];
    l = std::min(l, a.distance(i) + a.tie(i));
  }
  std::vector<std::int64_t> best(num_nodes, -1);
  for (std::size_t i = 0; i < a.query.size(); ++i)
  {
    const std::size_t k = q.node[a.query[i]];
    if (a.distance(i) > limit[k])
      continue;
    const auto name = a.name(i);
    if (best[k] >= 0)
    {
      const auto other = a.name(best[k]);
      if (!std::lexicographical_compare(name.begin(), name.end(), other.begin(), other.end()))
        continue;
    }
    best[k] = static_cast<std::int64_t>(i);
  }
  return best;
}
} // namespace

ClosestFacets qsdolfinx::closest_facets(const Surface& nodes, const Surface& surface, double radius)
{
  const Queries q = send_queries(nodes, surface, radius);
  const Answers a = answer_queries(surface, q, radius);
  const std::size_t n = nodes.nodes().size();
  const auto best = choose(a, q, n);

  const std::size_t nv = surface.num_vertices(), gdim = surface.gdim();
  ClosestFacets out{std::vector<std::uint8_t>(n, 0), std::vector<std::int64_t>(n * nv * gdim, -1),
                    std::vector<int>(n * nv, -1),    std::vector<double>(n * nv, 0),
                    std::vector<double>(n * 3, 0),   std::vector<double>(n * 3, 0)};
  for (std::size_t k = 0; k < n; ++k)
  {
    if (best[k] < 0 || a.beside(best[k]))
      continue;
    const auto v = a.value(best[k]);
    out.found[k] = 1;
    std::copy_n(v.begin() + 3, 3, out.x.begin() + 3 * k);
    std::copy_n(v.begin() + 6, 3, out.normal.begin() + 3 * k);
    std::copy_n(v.begin() + 9, nv, out.shape_values.begin() + nv * k);
    std::copy_n(a.dofs.begin() + best[k] * nv * gdim, nv * gdim, out.dofs.begin() + k * nv * gdim);
    std::copy_n(a.owner.begin() + best[k] * nv, nv, out.owner.begin() + k * nv);
  }
  return out;
}
