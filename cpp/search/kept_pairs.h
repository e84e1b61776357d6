// Pairs of nearby facets of two surfaces, kept from evaluation to evaluation while facets move
// little.
#pragma once

#include "parallel/exchange.h"
#include "parallel/records.h"
#include "search/radius.h"
#include "search/screen.h"
#include "surface/surface.h"

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace qsdolfinx
{
struct Frame;

/// Facets of a surface that are near another surface's facets of this rank.
struct NearbyFacets : FacetCopies
{
  int degree = 1, num_trace = 0, block = 0;
  std::vector<std::int64_t> dofs; ///< [facet][trace][block]
  std::vector<int> owner;         ///< [facet][trace]
  std::vector<std::uint8_t> side; ///< smooth sides, [facet][vertex]
  std::vector<double> trace_x;    ///< [facet][trace][3], of surfaces with updated geometry
  std::vector<double> key;        ///< Surface::keys, of surfaces in self-contact

  std::span<const double> key_of(std::size_t facet) const
  {
    return std::span(key).subspan(facet * key_size, key_size);
  }
};

/// Copies facets of a surface to the ranks whose boxes they meet. They arrive in the order of ranks
/// and of the facets there, whatever the size of the boxes.
class Copying
{
public:
  /// Collective. @param boxes of all ranks
  Copying(const Surface& from, std::span<const Box> boxes);

  /// Copy values of facets, `width` for each; collective. @param values [facet of this rank][width]
  template <typename T>
  std::vector<T> copy(std::span<const T> values, int width) const
  {
    std::vector<T> out;
    out.reserve(facets_.size() * static_cast<std::size_t>(width));
    for (std::size_t f : facets_)
      append_record(out, values, f, static_cast<std::size_t>(width));
    return exchange_->forward<T>(out, width);
  }

private:
  std::vector<std::size_t> facets_; ///< facets of this rank that are sent
  std::unique_ptr<Exchange> exchange_;
};

/// Part of the line through the middle of a facet, along its normal, and a distance from it within
/// which the facet lies. All facets that may be opposite or behind are around this line.
struct NormalLine
{
  Vec3 start, way;
  double width;

  /// @param x vertices of the facet
  /// @param radius largest distance of facets from each other
  NormalLine(const Frame& frame, std::span<const double> x, double radius);
  /// For comparisons with boxes that are enlarged by the width and `more`.
  LinePart part(double more = 0) const { return {start, way, 1, width + more}; }
};

/// Facets of a surface that are cut, and those that may be opposite, behind, or in between.
class PairsOfCut
{
public:
  /// Find the pairs. Collective. @param skin motion of the facets of both surfaces together for
  /// which the pairs remain complete
  PairsOfCut(const Surface& cut, const Surface& other, double radius, double skin);

  /// Update the copies' positions to those of Surface::follow. Collective.
  void follow(const Surface& cut, const Surface& other);
  /// Largest motion, on this rank, of a normal line since the search, by coordinates.
  double motion_of_lines(const Surface& cut) const;

  /// Copies of facets of the other surface.
  const NearbyFacets& nearby() const { return nearby_; }
  /// Copies of facets of the surface that is cut.
  const FacetCopies& own() const { return own_; }
  FacetView view_of_nearby() const { return view(nearby_, tree_); }
  FacetView view_of_own() const { return view(own_, own_tree_); }
  /// Copy further values of facets of the other surface, see Copying::copy. Collective.
  template <typename T>
  std::vector<T> copy(std::span<const T> values, int width) const
  {
    return from_other_.copy(values, width);
  }

  /// Whether a facet may have facets opposite or behind.
  bool has_others(std::size_t facet) const { return !others_.of(facet).empty(); }
  /// Find the nearby facets that may lie in front of or behind a facet, ascending.
  void find_others(const Surface& cut, std::size_t facet, const Frame& frame,
                   std::vector<std::size_t>& out) const;
  /// Find the facets of the surface that is cut whose boxes meet a box and which may lie in front
  /// of or behind a facet, ascending; none in self-contact.
  void find_own(std::size_t facet, const Box& box, std::vector<std::size_t>& out) const;

private:
  /// Facets around the normal line of each facet that is cut, ascending.
  struct Lists
  {
    std::vector<std::size_t> end, facet;
    void append(const BoxTree& tree, const LinePart& line);
    std::span<const std::size_t> of(std::size_t cut) const
    {
      const std::size_t first = cut > 0 ? end[cut - 1] : 0;
      return std::span(facet).subspan(first, end[cut] - first);
    }
  };
  static FacetView view(const FacetCopies& facets, const MovingTree& tree)
  {
    return {facets.type, facets.x, facets.orientation, tree.of(facets.type, facets.x)};
  }

  double radius_;
  Copying from_other_, from_own_;
  NearbyFacets nearby_;
  FacetCopies own_;
  std::vector<Box> boxes_, own_boxes_; ///< of the copies
  MovingTree tree_, own_tree_;
  std::vector<NormalLine> lines_; ///< at the search, [facet]
  Lists others_, own_lists_;
};

/// Pairs of facets of two surfaces that may be in contact.
///
/// They are searched for with an enlarged distance and kept until the facets of both surfaces
/// together have moved further than this enlargement, the skin. Until then no pair can be missing,
/// and whatever is computed from pairs does not depend on when they were found.
class KeptPairs
{
public:
  /// @param skin as a fraction of the mean facet size; 0 to search each time
  explicit KeptPairs(const SearchRadius& radius, double skin = 0);

  /// Search for pairs, or update the positions of the known ones. Collective.
  /// @param slave, master the same surfaces in each call; with a skin, after Surface::follow
  /// @param both whether facets of the master are cut as well
  void find(const Surface& slave, const Surface& master, bool both);
  const PairsOfCut& of_slave() const { return *of_slave_; }
  const PairsOfCut& of_master() const { return *of_master_; }

  const SearchRadius& radius() const { return radius_; }
  std::size_t num_evaluations() const { return num_evaluations_; }
  std::size_t num_searches() const { return num_searches_; }

private:
  /// Whether the pairs are complete at the surfaces' positions. Collective.
  bool are_complete(const Surface& slave, const Surface& master) const;

  SearchRadius radius_;
  double part_, skin_ = 0;
  std::size_t num_evaluations_ = 0, num_searches_ = 0;
  std::unique_ptr<PairsOfCut> of_slave_, of_master_; ///< null before the first search, if not cut
  std::vector<double> slave_x_, master_x_;           ///< of facets of this rank, at the search
};

} // namespace qsdolfinx
