#include "pairing/pieces.h"

using namespace qsdolfinx;

namespace
{
RayFacet facet_of(const PieceSide& side, std::size_t piece)
{
  return {side.type, side.degree, side.x_of(piece), side.orientation[piece]};
}
} // namespace

RayPair qsdolfinx::pair_of(const Pieces& pieces, std::size_t piece)
{
  const bool is_slave = pieces.cut_is_slave[piece];
  const RayFacet slave = facet_of(pieces.slave, piece), master = facet_of(pieces.master, piece);
  const auto side = static_cast<std::size_t>(is_slave ? master.type : slave.type), n = side * side;
  std::span<const double> rise, normal;
  if (!pieces.rise.empty())
    rise = std::span(pieces.rise).subspan(piece * n, n);
  if (!pieces.rise_normal.empty())
    normal = std::span(pieces.rise_normal).subspan(piece * 3 * side, 3 * side);
  return {is_slave ? slave : master,
          is_slave ? master : slave,
          is_slave,
          pieces.along_other,
          rise,
          normal};
}

void qsdolfinx::solve_pieces(Pieces& pieces)
{
  pieces.is_missed.assign(pieces.size(), 0);
  for (std::size_t i = 0; i < pieces.size(); ++i)
    pieces.is_missed[i] = !solve_rays(pair_of(pieces, i), pieces.points_of(i));
}
