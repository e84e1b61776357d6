#include "geometry/boxes.h"

#include <limits>
#include <stdexcept>

using namespace qsdolfinx;

namespace
{
/// Twice the centre.
Vec3 middle(const Box& box) { return box.low + box.high; }
} // namespace

std::vector<Box> qsdolfinx::facet_boxes(FacetType type, std::span<const double> x)
{
  const std::size_t width = 3 * static_cast<std::size_t>(type);
  std::vector<Box> out(x.size() / width);
  for (std::size_t f = 0; f < out.size(); ++f)
    out[f] = box_of(x.subspan(f * width, width));
  return out;
}

BoxTree::BoxTree(const std::vector<Box>& boxes)
{
  if (boxes.size() > std::numeric_limits<std::uint32_t>::max() / 2)
    throw std::length_error("BoxTree: too many boxes on one rank");
  entries_.reserve(boxes.size());
  for (std::size_t i = 0; i < boxes.size(); ++i)
    entries_.push_back({boxes[i], i});
  nodes_.reserve(boxes.size());
  if (!entries_.empty())
    build(0, entries_.size());
  extent_ = extent();
}

bool BoxTree::follow(const std::vector<Box>& boxes)
{
  constexpr double looser = 1.2;
  for (Entry& entry : entries_)
    entry.box = boxes[entry.number];
  for (std::size_t n = nodes_.size(); n-- > 0;) // branches come after their parents
  {
    Node& node = nodes_[n];
    node.box = Box{};
    const auto include = [&node](const Box& b) { node.box.include(b.low, b.high); };
    if (node.count == 0)
    {
      include(nodes_[n + 1].box);
      include(nodes_[node.first].box);
    }
    for (std::uint32_t i = node.first; i < node.first + node.count; ++i)
      include(entries_[i].box);
  }
  return extent() <= looser * extent_;
}

double BoxTree::extent() const
{
  double sum = 0;
  for (const Node& node : nodes_)
    for (std::size_t j = 0; j < 3; ++j)
      sum += node.box.high[j] - node.box.low[j];
  return sum;
}

void BoxTree::build(std::size_t first, std::size_t last)
{
  Box box, middles;
  for (std::size_t i = first; i < last; ++i)
  {
    const Box& b = entries_[i].box;
    box.include(b.low, b.high);
    middles.include(middle(b), middle(b));
  }
  const std::size_t node = nodes_.size();
  nodes_.push_back({box, static_cast<std::uint32_t>(first), 0});
  if (last - first <= leaf_size)
  {
    nodes_[node].count = static_cast<std::uint32_t>(last - first);
    return;
  }
  const Vec3 extent = middles.high - middles.low;
  const auto axis = static_cast<std::size_t>(std::ranges::max_element(extent) - extent.begin());
  const std::size_t half = first + (last - first) / 2;
  const auto at
      = [this](std::size_t i) { return entries_.begin() + static_cast<std::ptrdiff_t>(i); };
  std::nth_element(at(first), at(half), at(last), [axis](const Entry& a, const Entry& b)
                   { return middle(a.box)[axis] < middle(b.box)[axis]; });
  build(first, half);
  nodes_[node].first = static_cast<std::uint32_t>(nodes_.size());
  build(half, last);
}

void BoxTree::near(const Box& box, double radius, std::vector<std::size_t>& out) const
{
  const Box wide = widened(box, radius);
  out.clear();
  std::array<std::uint32_t, max_depth> stack{0};
  for (std::size_t depth = nodes_.empty() ? 0 : 1; depth > 0;)
  {
    const std::uint32_t n = stack[--depth];
    const Node& node = nodes_[n];
    if (!meet(wide, node.box))
      continue;
    if (node.count == 0)
    {
      stack[depth++] = node.first;
      stack[depth++] = n + 1;
    }
    for (std::uint32_t i = node.first; i < node.first + node.count; ++i)
      if (meet(wide, entries_[i].box))
        out.push_back(entries_[i].number);
  }
  std::sort(out.begin(), out.end());
}

const BoxTree& MovingTree::of(FacetType type, std::span<const double> x) const
{
  if (is_current_)
    return *tree_;
  const auto boxes = facet_boxes(type, x);
  if (!tree_ || !tree_->follow(boxes))
    tree_ = std::make_unique<BoxTree>(boxes);
  is_current_ = true;
  return *tree_;
}
