// Pieces (segments) of the overlay with the facets they were cut from, for gaps with updated
// geometry.
#pragma once

#include "sliding/motion.h"

#include <cstdint>
#include <span>
#include <vector>

namespace qsdolfinx
{

/// Facets of one side, one for each piece, by all nodes of the trace.
struct PieceSide
{
  FacetType type = FacetType::interval;
  int degree = 1, num_nodes = 0;
  std::vector<double> x;           ///< positions of the nodes, [piece][node][3]
  std::vector<double> orientation; ///< as Facets::orientation, [piece]
  std::vector<std::int64_t> dofs;  ///< unknowns, [piece][node][gdim]
  std::vector<int> owner;          ///< their owners, [piece][node]

  std::span<const double> x_of(std::size_t piece) const
  {
    const std::size_t width = static_cast<std::size_t>(num_nodes) * 3;
    return std::span(x).subspan(piece * width, width);
  }
};

/// Pieces on the ranks that own the facets that were cut.
struct Pieces
{
  int gdim = 0, num_multipliers = 0;
  bool along_other = false; ///< as RayPair::along_other
  PieceSide slave, master;
  std::vector<double> rise; ///< as RayPair::rise, [piece][vertex][vertex]; empty if there is none
  std::vector<double> rise_normal; ///< as RayPair::rise_normal, [piece][vertex][3]; empty if there
                                   ///< is none
  std::vector<std::uint8_t> multiplier_side; ///< as Facets::vertex_side, [piece][multiplier]
  std::vector<std::uint8_t> cut_is_slave;    ///< whether the slave's facet was cut, [piece]
  std::vector<std::size_t> end;              ///< points of a piece: [end[piece - 1], end[piece])
  std::vector<RayPoint> points;              ///< ξ of the facet that was cut, ζ of the other, area
  std::vector<std::uint8_t> is_missed;       ///< whether a ray meets no point, [piece]
  std::vector<std::int64_t> vertex;          ///< number of the owned node that is the point of a
                                             ///< piece, [piece]; empty for facets that were cut
  bool axisymmetric = false;                 ///< as PieceShape::axisymmetric
  // For pieces of facets that were cut; empty for points at vertices.
  std::vector<std::size_t> corner_end; ///< corners of a piece: [corner_end[piece - 1],
                                       ///< corner_end[piece])
  std::vector<PieceCorner> corners;
  std::vector<PointPlace> places; ///< [point]

  std::size_t size() const { return end.size(); }
  std::span<const RayPoint> points_of(std::size_t piece) const
  {
    return part_of(std::span(points), end, piece);
  }
  std::span<RayPoint> points_of(std::size_t piece)
  {
    return part_of(std::span(points), end, piece);
  }
  /// Data for the motion of the piece's points on the facet; empty if they do not move.
  PieceShape shape_of(std::size_t piece) const
  {
    if (corner_end.empty())
      return {};
    return {part_of(std::span(corners), corner_end, piece), part_of(std::span(places), end, piece),
            axisymmetric};
  }

  template <typename T>
  static std::span<T> part_of(std::span<T> all, const std::vector<std::size_t>& end,
                              std::size_t piece)
  {
    const std::size_t first = piece > 0 ? end[piece - 1] : 0;
    return all.subspan(first, end[piece] - first);
  }
};

/// The two facets of a piece.
RayPair pair_of(const Pieces& pieces, std::size_t piece);

/// Find where the rays of all points meet the other facets.
void solve_pieces(Pieces& pieces);

} // namespace qsdolfinx
