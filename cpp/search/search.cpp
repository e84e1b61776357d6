#include "search/search.h"
#include "parallel/exchange.h"
#include "parallel/records.h"
#include "search/local_search.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

using namespace qsdolfinx;

namespace
{
/// Nodes sent to every rank whose facets might be within the radius.
struct Queries
{
  std::vector<std::int64_t> node; ///< local node of each query sent
  std::unique_ptr<Exchange> exchange;
  std::vector<double> data; ///< received: x, normal, [query][6]
};

/// Ranks whose boxes meet that of all points.
std::vector<int> ranks_near(std::span<const Box> boxes, std::span<const double> x)
{
  std::vector<int> out;
  const Box box = box_of(x);
  for (std::size_t r = 0; r < boxes.size(); ++r)
    if (meet(boxes[r], box))
      out.push_back(static_cast<int>(r));
  return out;
}

/// Sends the nodes that may be near facets of other ranks; the others are `here`: they may be near
/// this rank's facets alone.
Queries send_queries(const Surface& nodes, const Surface& surface, double radius,
                     std::vector<std::size_t>& here)
{
  const std::vector<Box> boxes = surface.rank_boxes(radius);
  Queries q;
  std::vector<int> dest, near;
  std::vector<double> data;
  const Nodes& n = nodes.nodes();
  const std::vector<int> neighbours = ranks_near(boxes, n.x);
  here.reserve(n.size());
  for (std::size_t k = 0; k < n.size(); ++k)
  {
    const Box box = box_of(std::span(n.x).subspan(3 * k, 3));
    near.clear();
    for (int r : neighbours)
      if (meet(boxes[r], box))
        near.push_back(r);
    if (near.size() == 1 && near[0] == surface.rank())
    {
      here.push_back(k);
      continue;
    }
    for (int r : near)
    {
      q.node.push_back(static_cast<std::int64_t>(k));
      dest.push_back(r);
      append_record(data, n.x, k, 3);
      append_record(data, n.normal, k, 3);
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

  void append(std::int64_t q, const Surface& s, const Candidate& c, bool is_beside)
  {
    query.push_back(q);
    const Vec3 n = s.normal(c.facet, c.point.xi);
    const auto N = shape_functions(s.type(), c.point.xi);
    values.insert(values.end(), {c.point.distance, s.facets().size[c.facet], 1.0 * is_beside});
    values.insert(values.end(), c.point.x.begin(), c.point.x.end());
    values.insert(values.end(), n.begin(), n.end());
    values.insert(values.end(), N.begin(), N.begin() + nv);
    const auto v = s.facet_x(c.facet);
    const auto name = name_of(v);
    values.insert(values.end(), name.begin(), name.begin() + v.size());
    append_record(dofs, s.facets().vertex_dofs, c.facet, nv * gdim);
    append_record(owner, s.facets().vertex_owner, c.facet, nv);
  }
};

Answers answer_queries(const Surface& surface, LocalSearch& search, const Queries& q)
{
  // The sender numbers its queries; the answer carries that number and the sender's rank back.
  std::vector<std::int64_t> numbers(2 * q.node.size());
  for (std::size_t i = 0; i < q.node.size(); ++i)
  {
    numbers[2 * i] = surface.rank();
    numbers[2 * i + 1] = static_cast<std::int64_t>(i);
  }
  const auto received = q.exchange->forward<std::int64_t>(numbers, 2);

  Answers mine{surface.num_vertices(), surface.gdim(), {}, {}, {}, {}};
  std::vector<int> dest;
  for (std::size_t i = 0; i < q.exchange->num_received(); ++i)
  {
    const double* d = q.data.data() + 6 * i;
    const Vec3 p{d[0], d[1], d[2]};
    for (const Candidate& c : search.candidates(p, {d[3], d[4], d[5]}))
    {
      dest.push_back(static_cast<int>(received[2 * i]));
      mine.append(received[2 * i + 1], surface, c, search.beside(c, p));
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
/// Answer with a facet of this rank.
void take(ClosestFacets& out, std::size_t k, const Surface& surface, const Candidate& c)
{
  const std::size_t nv = surface.num_vertices(), width = nv * surface.gdim();
  const Vec3 n = surface.normal(c.facet, c.point.xi);
  const auto N = shape_functions(surface.type(), c.point.xi);
  out.found[k] = 1;
  std::ranges::copy(c.point.x, out.x.begin() + 3 * k);
  std::ranges::copy(n, out.normal.begin() + 3 * k);
  std::copy_n(N.begin(), nv, out.shape_values.begin() + nv * k);
  std::copy_n(surface.facets().vertex_dofs.begin() + c.facet * width, width,
              out.dofs.begin() + k * width);
  std::copy_n(surface.facets().vertex_owner.begin() + c.facet * nv, nv, out.owner.begin() + k * nv);
}

/// Answer with what a rank has sent.
void take(ClosestFacets& out, std::size_t k, const Answers& a, std::size_t answer)
{
  const std::size_t nv = a.nv, width = nv * a.gdim;
  const auto v = a.value(answer);
  out.found[k] = 1;
  std::copy_n(v.begin() + 3, 3, out.x.begin() + 3 * k);
  std::copy_n(v.begin() + 6, 3, out.normal.begin() + 3 * k);
  std::copy_n(v.begin() + 9, nv, out.shape_values.begin() + nv * k);
  std::copy_n(a.dofs.begin() + answer * width, width, out.dofs.begin() + k * width);
  std::copy_n(a.owner.begin() + answer * nv, nv, out.owner.begin() + k * nv);
}
} // namespace

ClosestFacets qsdolfinx::closest_facets(const Surface& nodes, const Surface& surface, double radius)
{
  const Nodes& from = nodes.nodes();
  const std::size_t n = from.size(), nv = surface.num_vertices(), gdim = surface.gdim();
  ClosestFacets out{std::vector<std::uint8_t>(n, 0), std::vector<std::int64_t>(n * nv * gdim, -1),
                    std::vector<int>(n * nv, -1),    std::vector<double>(n * nv, 0),
                    std::vector<double>(n * 3, 0),   std::vector<double>(n * 3, 0)};
  std::vector<std::size_t> here;
  const Queries q = send_queries(nodes, surface, radius, here);
  LocalSearch search(surface, radius);
  const Answers a = answer_queries(surface, search, q);
  const auto best = choose(a, q, n);
  for (std::size_t k = 0; k < n; ++k)
    if (best[k] >= 0 && !a.beside(best[k]))
      take(out, k, a, best[k]);
  for (std::size_t k : here)
  {
    const Vec3 p = facet_vertex(from.x, static_cast<int>(k));
    const Candidate* c = search.closest(p, facet_vertex(from.normal, static_cast<int>(k)));
    if (c && !search.beside(*c, p))
      take(out, k, surface, *c);
  }
  return out;
}
