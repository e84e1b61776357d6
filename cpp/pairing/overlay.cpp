#include "pairing/overlay.h"
#include "geometry/boxes.h"
#include "parallel/exchange.h"
#include "parallel/records.h"

#include <algorithm>

using namespace qsdolfinx;

namespace
{
/// Facets of a surface that are near another surface's facets of this rank.
struct NearbyFacets
{
  FacetType type;
  int degree, num_trace, gdim;
  std::vector<double> x;          ///< [facet][vertex][3]
  std::vector<double> outward;    ///< unit normal at the centre, [facet][3]
  std::vector<std::int64_t> dofs; ///< [facet][trace][gdim]
  std::vector<int> owner;         ///< [facet][trace]
  std::vector<std::uint8_t> side; ///< smooth sides, [facet][vertex]

  std::size_t size() const { return outward.size() / 3; }
  std::span<const double> facet_x(std::size_t f) const
  {
    const std::size_t width = 3 * static_cast<std::size_t>(type);
    return std::span(x).subspan(f * width, width);
  }
};

/// Copy the facets of `from` to all ranks whose facets of `to` may be within the radius. They
/// arrive in an order that depends on the partition. Collective.
NearbyFacets fetch_nearby(const Surface& from, const Surface& to, double radius)
{
  const std::vector<Box> boxes = to.rank_boxes(radius);
  const int nv = from.num_vertices(), nt = from.num_trace(), d = from.gdim();
  std::vector<int> dest, owner;
  std::vector<double> x, outward;
  std::vector<std::int64_t> dofs;
  std::vector<std::uint8_t> side;
  for (std::size_t f = 0; f < from.num_facets(); ++f)
  {
    const Box box = box_of(from.facet_x(f));
    const Vec3 n = from.normal(f, facet_centre(from.type()));
    for (std::size_t r = 0; r < boxes.size(); ++r)
    {
      if (!meet(boxes[r], box))
        continue;
      dest.push_back(static_cast<int>(r));
      append_record(x, from.facets().x, f, nv * 3);
      outward.insert(outward.end(), n.begin(), n.end());
      append_record(dofs, from.facets().dofs, f, nt * d);
      append_record(owner, from.facets().owner, f, nt);
      append_record(side, from.facets().vertex_side, f, nv);
    }
  }
  const Exchange exchange(from.comm(), dest);
  return {from.type(),
          from.degree(),
          nt,
          d,
          exchange.forward<double>(x, nv * 3),
          exchange.forward<double>(outward, 3),
          exchange.forward<std::int64_t>(dofs, nt * d),
          exchange.forward<int>(owner, nt),
          exchange.forward<std::uint8_t>(side, nv)};
}

/// Part of a facet that one facet of the other surface covers.
struct Piece
{
  std::size_t other;
  PlanarFacet planar;
  Polygon polygon;
};

/// Shape functions at the points of a piece, with the constants that make their integrals exact.
struct ShapeValues
{
  std::vector<Vec2> xi;
  std::vector<std::array<double, 4>> N;

  void compute(FacetType type, const PlanarFacet& facet, const Polygon& polygon,
               const std::vector<Vec2>& q, const std::vector<double>& w, const Rule& edge)
  {
    xi.clear();
    N.clear();
    for (const Vec2& p : q)
    {
      xi.push_back(facet.invert(p));
      N.push_back(shape_functions(type, xi.back()));
    }
    if (facet.affine())
      return;
    auto missing = facet.integrals(polygon, edge);
    double area = 0;
    for (std::size_t p = 0; p < q.size(); ++p)
    {
      area += w[p];
      for (int i = 0; i < 4; ++i)
        missing[i] -= w[p] * N[p][i];
    }
    // Functions sum to one also where a nearly folded facet's integrals are not quite exact.
    const double rest = (missing[0] + missing[1] + missing[2] + missing[3]) / 4;
    for (auto& values : N)
      for (int i = 0; i < 4; ++i)
        values[i] += (missing[i] - rest) / area;
  }
};

/// Cuts the facets of one surface along those of another.
class Overlay
{
public:
  Overlay(PairingPoints& points, const Surface& cut, const Surface& other, bool cut_is_slave,
          double share, double radius, Normals normals, const OverlayRules& rules)
      : points_(points), cut_(cut), nearby_(fetch_nearby(other, cut, radius)), tree_(facet_tree()),
        cut_is_slave_(cut_is_slave), share_(share), radius_(radius), normals_(normals),
        rules_(rules)
  {
  }

  void run()
  {
    for (std::size_t f = 0; f < cut_.num_facets(); ++f)
    {
      const Frame frame(cut_.type(), cut_.facet_x(f));
      const PlanarFacet planar(cut_.type(), cut_.facet_x(f), frame);
      find_pieces(f, frame, planar);
      if (pieces_.empty())
        ++points_.num_unpaired;
      for (const Piece& piece : pieces_)
        append(f, planar, piece);
    }
  }

private:
  BoxTree facet_tree() const
  {
    std::vector<Box> boxes(nearby_.size());
    for (std::size_t f = 0; f < boxes.size(); ++f)
      boxes[f] = box_of(nearby_.facet_x(f));
    return BoxTree(boxes);
  }

  void find_pieces(std::size_t f, const Frame& frame, const PlanarFacet& planar)
  {
    pieces_.clear();
    const double area = measure(planar.polygon());
    const Vec3 outward = cut_.normal(f, facet_centre(cut_.type()));
    double covered = 0;
    tree_.near(box_of(cut_.facet_x(f)), radius_, candidates_);
    for (std::size_t g : candidates_)
    {
      const Vec3 n{nearby_.outward[3 * g], nearby_.outward[3 * g + 1], nearby_.outward[3 * g + 2]};
      if (dot(n, outward) >= 0)
        continue;
      PlanarFacet other(nearby_.type, nearby_.facet_x(g), frame);
      if (!other.unfolded()) // warped, and seen from the side: it faces this one in part at most
        continue;
      intersect(other.polygon(), planar.polygon(), polygon_);
      const double piece = measure(polygon_);
      if (!(piece > sliver_tolerance * area))
        continue;
      covered += piece;
      pieces_.push_back({g, std::move(other), polygon_});
    }
    // Only where the whole facet is covered once it is known that no two pieces overlap.
    overlapping_ = pieces_.size() > 1 && std::abs(covered - area) > 1e-9 * area;
  }

  /// Signed distance of the other facet from q, along the outward normal of the facet that is cut.
  double distance(const Piece& piece, const Vec2& q, const Vec3& x, const Vec3& outward) const
  {
    const Vec3 z = facet_point(nearby_.type, nearby_.facet_x(piece.other), piece.planar.invert(q));
    return dot(z - x, outward);
  }

  /// Whether another piece at q is nearer.
  bool is_hidden(const Piece& piece, const Vec2& q, double distance_here, const Vec3& x,
                 const Vec3& outward) const
  {
    return std::ranges::any_of(pieces_,
                               [&](const Piece& p)
                               {
                                 return &p != &piece && contains(p.polygon, q)
                                        && std::abs(distance(p, q, x, outward))
                                               < std::abs(distance_here);
                               });
  }

  /// Outward normal of the surface that is cut, as the gap is to be measured.
  Vec3 normal(std::size_t f, Vec2 xi, std::size_t other, Vec2 zeta) const
  {
    const Vec3 n = cut_.normal(f, xi);
    if (normals_ == Normals::facet)
      return n;
    const Vec3 a = area_vector(nearby_.type, nearby_.facet_x(other), zeta);
    const Vec3 sum = n + ((dot(a, n) > 0 ? 1 : -1) / norm(a)) * a;
    return (1 / norm(sum)) * sum;
  }

  void append(std::size_t f, const PlanarFacet& planar, const Piece& piece)
  {
    const auto v = cut_.facet_x(f), z = nearby_.facet_x(piece.other);
    q_.clear();
    w_.clear();
    append_points(piece.polygon, rules_.piece, q_, w_);
    here_.compute(cut_.type(), planar, piece.polygon, q_, w_, rules_.edge);
    there_.compute(nearby_.type, piece.planar, piece.polygon, q_, w_, rules_.edge);
    const ShapeValues &here = here_, &there = there_;
    for (std::size_t p = 0; p < q_.size(); ++p)
    {
      const Vec3 x = facet_point(cut_.type(), v, here.xi[p]);
      const Vec3 y = facet_point(nearby_.type, z, there.xi[p]);
      const Vec3 outward = normal(f, here.xi[p], piece.other, there.xi[p]);
      const double gap = dot(y - x, outward);
      if (std::abs(gap) > radius_ || (overlapping_ && is_hidden(piece, q_[p], gap, x, outward)))
        continue;
      // A curved quadrilateral has more area than its projection.
      const double stretch
          = norm(area_vector(cut_.type(), v, here.xi[p])) / planar.jacobian(here.xi[p]);
      points_.weight.push_back(share_ * w_[p] * stretch * cut_.area_factor(x));
      points_.gap.push_back(gap);
      const Vec3 n = (cut_is_slave_ ? 1.0 : -1.0) * outward;
      points_.normal.insert(points_.normal.end(), n.begin(), n.end());
      append_side(cut_is_slave_, x, cut_.facets().dofs, cut_.facets().owner, f, cut_.type(),
                  cut_.degree(), here, p);
      append_side(!cut_is_slave_, y, nearby_.dofs, nearby_.owner, piece.other, nearby_.type,
                  nearby_.degree, there, p);
      append_record(points_.multiplier_side,
                    cut_is_slave_ ? cut_.facets().vertex_side : nearby_.side,
                    cut_is_slave_ ? f : piece.other, points_.num_multipliers);
    }
  }

  void append_side(bool slave, const Vec3& x, const std::vector<std::int64_t>& dofs,
                   const std::vector<int>& owner, std::size_t facet, FacetType type, int degree,
                   const ShapeValues& shapes, std::size_t p)
  {
    PairingSide& side = slave ? points_.slave : points_.master;
    const auto nt = static_cast<std::size_t>(side.num_nodes), d = nt * points_.gdim;
    side.x.insert(side.x.end(), x.begin(), x.end());
    append_record(side.dofs, dofs, facet, d);
    append_record(side.owner, owner, facet, nt);
    const auto& N = shapes.N[p];
    if (degree == 1)
      append_record(side.shape_values, N, 0, nt);
    else
      append_record(side.shape_values, trace_functions(type, degree, shapes.xi[p]), 0, nt);
    if (slave)
      append_record(points_.multiplier_values, N, 0, points_.num_multipliers);
  }

  PairingPoints& points_;
  const Surface& cut_;
  NearbyFacets nearby_;
  BoxTree tree_;
  bool cut_is_slave_;
  double share_, radius_;
  Normals normals_;
  const OverlayRules& rules_;
  // Of the present facet.
  std::vector<Piece> pieces_;
  bool overlapping_ = false; // whether pieces may
  // Reused storage.
  std::vector<std::size_t> candidates_;
  Polygon polygon_;
  std::vector<Vec2> q_;
  std::vector<double> w_;
  ShapeValues here_, there_;
};
} // namespace

PairingPoints qsdolfinx::overlay_surfaces(const Surface& slave, const Surface& master, bool both,
                                          double radius, Normals normals, const OverlayRules& rules)
{
  PairingPoints points(slave, &master);
  const double share = both ? 0.5 : 1.0;
  Overlay(points, slave, master, true, share, radius, normals, rules).run();
  if (both)
    Overlay(points, master, slave, false, share, radius, normals, rules).run();
  return points;
}
