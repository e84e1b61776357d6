#include "pairing/cover.h"
#include "parallel/exchange.h"

#include <algorithm>
#include <map>
#include <utility>

using namespace qsdolfinx;

namespace
{
/// Multiplier of a slave node: the node's first unknown, and the smooth side it belongs to.
struct Multiplier
{
  std::int64_t dof;
  std::uint8_t side;
  auto operator<=>(const Multiplier&) const = default;
};

/// Multipliers at the points of this rank, and the covered fractions of their areas.
class Covers
{
public:
  Covers(const PairingPoints& points, const Surface& slave) : points_(points)
  {
    add_up();
    complete(slave);
  }

  Multiplier multiplier(std::size_t point, int vertex) const
  {
    const std::size_t at = point * points_.slave.num_nodes + vertex;
    return {points_.slave.dofs[at * points_.block],
            points_.multiplier_side[point * points_.num_multipliers + vertex]};
  }
  /// Covered fraction of the area of a point's multiplier, summed over the points of all ranks.
  double operator()(std::size_t point, int vertex) const
  {
    return found_.at(multiplier(point, vertex)).cover;
  }
  /// Number of multipliers of this rank whose covered fraction is less than `least`.
  std::int64_t count_below(double least) const
  {
    return std::ranges::count_if(owned_, [least](double c) { return c < least; });
  }

private:
  struct Found
  {
    int owner;
    double cover = 0;
  };

  void add_up()
  {
    const std::size_t n = static_cast<std::size_t>(points_.num_multipliers);
    for (std::size_t p = 0; p < points_.size(); ++p)
      for (std::size_t i = 0; i < n; ++i)
      {
        const int owner = points_.slave.owner[p * points_.slave.num_nodes + i];
        if (owner < 0)
          continue;
        Found& found = found_.try_emplace(multiplier(p, static_cast<int>(i)), Found{owner, 0.0})
                           .first->second;
        found.cover += points_.weight[p] * points_.multiplier_values[p * n + i];
      }
  }

  /// Sum the covered areas over the ranks and divide them by the areas.
  void complete(const Surface& slave)
  {
    std::vector<int> dest;
    std::vector<std::int64_t> names;
    std::vector<double> sums;
    for (const auto& [multiplier, found] : found_)
    {
      dest.push_back(found.owner);
      names.insert(names.end(), {multiplier.dof, multiplier.side});
      sums.push_back(found.cover);
    }
    const Exchange exchange(slave.comm(), dest);
    names = exchange.forward<std::int64_t>(names, 2);
    sums = exchange.forward<double>(sums, 1);
    std::map<Multiplier, double> here;
    const auto name = [&names](std::size_t i)
    { return Multiplier{names[2 * i], static_cast<std::uint8_t>(names[2 * i + 1])}; };
    for (std::size_t i = 0; i < sums.size(); ++i)
      here[name(i)] += sums[i];
    for (auto& [multiplier, cover] : here)
      owned_.push_back(cover /= area(slave, multiplier));
    for (std::size_t i = 0; i < sums.size(); ++i)
      sums[i] = here.at(name(i));
    sums = exchange.reverse<double>(sums, 1);
    for (std::size_t i = 0; auto& [multiplier, found] : found_)
      found.cover = sums[i++];
  }

  double area(const Surface& slave, const Multiplier& multiplier) const
  {
    const std::size_t node = slave.node_index(multiplier.dof);
    if (points_.by_sides && points_.in_corner[node])
      return points_.side_area[node * points_.gdim + multiplier.side];
    return slave.nodes().area[node];
  }

  const PairingPoints& points_;
  std::map<Multiplier, Found> found_;
  std::vector<double> owned_;
};
} // namespace

std::int64_t qsdolfinx::share_out_hardly_covered(PairingPoints& points, const Surface& slave,
                                                 double least)
{
  const Covers covers(points, slave);
  const std::size_t n = static_cast<std::size_t>(points.num_multipliers);
  std::vector<double> cover(n);
  for (std::size_t p = 0; p < points.size(); ++p)
  {
    if (n > 1 && points.slave.owner[p * points.slave.num_nodes + 1] < 0)
      continue; // at a node
    for (std::size_t i = 0; i < n; ++i)
      cover[i] = covers(p, static_cast<int>(i));
    const auto most = std::ranges::max_element(cover);
    const double needed = std::min(least, *most);
    const auto well = std::ranges::count_if(cover, [needed](double c) { return c >= needed; });
    double* N = points.multiplier_values.data() + p * n;
    double shared = 0;
    for (std::size_t i = 0; i < n; ++i)
      if (cover[i] < needed)
        shared += std::exchange(N[i], 0.0);
    for (std::size_t i = 0; shared != 0 && i < n; ++i)
      if (cover[i] >= needed)
        N[i] += shared / static_cast<double>(well);
  }
  return covers.count_below(least);
}
