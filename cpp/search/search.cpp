#include "search/search.h"
#include "parallel/exchange.h"
#include "parallel/records.h"
#include "search/local_search.h"
#include "search/screen.h"
#include "search/way_out.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

using namespace qsdolfinx;

namespace
{
/// Depth, as a fraction of the facet size, from which a node is checked for facets in between.
constexpr double deep_part = 0.5;

/// Value of Question::beyond for the first query: the closest facet at any distance, wherever the
/// node's projection is.
constexpr double any_distance = -1;

/// Closest points of equally close facets are the same point if their distance is less than this
/// many times the tolerance for equal distances.
constexpr double same_point = 1e4;

/// A query for the partner of a node.
struct Question
{
  std::size_t node;
  double beyond; ///< any_distance, or: only facets in front and further away than this
};

/// Questions sent to every rank whose facets might be within the radius.
struct Queries
{
  std::vector<std::int64_t> node; ///< local node of each query sent
  std::unique_ptr<Exchange> exchange;
  std::vector<double> data; ///< received: x, normal, beyond, [query][7]
};

Places places_of(const Nodes& nodes) { return {nodes.x, nodes.normal, nodes.facet_size}; }

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

/// Send the queries of nodes that may be near facets of other ranks. The other queries are returned
/// in `here`: their nodes can only be near facets of this rank.
Queries send_queries(const Places& n, const Surface& surface, std::span<const Box> boxes,
                     std::span<const Question> questions, std::vector<Question>& here)
{
  Queries q;
  std::vector<int> dest, near;
  std::vector<double> data;
  const std::vector<int> neighbours = ranks_near(boxes, n.x);
  here.reserve(questions.size());
  for (const Question& question : questions)
  {
    const std::size_t k = question.node;
    const Box box = box_of(n.x.subspan(3 * k, 3));
    near.clear();
    for (int r : neighbours)
      if (meet(boxes[r], box))
        near.push_back(r);
    if (near.size() == 1 && near[0] == surface.rank())
    {
      here.push_back(question);
      continue;
    }
    for (int r : near)
    {
      q.node.push_back(static_cast<std::int64_t>(k));
      dest.push_back(r);
      for (const auto& values : {n.x, n.normal})
        data.insert(data.end(), values.begin() + 3 * k, values.begin() + 3 * k + 3);
      data.push_back(question.beyond);
    }
  }
  q.exchange = std::make_unique<Exchange>(surface.comm(), dest);
  q.data = q.exchange->forward<double>(data, 7);
  return q;
}

/// Coordinates of the nodes of a facet's trace, as far as they are known.
std::span<const double> nodes_of(const Surface& s, std::size_t facet)
{
  const auto size = static_cast<std::size_t>(3 * s.num_trace());
  return s.follows() ? std::span(s.facets().trace_x).subspan(facet * size, size) : s.facet_x(facet);
}

/// Candidates flattened for sending them back: one record each.
struct Answers
{
  int nv, nt, block;
  std::vector<std::int64_t> query; ///< query it answers, in the asking rank's numbering
  /// Distance, size, beside, x, normal, ξ, N, sorted vertices, nodes.
  std::vector<double> values;
  std::vector<std::int64_t> dofs; ///< [record][trace node][block]
  std::vector<int> owner;         ///< [record][trace node]
  std::vector<std::uint8_t> side; ///< [record][vertex], if requested

  int width() const { return 11 + nt + 3 * nv + 3 * nt; }
  std::span<const double> value(std::size_t i) const
  {
    return std::span(values).subspan(i * width(), width());
  }
  double size(std::size_t i) const { return values[i * width() + 1]; }
  double distance(std::size_t i) const { return values[i * width()]; }
  bool beside(std::size_t i) const { return values[i * width() + 2] != 0; }
  Vec3 x(std::size_t i) const { return {value(i)[3], value(i)[4], value(i)[5]}; }
  Vec3 normal(std::size_t i) const { return {value(i)[6], value(i)[7], value(i)[8]}; }
  double tie(std::size_t i) const { return tie_tolerance * size(i); }
  std::span<const double> name(std::size_t i) const { return value(i).subspan(11 + nt, 3 * nv); }
  std::span<const double> nodes(std::size_t i) const { return value(i).subspan(11 + nt + 3 * nv); }

  void append(std::int64_t q, const Surface& s, const Candidate& c, bool is_beside,
              const std::vector<std::uint8_t>* sides)
  {
    query.push_back(q);
    const Vec3 n = s.normal(c.facet, c.point.xi);
    const auto N = trace_functions(s.type(), s.degree(), c.point.xi);
    values.insert(values.end(), {c.point.distance, s.facets().size[c.facet], 1.0 * is_beside});
    values.insert(values.end(), c.point.x.begin(), c.point.x.end());
    values.insert(values.end(), n.begin(), n.end());
    values.insert(values.end(), c.point.xi.begin(), c.point.xi.end());
    values.insert(values.end(), N.begin(), N.begin() + nt);
    const auto v = s.facet_x(c.facet);
    const auto name = name_of(v);
    values.insert(values.end(), name.begin(), name.begin() + v.size());
    const auto nodes = nodes_of(s, c.facet);
    values.insert(values.end(), nodes.begin(), nodes.end());
    values.resize(query.size() * width(), 0.0); // degree 2 without updated geometry: no nodes
    append_record(dofs, s.facets().dofs, c.facet, nt * block);
    append_record(owner, s.facets().owner, c.facet, nt);
    if (sides)
      append_record(side, *sides, c.facet, nv);
  }
};

std::span<const Candidate> ask(LocalSearch& search, const Vec3& p, const Vec3& normal,
                               double beyond)
{
  return beyond == any_distance ? search.candidates(p, normal) : search.in_front(p, normal, beyond);
}

Answers answer_queries(const Surface& surface, LocalSearch& search, const Queries& q,
                       const std::vector<std::uint8_t>* sides)
{
  // The sender numbers its queries; the answer carries that number and the sender's rank back.
  std::vector<std::int64_t> numbers(2 * q.node.size());
  for (std::size_t i = 0; i < q.node.size(); ++i)
  {
    numbers[2 * i] = surface.rank();
    numbers[2 * i + 1] = static_cast<std::int64_t>(i);
  }
  const auto received = q.exchange->forward<std::int64_t>(numbers, 2);

  Answers mine{surface.num_vertices(), surface.num_trace(), surface.block(), {}, {}, {}, {}, {}};
  std::vector<int> dest;
  for (std::size_t i = 0; i < q.exchange->num_received(); ++i)
  {
    const double* d = q.data.data() + 7 * i;
    const Vec3 p{d[0], d[1], d[2]}, normal{d[3], d[4], d[5]};
    for (const Candidate& c : ask(search, p, normal, d[6]))
    {
      dest.push_back(static_cast<int>(received[2 * i]));
      mine.append(received[2 * i + 1], surface, c, search.beside(c, p), sides);
    }
  }
  Exchange back(surface.comm(), dest);
  Answers out{mine.nv, mine.nt, mine.block, {}, {}, {}, {}, {}};
  out.query = back.forward<std::int64_t>(mine.query, 1);
  out.values = back.forward<double>(mine.values, mine.width());
  out.dofs = back.forward<std::int64_t>(mine.dofs, mine.nt * mine.block);
  out.owner = back.forward<int>(mine.owner, mine.nt);
  if (sides)
    out.side = back.forward<std::uint8_t>(mine.side, mine.nv);
  return out;
}

/// For every node the largest distance that still counts as equal to the smallest one in the
/// answers.
std::vector<double> limits(const Answers& a, const Queries& q, std::size_t num_nodes)
{
  std::vector<double> limit(num_nodes, std::numeric_limits<double>::infinity());
  for (std::size_t i = 0; i < a.query.size(); ++i)
  {
    double& l = limit[q.node[a.query[i]]];
    l = std::min(l, a.distance(i) + a.tie(i));
  }
  return limit;
}

/// Best answer for every node: the smallest distance; among equal distances within the radius a
/// facet that the node is not beside, and the first in the order of names.
std::vector<std::int64_t> choose(const Answers& a, const Queries& q, const Places& nodes,
                                 const SearchRadius& radius, const std::vector<double>& limit)
{
  const std::size_t num_nodes = limit.size();
  std::vector<std::int64_t> best(num_nodes, -1);
  for (std::size_t i = 0; i < a.query.size(); ++i)
  {
    const std::size_t k = q.node[a.query[i]];
    if (a.distance(i) > limit[k] || a.distance(i) > radius.of(nodes.facet_size(k), a.size(i)))
      continue;
    const auto name = a.name(i);
    if (best[k] >= 0)
    {
      const auto other = a.name(best[k]);
      if (a.beside(i) != a.beside(best[k])
              ? a.beside(i)
              : !std::lexicographical_compare(name.begin(), name.end(), other.begin(), other.end()))
        continue;
    }
    best[k] = static_cast<std::int64_t>(i);
  }
  return best;
}

/// Mean of vertices.
Vec3 middle_of(std::span<const double> x)
{
  Vec3 sum{0, 0, 0};
  const std::size_t n = x.size() / 3;
  for (std::size_t i = 0; i < n; ++i)
    sum = sum + facet_vertex(x, static_cast<int>(i));
  return (1.0 / static_cast<double>(n)) * sum;
}

/// Store a facet of this rank as the result for node k.
void take(ClosestFacets& out, std::size_t k, const Surface& surface, const Candidate& c,
          const std::vector<std::uint8_t>* sides)
{
  const std::size_t nv = surface.num_vertices(), nt = surface.num_trace();
  const std::size_t width = nt * surface.block();
  const Vec3 n = surface.normal(c.facet, c.point.xi);
  const auto N = trace_functions(surface.type(), surface.degree(), c.point.xi);
  out.found[k] = 1;
  std::ranges::copy(c.point.x, out.x.begin() + 3 * k);
  std::ranges::copy(n, out.normal.begin() + 3 * k);
  std::copy_n(N.begin(), nt, out.shape_values.begin() + nt * k);
  std::copy_n(surface.facets().dofs.begin() + c.facet * width, width, out.dofs.begin() + k * width);
  std::copy_n(surface.facets().owner.begin() + c.facet * nt, nt, out.owner.begin() + k * nt);
  std::ranges::copy(middle_of(surface.facet_x(c.facet)), out.middle.begin() + 3 * k);
  std::ranges::copy(c.point.xi, out.xi.begin() + 2 * k);
  std::ranges::copy(nodes_of(surface, c.facet), out.nodes_x.begin() + 3 * nt * k);
  if (sides)
    std::copy_n(sides->begin() + c.facet * nv, nv, out.side.begin() + k * nv);
}

/// Store an answer of another rank as the result for node k.
void take(ClosestFacets& out, std::size_t k, const Answers& a, std::size_t answer)
{
  const std::size_t nv = a.nv, nt = a.nt, width = nt * a.block;
  const auto v = a.value(answer);
  out.found[k] = 1;
  std::copy_n(v.begin() + 3, 3, out.x.begin() + 3 * k);
  std::copy_n(v.begin() + 6, 3, out.normal.begin() + 3 * k);
  std::copy_n(v.begin() + 9, 2, out.xi.begin() + 2 * k);
  std::copy_n(v.begin() + 11, nt, out.shape_values.begin() + nt * k);
  std::ranges::copy(a.nodes(answer), out.nodes_x.begin() + 3 * nt * k);
  std::copy_n(a.dofs.begin() + answer * width, width, out.dofs.begin() + k * width);
  std::copy_n(a.owner.begin() + answer * nt, nt, out.owner.begin() + k * nt);
  std::ranges::copy(middle_of(a.name(answer)), out.middle.begin() + 3 * k);
  if (!a.side.empty())
    std::copy_n(a.side.begin() + answer * nv, nv, out.side.begin() + k * nv);
}

/// Search for the partners of nodes or other points of one surface on another surface.
class NodeSearch
{
public:
  NodeSearch(const Surface& from, const Places& places, const Surface& surface,
             const SearchRadius& radius, bool opposite, const std::vector<std::uint8_t>* sides)
      : from_(from), surface_(surface), nodes_(places), radius_(radius),
        boxes_(surface.rank_boxes(radius.largest)), search_(surface, radius.largest, opposite),
        sides_(sides), refused_(nodes_.size(), 0), near_back_(nodes_.size(), 0),
        num_equal_(nodes_.size(), 0), sizes_(nodes_.size(), 0)
  {
    const std::size_t n = nodes_.size(), block = surface.block();
    const std::size_t nv = surface.num_vertices(), nt = surface.num_trace();
    out_ = {std::vector<std::uint8_t>(n, 0),
            std::vector<std::int64_t>(n * nt * block, -1),
            std::vector<int>(n * nt, -1),
            std::vector<double>(n * nt, 0),
            std::vector<double>(n * 3, 0),
            std::vector<double>(n * 3, 0),
            std::vector<double>(n * 3, 0),
            std::vector<double>(n * 3, 0),
            std::vector<double>(n * 2, 0),
            std::vector<double>(n * nt * 3, 0),
            std::vector<std::uint8_t>(sides ? n * nv : 0, 0)};
  }

  ClosestFacets run()
  {
    std::vector<Question> questions;
    for (std::size_t k = 0; k < nodes_.size(); ++k)
      questions.push_back({k, any_distance});
    // In each iteration the answers are further away, so that there are soon no facets left in
    // front.
    while (any(!questions.empty()))
    {
      find(questions);
      refuse_shorter_ways_out(questions);
      hide(questions);
      questions = asked_again(questions);
    }
    return std::move(out_);
  }

private:
  bool any(bool here) const
  {
    int flag = here;
    MPI_Allreduce(MPI_IN_PLACE, &flag, 1, MPI_INT, MPI_LOR, surface_.comm());
    return flag != 0;
  }

  Vec3 at(std::span<const double> values, std::size_t k) const
  {
    return facet_vertex(values, static_cast<int>(k));
  }

  void find(std::span<const Question> questions)
  {
    std::vector<Question> here;
    const Queries q = send_queries(nodes_, surface_, boxes_, questions, here);
    const Answers a = answer_queries(surface_, search_, q, sides_);
    const auto limit = limits(a, q, nodes_.size());
    const auto best = choose(a, q, nodes_, radius_, limit);
    for (std::int64_t k : q.node)
      near_back_[k] = 1; // not known from other ranks
    for (std::size_t k = 0; k < best.size(); ++k)
      if (best[k] >= 0)
      {
        take(out_, k, a, best[k]);
        refused_[k] = a.beside(best[k]);
        sizes_[k] = a.size(best[k]);
        num_equal_[k] = 0;
      }
    for (std::size_t i = 0; i < a.query.size(); ++i)
      if (const std::size_t k = q.node[a.query[i]]; a.distance(i) <= limit[k])
        add_normal(k, a.x(i), a.normal(i), a.tie(i));
    for (const auto [k, beyond] : here)
    {
      const Vec3 p = at(nodes_.x, k);
      const auto found = ask(search_, p, at(nodes_.normal, k), beyond);
      near_back_[k] = beyond != any_distance || search_.saw_back();
      ties_.clear();
      for (const Candidate& c : found)
        if (c.point.distance <= radius_.of(nodes_.facet_size(k), surface_.facets().size[c.facet]))
          ties_.push_back(c);
      if (const Candidate* c = search_.best(ties_, p))
      {
        take(out_, k, surface_, *c, sides_);
        refused_[k] = search_.beside(*c, p);
        sizes_[k] = surface_.facets().size[c->facet];
        num_equal_[k] = 0;
        for (const Candidate& t : ties_)
          add_normal(k, t.point.x, surface_.normal(t.facet, t.point.xi), search_.tie(t.facet));
      }
    }
  }

  /// Add the normal of a facet that is as close as the chosen facet to the mean normal, if its
  /// closest point is the same.
  void add_normal(std::size_t k, const Vec3& x, const Vec3& normal, double tie)
  {
    if (norm(x - at(out_.x, k)) > same_point * tie)
      return;
    const double part = 1.0 / ++num_equal_[k];
    for (std::size_t i = 0; i < 3; ++i)
    {
      double& mean = out_.mean_normal[3 * k + i];
      mean = (num_equal_[k] == 1 ? 0.0 : (1 - part) * mean) + part * normal[i];
    }
  }

  /// Refuse facets that nodes seem to be behind, but through which they have not entered the body.
  void refuse_shorter_ways_out(std::span<const Question> questions)
  {
    std::vector<std::size_t> deep;
    std::vector<Overlap> overlaps;
    for (const Question& question : questions)
    {
      const std::size_t k = question.node;
      if (!out_.found[k] || refused_[k])
        continue;
      const Vec3 x = at(nodes_.x, k), y = at(out_.x, k), n = at(out_.normal, k);
      const double depth = dot(y - x, n);
      if (!(depth > shallow_tolerance * sizes_[k]))
        continue;
      deep.push_back(k);
      overlaps.push_back(
          {x, y, n, norm(y - x - depth * n) > touch_tolerance * sizes_[k], at(nodes_.normal, k)});
    }
    if (!any(!deep.empty()))
      return;
    const auto shorter = have_shorter_ways_out(from_, surface_, overlaps);
    for (std::size_t i = 0; i < deep.size(); ++i)
      refused_[deep[i]] = shorter[i];
  }

  /// Refuse hidden partners. If facets of the node's own surface hide them, the node stays
  /// unpaired; otherwise a partner further away is searched.
  void hide(std::span<const Question> questions)
  {
    std::vector<std::size_t> found, near_back;
    for (const Question& question : questions)
      if (const std::size_t k = question.node; out_.found[k] && !refused_[k])
        found.push_back(k);
    const auto by_own = hidden(from_, lines(found), Screens::own);
    for (std::size_t i = 0; i < found.size(); ++i)
      if (by_own[i])
        out_.found[found[i]] = 0;
      else if (near_back_[found[i]] || is_deep(found[i]))
        near_back.push_back(found[i]);
    if (!any(!near_back.empty()))
      return;
    const auto by_backs = hidden(surface_, lines(near_back), Screens::backs);
    for (std::size_t i = 0; i < near_back.size(); ++i)
      refused_[near_back[i]] = by_backs[i];
  }

  /// Whether a node seems to be far behind the facet that was found.
  bool is_deep(std::size_t k) const
  {
    return dot(at(out_.x, k) - at(nodes_.x, k), at(out_.normal, k)) > deep_part * sizes_[k];
  }

  std::vector<Sight> lines(std::span<const std::size_t> nodes) const
  {
    std::vector<Sight> out;
    for (std::size_t k : nodes)
      out.push_back({at(nodes_.x, k), at(out_.x, k), at(nodes_.normal, k), is_deep(k)});
    return out;
  }

  /// New queries for the nodes whose partners were refused.
  std::vector<Question> asked_again(std::span<const Question> questions)
  {
    std::vector<Question> out;
    for (const Question& question : questions)
      if (const std::size_t k = question.node; refused_[k])
      {
        refused_[k] = out_.found[k] = 0;
        out.push_back({k, norm(at(out_.x, k) - at(nodes_.x, k))});
      }
    return out;
  }

  const Surface &from_, &surface_;
  Places nodes_;
  SearchRadius radius_;
  std::vector<Box> boxes_;
  LocalSearch search_;
  const std::vector<std::uint8_t>* sides_; ///< null if not requested
  std::vector<Candidate> ties_;
  ClosestFacets out_;
  std::vector<std::uint8_t> refused_;   ///< beside the facet found, hidden, or with a shorter way
                                        ///< out
  std::vector<std::uint8_t> near_back_; ///< whether a back may be nearer than the facet found
  std::vector<int> num_equal_;          ///< facets with the same closest point as the one found
  std::vector<double> sizes_;           ///< of the facet found
};
} // namespace

ClosestFacets qsdolfinx::closest_facets(const Surface& nodes, const Surface& surface,
                                        const SearchRadius& radius,
                                        const std::vector<std::uint8_t>* sides)
{
  return NodeSearch(nodes, places_of(nodes.nodes()), surface, radius, false, sides).run();
}

ClosestFacets qsdolfinx::closest_facets(const Places& points, const Surface& own,
                                        const Surface& surface, const SearchRadius& radius)
{
  return NodeSearch(own, points, surface, radius, false, nullptr).run();
}

ClosestFacets qsdolfinx::closest_opposite(const Surface& of_places, const Nodes& places,
                                          const Surface& surface, const SearchRadius& radius,
                                          const std::vector<std::uint8_t>* sides)
{
  return NodeSearch(of_places, places_of(places), surface, radius, true, sides).run();
}
