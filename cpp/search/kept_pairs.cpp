#include "search/kept_pairs.h"
#include "geometry/planar.h"

#include <algorithm>
#include <array>
#include <cmath>

using namespace qsdolfinx;

namespace
{
/// Largest change of a coordinate.
double motion(std::span<const double> now, std::span<const double> before)
{
  double most = 0;
  for (std::size_t i = 0; i < now.size(); ++i)
    most = std::max(most, std::abs(now[i] - before[i]));
  return most;
}

/// Mean size of the facets of both surfaces. Collective.
double mean_size(const Surface& slave, const Surface& master)
{
  std::array<double, 2> sum{0, 0};
  for (const Surface* surface : {&slave, &master})
    for (double size : surface->facets().size)
    {
      sum[0] += size;
      sum[1] += 1;
    }
  MPI_Allreduce(MPI_IN_PLACE, sum.data(), 2, MPI_DOUBLE, MPI_SUM, slave.comm());
  return sum[0] / std::max(sum[1], 1.0);
}

/// All that is known of copied facets except for their positions on curved edges. Collective.
NearbyFacets copy_all(const Surface& from, const Copying& to)
{
  const Facets& facets = from.facets();
  const int nv = from.num_vertices(), nt = from.num_trace(), d = from.block();
  const auto copy = [&to]<typename T>(const std::vector<T>& values, int width)
  { return to.copy(std::span<const T>(values), width); };
  NearbyFacets out{{from.type(), copy(facets.x, nv * 3), copy(facets.orientation, 1)},
                   from.degree(),
                   nt,
                   d,
                   copy(facets.dofs, nt * d),
                   copy(facets.owner, nt),
                   copy(facets.vertex_side, nv),
                   {},
                   {}};
  if (from.follows())
    out.trace_x = copy(facets.trace_x, nt * 3);
  if (from.touches_itself())
    out.key = copy(from.keys(), static_cast<int>(key_size));
  return out;
}

FacetCopies copy_places(const Surface& from, const Copying& to)
{
  return {from.type(), to.copy(std::span(from.facets().x), from.num_vertices() * 3),
          to.copy(std::span(from.facets().orientation), 1)};
}
} // namespace

Copying::Copying(const Surface& from, std::span<const Box> boxes)
{
  std::vector<int> dest;
  facets_in_boxes(from, boxes, dest, facets_);
  exchange_ = std::make_unique<Exchange>(from.comm(), dest);
}

NormalLine::NormalLine(const Frame& frame, std::span<const double> x, double radius)
{
  double furthest = 0;
  for (std::size_t i = 0; i < x.size() / 3; ++i)
    furthest = std::max(furthest, norm(facet_vertex(x, static_cast<int>(i)) - frame.origin));
  width = 1.001 * furthest;                               // for rounding
  const Vec3 reach = 2 * (radius + width) * frame.normal; // out of the facet's box
  start = frame.origin - reach;
  way = 2 * reach;
}

void PairsOfCut::Lists::append(const BoxTree& tree, const LinePart& line)
{
  const auto first = static_cast<std::ptrdiff_t>(facet.size());
  tree.along(line, [this](std::size_t g) { facet.push_back(g); });
  std::sort(facet.begin() + first, facet.end());
  end.push_back(facet.size());
}

PairsOfCut::PairsOfCut(const Surface& cut, const Surface& other, double radius, double skin)
    : radius_(radius), from_other_(other, cut.rank_boxes(radius + skin)),
      from_own_(cut, cut.rank_boxes(2 * (radius + skin))), nearby_(copy_all(other, from_other_)),
      own_(copy_places(cut, from_own_)), boxes_(facet_boxes(nearby_.type, nearby_.x)),
      own_boxes_(facet_boxes(own_.type, own_.x))
{
  const bool of_itself = cut.touches_itself() && other.touches_itself();
  const FacetView others = view_of_nearby(), own = view_of_own();
  lines_.reserve(cut.num_facets());
  for (std::size_t f = 0; f < cut.num_facets(); ++f)
  {
    const NormalLine& line
        = lines_.emplace_back(Frame(cut.type(), cut.facet_x(f)), cut.facet_x(f), radius);
    others_.append(others.tree, line.part(skin));
    if (!of_itself)
      own_lists_.append(own.tree, line.part(2 * skin)); // both move
  }
}

void PairsOfCut::follow(const Surface& cut, const Surface& other)
{
  const auto nv = static_cast<std::size_t>(other.num_vertices()),
             nt = static_cast<std::size_t>(other.num_trace());
  nearby_.trace_x = copy(std::span(other.facets().trace_x), other.num_trace() * 3);
  for (std::size_t g = 0; g < nearby_.size(); ++g) // vertices come first
    std::copy_n(nearby_.trace_x.begin() + g * nt * 3, nv * 3, nearby_.x.begin() + g * nv * 3);
  own_.x = from_own_.copy(std::span(cut.facets().x), cut.num_vertices() * 3);
  boxes_ = facet_boxes(nearby_.type, nearby_.x);
  own_boxes_ = facet_boxes(own_.type, own_.x);
  tree_.moved();
  own_tree_.moved();
}

double PairsOfCut::motion_of_lines(const Surface& cut) const
{
  double most = 0;
  for (std::size_t f = 0; f < lines_.size(); ++f)
  {
    const NormalLine now(Frame(cut.type(), cut.facet_x(f)), cut.facet_x(f), radius_),
        &before = lines_[f];
    const double ends = std::max(motion(now.start, before.start),
                                 motion(now.start + now.way, before.start + before.way));
    most = std::max(most, ends + std::max(now.width - before.width, 0.0));
  }
  return most;
}

void PairsOfCut::find_others(const Surface& cut, std::size_t facet, const Frame& frame,
                             std::vector<std::size_t>& out) const
{
  const auto x = cut.facet_x(facet);
  const LinePart line = NormalLine(frame, x, radius_).part();
  const Box wide = widened(box_of(x), radius_);
  out.clear();
  for (std::size_t g : others_.of(facet))
  {
    if (meet(wide, boxes_[g]) && line.meets(boxes_[g]))
      out.push_back(g);
  }
}

void PairsOfCut::find_own(std::size_t facet, const Box& box, std::vector<std::size_t>& out) const
{
  out.clear();
  if (own_lists_.end.empty())
    return;
  for (std::size_t g : own_lists_.of(facet))
    if (meet(box, own_boxes_[g]))
      out.push_back(g);
}

KeptPairs::KeptPairs(const SearchRadius& radius, double skin) : radius_(radius), part_(skin) {}

void KeptPairs::find(const Surface& slave, const Surface& master, bool both)
{
  ++num_evaluations_;
  if (are_complete(slave, master))
  {
    of_slave_->follow(slave, master);
    if (of_master_)
      of_master_->follow(master, slave);
    return;
  }
  ++num_searches_;
  skin_ = part_ > 0 ? part_ * mean_size(slave, master) : 0.0;
  of_slave_ = std::make_unique<PairsOfCut>(slave, master, radius_.largest, skin_);
  of_master_ = both ? std::make_unique<PairsOfCut>(master, slave, radius_.largest, skin_) : nullptr;
  if (part_ > 0)
  {
    slave_x_ = slave.facets().x;
    master_x_ = master.facets().x;
  }
}

bool KeptPairs::are_complete(const Surface& slave, const Surface& master) const
{
  if (!of_slave_ || part_ == 0)
    return false;
  // A facet meets a line now only if it was within this distance of it at the search: each point of
  // the line has moved at most as far as its ends.
  std::array<double, 2> moved{motion(slave.facets().x, slave_x_),
                              motion(master.facets().x, master_x_)};
  moved[0] = std::max(moved[0], of_slave_->motion_of_lines(slave));
  if (of_master_)
    moved[1] = std::max(moved[1], of_master_->motion_of_lines(master));
  MPI_Allreduce(MPI_IN_PLACE, moved.data(), 2, MPI_DOUBLE, MPI_MAX, slave.comm());
  return moved[0] + moved[1] < skin_;
}
