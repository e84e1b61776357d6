#include "surface/surface.h"
#include "parallel/petsc.h"
#include "parallel/records.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <stdexcept>

using namespace qsdolfinx;

namespace
{
/// Boundary of a facet: its edges, given by their vertices; for an interval its two ends.
std::span<const std::array<int, 2>> edges_of(FacetType type)
{
  static constexpr std::array<std::array<int, 2>, 2> ends{{{0, 0}, {1, 1}}};
  return type == FacetType::interval ? std::span<const std::array<int, 2>>(ends)
                                     : facet_edges(type);
}

/// ∫ N_i da over one facet, da the outward area vector: per vertex the scalar area and the vector.
/// Exact for planar facets, also of rings; 3 × 3 Gauss points on the quadrilateral.
std::array<std::array<double, 4>, 4> vertex_areas(const Surface& surface, std::size_t facet)
{
  const FacetType type = surface.type();
  const std::span<const double> v = surface.facet_x(facet);
  const double orientation = surface.facets().orientation[facet];
  std::array<std::array<double, 4>, 4> out{};
  const int nv = static_cast<int>(type);
  const auto add = [&](std::array<double, 2> xi, double weight)
  {
    const Vec3 a = surface.area_factor(facet_point(type, v, xi)) * area_vector(type, v, xi);
    const auto N = shape_functions(type, xi);
    for (int i = 0; i < nv; ++i)
    {
      out[i][0] += weight * N[i] * norm(a);
      for (int j = 0; j < 3; ++j)
        out[i][1 + j] += weight * N[i] * orientation * a[j];
    }
  };
  if (type == FacetType::interval)
  {
    const double g = 0.5 / std::sqrt(3.0); // the radius of a ring is linear, as N_i is
    add({0.5 - g, 0}, 0.5);
    add({0.5 + g, 0}, 0.5);
  }
  else if (type == FacetType::triangle)
    add({1.0 / 3, 1.0 / 3}, 0.5);
  else
  {
    const double g = 0.5 * std::sqrt(0.6);
    const std::array<double, 3> points{0.5 - g, 0.5, 0.5 + g},
        weights{5.0 / 18, 8.0 / 18, 5.0 / 18};
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        add({points[i], points[j]}, weights[i] * weights[j]);
  }
  return out;
}
} // namespace

Surface::Surface(MPI_Comm comm, int gdim, int block, FacetType type, std::span<const double> x,
                 int degree, std::span<const std::int64_t> dofs, std::span<const int> owner,
                 std::span<const double> inside, std::int64_t local_size, bool axisymmetric,
                 bool touches_itself, std::span<const double> key)
    : gdim_(gdim), block_(block), type_(type), degree_(degree), axisymmetric_(axisymmetric),
      local_size_(local_size), touches_itself_(touches_itself), key_(key.begin(), key.end())
{
  facets_.x.assign(x.begin(), x.end());
  facets_.dofs.assign(dofs.begin(), dofs.end());
  facets_.owner.assign(owner.begin(), owner.end());
  const int nv = num_vertices(), nt = num_trace();
  for (std::size_t f = 0; f < inside.size() / 3; ++f)
  {
    const std::size_t first = f * nt;
    facets_.vertex_dofs.insert(facets_.vertex_dofs.end(), dofs.begin() + first * block,
                               dofs.begin() + (first + nv) * block);
    facets_.vertex_owner.insert(facets_.vertex_owner.end(), owner.begin() + first,
                                owner.begin() + first + nv);
  }
  MPI_Comm_dup(comm, &comm_);
  // mpi4py's communicators return error codes, which are not checked here.
  MPI_Comm_set_errhandler(comm_, MPI_ERRORS_ARE_FATAL);
  MPI_Comm_rank(comm_, &rank_);
  number_nodes();
  orient_and_measure(inside);
  measure_nodes();
  mark_boundary();
  find_sides();
}

void Surface::move(std::span<const double> x, std::span<const double> inside)
{
  if (x.size() != facets_.x.size())
    throw std::invalid_argument("Surface::move: the number of coordinates has changed");
  std::ranges::copy(x, facets_.x.begin());
  tree_.moved();
  orient_and_measure(inside);
  measure_nodes();
}

void Surface::follow(std::span<const double> trace_x)
{
  const auto nv = static_cast<std::size_t>(num_vertices()),
             nt = static_cast<std::size_t>(num_trace());
  if (trace_x.size() != num_facets() * nt * 3)
    throw std::invalid_argument("Surface::follow: one position for each trace node of each facet");
  follows_ = true;
  facets_.trace_x.assign(trace_x.begin(), trace_x.end());
  for (std::size_t f = 0; f < num_facets(); ++f)
  {
    std::copy_n(trace_x.begin() + f * nt * 3, nv * 3, facets_.x.begin() + f * nv * 3);
    facets_.size[f] = std::sqrt(squared_size(type_, facet_x(f)));
  }
  tree_.moved();
}

Surface::~Surface()
{
  to_owner_.reset();
  if (petsc_is_running())
    MPI_Comm_free(&comm_);
}

void Surface::orient_and_measure(std::span<const double> inside)
{
  const std::size_t n = inside.size() / 3;
  facets_.size.resize(n);
  facets_.orientation.resize(n);
  for (std::size_t f = 0; f < n; ++f)
  {
    const auto v = facet_x(f);
    facets_.size[f] = std::sqrt(squared_size(type_, v));
    const Vec3 outward
        = facet_point(type_, v, facet_centre(type_)) - facet_vertex(inside, static_cast<int>(f));
    facets_.orientation[f] = dot(area_vector(type_, v, facet_centre(type_)), outward) > 0 ? 1 : -1;
  }
}

void Surface::number_nodes()
{
  // A rank may own a node without owning any facet at it: every facet sends its data to its
  // vertices' owners.
  const auto nv = static_cast<std::size_t>(num_vertices());
  std::vector<int> dest;
  for (std::size_t v = 0; v < facets_.vertex_owner.size(); ++v)
  {
    if (touches_itself_ && std::isnan(key_[v / nv * key_size]))
      continue;
    vertices_.push_back(v);
    dest.push_back(facets_.vertex_owner[v]);
  }
  to_owner_ = std::make_unique<Exchange>(comm_, dest);
  const auto dofs = tell_owners(facets_.vertex_dofs, block_);
  std::vector<std::size_t> order(to_owner_->num_received());
  std::iota(order.begin(), order.end(), 0);
  std::ranges::sort(order, {}, [&](std::size_t i) { return dofs[i * block_]; });
  node_of_record_.resize(order.size());
  for (std::size_t i : order)
  {
    if (nodes_.dofs.empty() || dofs[i * block_] != nodes_.dofs[nodes_.dofs.size() - block_])
      nodes_.dofs.insert(nodes_.dofs.end(), &dofs[i * block_], &dofs[i * block_] + block_);
    node_of_record_[i] = nodes_.dofs.size() / block_ - 1;
  }
}

std::vector<std::uint8_t> Surface::answers_of_owners(const std::vector<std::uint8_t>& answers) const
{
  const auto told = to_owner_->reverse<std::uint8_t>(answers, 1);
  std::vector<std::uint8_t> out(facets_.vertex_owner.size(), 0);
  for (std::size_t i = 0; i < told.size(); ++i)
    out[vertices_[i]] = told[i];
  return out;
}

void Surface::measure_nodes()
{
  const int nv = num_vertices();
  constexpr int width = 8; // x, area, area vector, size
  std::vector<double> values(facets_.vertex_owner.size() * width);
  for (std::size_t f = 0; f < num_facets(); ++f)
  {
    const auto areas = vertex_areas(*this, f);
    for (int i = 0; i < nv; ++i)
    {
      double* out = values.data() + (f * nv + i) * width;
      std::copy_n(facets_.x.data() + (f * nv + i) * 3, 3, out);
      std::copy_n(areas[i].data(), 4, out + 3);
      out[7] = facets_.size[f];
    }
  }
  const auto data = tell_owners(values, width);

  const std::size_t n = nodes_.dofs.size() / block_;
  nodes_.x.resize(3 * n);
  nodes_.area.assign(n, 0);
  nodes_.normal.assign(3 * n, 0);
  nodes_.facet_size.assign(n, 0);
  for (std::size_t i = 0; i < node_of_record_.size(); ++i)
  {
    const double* record = data.data() + i * width;
    const std::size_t k = node_of_record_[i];
    std::copy_n(record, 3, nodes_.x.begin() + 3 * k);
    nodes_.area[k] += record[3];
    nodes_.facet_size[k] = std::max(nodes_.facet_size[k], record[7]);
    for (int j = 0; j < 3; ++j)
      nodes_.normal[3 * k + j] += record[4 + j];
  }
  for (std::size_t k = 0; k < n; ++k)
  {
    const Vec3 a = facet_vertex(nodes_.normal, static_cast<int>(k));
    const double length = norm(a);
    for (int j = 0; j < 3; ++j)
      nodes_.normal[3 * k + j] = length > 0 ? a[j] / length : 0.0;
  }
}

void Surface::mark_boundary()
{
  const int nv = num_vertices();
  const auto edges = edges_of(type_);
  const std::size_t ne = edges.size();

  // Each edge is counted on the owner of its vertex with the smaller unknown.
  std::vector<int> dest(num_facets() * ne);
  std::vector<std::int64_t> keys(num_facets() * ne * 2);
  for (std::size_t f = 0; f < num_facets(); ++f)
  {
    for (std::size_t e = 0; e < ne; ++e)
    {
      std::size_t a = f * nv + edges[e][0], b = f * nv + edges[e][1];
      if (facets_.vertex_dofs[b * block_] < facets_.vertex_dofs[a * block_])
        std::swap(a, b);
      dest[f * ne + e] = facets_.vertex_owner[a];
      keys[2 * (f * ne + e)] = facets_.vertex_dofs[a * block_];
      keys[2 * (f * ne + e) + 1] = facets_.vertex_dofs[b * block_];
    }
  }
  Exchange by_edge(comm_, dest);
  const auto received = by_edge.forward<std::int64_t>(keys, 2);
  const auto key = [&](std::size_t i) { return std::pair(received[2 * i], received[2 * i + 1]); };
  std::vector<std::size_t> order(by_edge.num_received());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](auto a, auto b) { return key(a) < key(b); });
  std::vector<std::uint8_t> single(order.size(), 0);
  for (std::size_t r = 0; r < order.size(); ++r)
  {
    const bool shared = (r > 0 && key(order[r - 1]) == key(order[r]))
                        || (r + 1 < order.size() && key(order[r + 1]) == key(order[r]));
    single[order[r]] = !shared;
  }
  facets_.edge_on_boundary = by_edge.reverse<std::uint8_t>(single, 1);

  // For a facet that touches the boundary only with a vertex, this is known only to the vertex's
  // owner.
  std::vector<std::uint8_t> flags(facets_.vertex_owner.size(), 0);
  for (std::size_t f = 0; f < num_facets(); ++f)
    for (std::size_t e = 0; e < ne; ++e)
      if (facets_.edge_on_boundary[f * ne + e])
        flags[f * nv + edges[e][0]] = flags[f * nv + edges[e][1]] = 1;
  auto answers = tell_owners(flags, 1);
  std::vector<std::uint8_t> on_boundary(nodes_.size(), 0);
  for (std::size_t i = 0; i < answers.size(); ++i)
    on_boundary[node_of_record_[i]] |= answers[i];
  for (std::size_t i = 0; i < answers.size(); ++i)
    answers[i] = on_boundary[node_of_record_[i]];
  facets_.vertex_on_boundary = answers_of_owners(answers);
}

void Surface::find_sides()
{
  const int nv = num_vertices();
  std::vector<double> normals;
  normals.reserve(facets_.vertex_owner.size() * 3);
  for (std::size_t f = 0; f < num_facets(); ++f)
  {
    const Vec3 n = normal(f, facet_centre(type_));
    for (int i = 0; i < nv; ++i)
      normals.insert(normals.end(), n.begin(), n.end());
  }
  const auto received = tell_owners(normals, 3);
  const auto normal_of = [&](std::size_t i) { return facet_vertex(received, static_cast<int>(i)); };

  std::vector<std::vector<std::size_t>> records(nodes_.size()); // of each node
  for (std::size_t i = 0; i < node_of_record_.size(); ++i)
    records[node_of_record_[i]].push_back(i);
  std::vector<std::uint8_t> side(node_of_record_.size(), 0);
  for (std::vector<std::size_t>& at_node : records)
  {
    // Sides are numbered along a fixed direction, so that the numbers do not depend on the
    // partition.
    const Vec3 along{0.61803398875, 0.7548776662, 0.2207440846};
    std::ranges::sort(at_node, {}, [&](std::size_t i) { return dot(normal_of(i), along); });
    std::vector<std::size_t> rest = at_node, reached;
    for (int s = 0; !rest.empty(); ++s)
    {
      reached.assign(1, rest.front());
      rest.erase(rest.begin());
      for (std::size_t next = 0; next < reached.size(); ++next)
        std::erase_if(rest,
                      [&](std::size_t i)
                      {
                        const bool smooth
                            = dot(normal_of(i), normal_of(reached[next])) > smooth_cosine;
                        if (smooth)
                          reached.push_back(i);
                        return smooth;
                      });
      for (std::size_t i : reached)
        side[i] = static_cast<std::uint8_t>(std::min(s, gdim_ - 1));
    }
  }
  facets_.vertex_side = answers_of_owners(side);
  int any = std::ranges::any_of(side, [](std::uint8_t s) { return s > 0; });
  MPI_Allreduce(MPI_IN_PLACE, &any, 1, MPI_INT, MPI_LOR, comm_);
  has_creases_ = any;
}

Sides Surface::sides() const
{
  const int nv = num_vertices();
  constexpr int width = 11; // side, x, area, area vector, area times the vector to the middle
  std::vector<double> values(facets_.vertex_owner.size() * width);
  for (std::size_t f = 0; f < num_facets(); ++f)
  {
    const auto areas = vertex_areas(*this, f);
    const Vec3 middle = facet_point(type_, facet_x(f), facet_centre(type_));
    for (int i = 0; i < nv; ++i)
    {
      const std::size_t v = f * nv + i;
      double* out = values.data() + v * width;
      const Vec3 x = facet_vertex(facet_x(f), i), inward = areas[i][0] * (middle - x);
      out[0] = facets_.vertex_side[v];
      std::ranges::copy(x, out + 1);
      std::copy_n(areas[i].data(), 4, out + 4);
      std::ranges::copy(inward, out + 8);
    }
  }
  const auto data = tell_owners(values, width);
  std::vector<double> sums(nodes_.size() * gdim_ * 7, 0.0);
  std::vector<std::uint8_t> creased(nodes_.size(), 0);
  for (std::size_t i = 0; i < node_of_record_.size(); ++i)
  {
    const double* record = data.data() + i * width;
    const auto side = static_cast<std::size_t>(record[0]);
    double* sum = sums.data() + (node_of_record_[i] * gdim_ + side) * 7;
    std::transform(record + 4, record + 11, sum, sum, std::plus{});
    creased[node_of_record_[i]] |= side > 0;
  }
  Sides out;
  for (std::size_t k = 0; k < creased.size(); ++k)
    for (int side = 0; creased[k] && side < gdim_; ++side)
    {
      const double* sum = sums.data() + (k * gdim_ + side) * 7;
      const Vec3 a{sum[1], sum[2], sum[3]}, inward{sum[4], sum[5], sum[6]};
      if (sum[0] <= 0 || norm(a) <= 0)
        continue;
      const Vec3 normal = (1 / norm(a)) * a, middle = (1 / sum[0]) * inward;
      out.node.push_back(k);
      out.side.push_back(static_cast<std::uint8_t>(side));
      append_record(out.at.x, nodes_.x, k, 3);
      out.at.area.push_back(sum[0]);
      out.at.facet_size.push_back(nodes_.facet_size[out.node.back()]);
      append_record(out.at.normal, normal, 0, 3);
      append_record(out.inward, middle, 0, 3);
    }
  return out;
}

std::vector<std::uint8_t> Surface::sides_of_facets(std::span<const std::uint8_t> chosen) const
{
  std::vector<std::uint8_t> flags(node_of_record_.size());
  for (std::size_t i = 0; i < flags.size(); ++i)
    flags[i] = chosen[node_of_record_[i]];
  std::vector<std::uint8_t> out = answers_of_owners(flags);
  for (std::size_t v = 0; v < out.size(); ++v)
    out[v] = out[v] ? facets_.vertex_side[v] : 0;
  return out;
}

Vec3 Surface::normal(std::size_t facet, std::array<double, 2> xi) const
{
  const Vec3 a = area_vector(type_, facet_x(facet), xi);
  return (facets_.orientation[facet] / norm(a)) * a;
}

bool Surface::on_surface_boundary(std::size_t facet, std::array<double, 2> xi) const
{
  // On an edge, the shape functions of the vertices that are not on it vanish.
  constexpr double tolerance = 1e-12;
  const auto N = shape_functions(type_, xi);
  const int nv = num_vertices();
  for (int i = 0; i < nv; ++i)
    if (N[i] > 1 - tolerance)
      return facets_.vertex_on_boundary[facet * nv + i];
  const auto edges = edges_of(type_);
  for (std::size_t e = 0; e < edges.size(); ++e)
    if (N[edges[e][0]] + N[edges[e][1]] > 1 - tolerance && edges[e][0] != edges[e][1])
      return facets_.edge_on_boundary[facet * edges.size() + e];
  return false;
}

std::vector<Box> qsdolfinx::boxes_of_ranks(MPI_Comm comm, const Box& box)
{
  constexpr int width = sizeof(Box) / sizeof(double);
  int size;
  MPI_Comm_size(comm, &size);
  std::vector<Box> boxes(static_cast<std::size_t>(size));
  MPI_Allgather(&box, width, MPI_DOUBLE, boxes.data(), width, MPI_DOUBLE, comm);
  return boxes;
}

std::vector<Box> Surface::rank_boxes(double radius) const
{
  return boxes_of_ranks(comm_, widened(box_of(facets_.x), radius));
}

std::array<double, 2> Surface::facet_size_range() const
{
  double low = std::numeric_limits<double>::infinity(), high = 0;
  for (std::size_t f = 0; f < facets_.size.size(); ++f)
  {
    if (touches_itself_ && std::isnan(key_[f * key_size]))
      continue;
    low = std::min(low, facets_.size[f]);
    high = std::max(high, facets_.size[f]);
  }
  MPI_Allreduce(MPI_IN_PLACE, &low, 1, MPI_DOUBLE, MPI_MIN, comm_);
  MPI_Allreduce(MPI_IN_PLACE, &high, 1, MPI_DOUBLE, MPI_MAX, comm_);
  return {low, high};
}

std::size_t Surface::node_index(std::int64_t first_dof) const
{
  std::size_t low = 0, high = nodes_.size();
  while (low < high)
  {
    const std::size_t middle = (low + high) / 2;
    if (nodes_.dofs[middle * block_] < first_dof)
      low = middle + 1;
    else
      high = middle;
  }
  if (low == nodes_.size() || nodes_.dofs[low * block_] != first_dof)
    throw std::logic_error("Surface::node_index: this rank does not own the node");
  return low;
}
