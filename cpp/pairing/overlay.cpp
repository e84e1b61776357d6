#include "pairing/overlay.h"
#include "geometry/boxes.h"
#include "pairing/roles.h"
#include "parallel/records.h"
#include "search/local_search.h"
#include "search/screen.h"
#include "search/way_out.h"
#include "search/winding.h"
#include "sliding/facing.h"
#include "surface/curvature.h"
#include "surface/heights.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

using namespace qsdolfinx;

namespace
{
/// What is known of the curved surface of one side.
struct CurvedSide
{
  Heights heights{};                                 ///< of curved facets
  std::optional<std::vector<Curvature>> curvature{}; ///< by facet of this rank, if requested
  bool is_flat = true; ///< whether gaps are measured from flat facets, for chord errors
};

/// Whether, in self-contact, a facet and a copy of another facet may be in contact with the given
/// roles. @param is_slave whether the first facet is to be the slave
bool has_role(const Surface& cut, std::size_t f, const NearbyFacets& nearby, std::size_t g,
              bool is_slave)
{
  const auto here = cut.key(f), there = nearby.key_of(g);
  if (std::isnan(here[0]) || std::isnan(there[0]))
    return false;
  const int first = is_slave_of(here, there);
  const bool by_name = name_of(cut.facet_x(f)) < name_of(nearby.facet_x(g));
  return (first > 0 || (first == 0 && by_name)) == is_slave;
}

/// Whether two bodies are curved the same way, one being convex and the other concave. This is
/// checked along the line between two vertices of a facet where their curvatures differ most.
bool conforming(const Curvature& a, const Curvature& b, FacetType type, std::span<const double> v)
{
  double most = 0;
  bool out = false;
  for (int i = 0; i < static_cast<int>(type); ++i)
    for (int j = 0; j < i; ++j)
    {
      const Vec3 e = facet_vertex(v, j) - facet_vertex(v, i);
      const double here = along(a, e), there = -along(b, e);
      if (std::abs(here + there) <= most)
        continue;
      most = std::abs(here + there);
      out = here * there > 0 && std::abs(here) < 2 * std::abs(there)
            && std::abs(there) < 2 * std::abs(here);
    }
  return out;
}

/// Whether the angles between neighbouring facets are at rounding level, on all ranks. Collective.
bool is_flat(const Surface& surface, const std::vector<Curvature>& curvature)
{
  constexpr double rounding = 1e-6; // includes coordinates in single precision
  double most = 0;
  for (std::size_t f = 0; f < curvature.size(); ++f)
    for (double k : curvature[f])
      most = std::max(most, std::abs(k) * surface.facets().size[f]);
  MPI_Allreduce(MPI_IN_PLACE, &most, 1, MPI_DOUBLE, MPI_MAX, surface.comm());
  return most < rounding;
}

/// Curved surfaces of two sides facing each other.
struct Curved
{
  CurvedSide cut, other;
  std::vector<ConformingPoint>* found = nullptr; ///< filled if it is not null, from curvatures
};

/// Area at ξ on a facet per area of the reference facet.
double stretch(const Surface& surface, std::size_t f, std::array<double, 2> xi)
{
  const auto v = surface.facet_x(f);
  return norm(area_vector(surface.type(), v, xi))
         * surface.area_factor(facet_point(surface.type(), v, xi));
}

/// Appends pieces, their corners and points to a Pieces object.
struct Record
{
  Pieces& pieces;

  /// Append a piece without points yet.
  void append(const Surface& cut, std::size_t f, const NearbyFacets& nearby, std::size_t g,
              bool cut_is_slave)
  {
    PieceSide& here = cut_is_slave ? pieces.slave : pieces.master;
    PieceSide& there = cut_is_slave ? pieces.master : pieces.slave;
    const Facets& own = cut.facets();
    append_side(here, own.trace_x, own.orientation, own.dofs, own.owner, f);
    append_side(there, nearby.trace_x, nearby.orientation, nearby.dofs, nearby.owner, g);
    append_record(pieces.multiplier_side, cut_is_slave ? own.vertex_side : nearby.side,
                  cut_is_slave ? f : g, pieces.num_multipliers);
    pieces.cut_is_slave.push_back(cut_is_slave);
    pieces.end.push_back(pieces.points.size());
    pieces.corner_end.push_back(pieces.corners.size());
  }

  void append_corner(const PieceCorner& corner)
  {
    pieces.corners.push_back(corner);
    pieces.corner_end.back() = pieces.corners.size();
  }

  void append_point(const RayPoint& point, const PointPlace& place)
  {
    pieces.places.push_back(place);
    pieces.points.push_back(point);
    pieces.end.back() = pieces.points.size();
  }

private:
  void append_side(PieceSide& side, const std::vector<double>& x,
                   const std::vector<double>& orientation, const std::vector<std::int64_t>& dofs,
                   const std::vector<int>& owner, std::size_t f) const
  {
    const auto nodes = static_cast<std::size_t>(side.num_nodes);
    append_record(side.x, x, f, nodes * 3);
    append_record(side.orientation, orientation, f, 1);
    append_record(side.dofs, dofs, f, nodes * pieces.gdim);
    append_record(side.owner, owner, f, nodes);
  }
};

/// Part of a facet that is covered by one facet of the other surface (a segment).
struct Piece
{
  std::size_t other;
  PlanarFacet planar;
  Polygon polygon;
  double counts; ///< part of its area that is paired; if 0, it only hides others
  /// Whether no vertex of the polygon is distinguished as the first one for the quadrature points.
  bool even = false;
};

/// Middles of two facets are opposite to each other if their distance in the plane, relative to the
/// size of the facet, is less than this.
constexpr double even_tolerance = 1e-6;

/// A facet is seen edge-on if the cosine of the angle between its normal and a line of sight is
/// less than this. The line meets such a facet only by rounding, and it meets the neighbours.
constexpr double edge_on_cosine = 1e-6;

/// A facet that a line of sight may meet.
struct Screen
{
  std::size_t facet;
  PlanarFacet planar;
  bool opposed; ///< faces the start of the line
};

/// Where a line meets a facet.
struct Crossing
{
  double s;     ///< position along the line
  bool opposed; ///< see Screen
  bool first;   ///< takes precedence over the facet in question if they coincide
};

/// Whether other facets that a line meets hide the opposed facet at s from the point at 0. They do
/// if one of them lies between, or if the first facet in the other direction is also opposed, and
/// nearer. Both directions count, since the point may be in front of its partner or may have
/// penetrated it.
/// @param tie distances that differ by less are equal
bool hides(double s, std::span<const Crossing> others, double tie)
{
  const double distance = std::abs(s);
  const auto wins = [&](double at, bool first)
  { return at < distance - tie || (at <= distance + tie && first); };
  double behind = -std::numeric_limits<double>::infinity(); // nearest one in the other direction
  bool behind_wins = false;
  for (const Crossing& c : others)
  {
    const double along = s < 0 ? -c.s : c.s;
    if (along > tie)
    {
      if (c.opposed ? wins(along, c.first) : along < distance - tie)
        return true;
    }
    else if (along >= -tie)
    {
      if (c.opposed && wins(0, c.first))
        return true;
    }
    else if (along > behind + tie || (along > behind - tie && !c.opposed))
    {
      behind = std::max(behind, along);
      behind_wins = c.opposed && wins(-along, c.first);
    }
  }
  return behind_wins;
}

/// Positions of the points of a piece on a facet, and the facet's shape functions there, with the
/// constants that make their integrals exact.
struct ShapeValues
{
  std::vector<Vec2> xi;
  std::vector<std::array<double, 4>> N;

  void place(const PlanarFacet& facet, const std::vector<Vec2>& q)
  {
    xi.clear();
    N.clear();
    for (const Vec2& p : q)
      xi.push_back(facet.invert(p));
  }

  void compute(FacetType type, const PlanarFacet& facet, const Polygon& polygon,
               const std::vector<Vec2>& q, const std::vector<double>& w, const Rule& edge)
  {
    place(facet, q);
    for (const Vec2& at : xi)
      N.push_back(shape_functions(type, at));
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
    // The functions must sum to one even if the integrals of a nearly folded facet are not quite
    // exact.
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
  /// Collective.
  Overlay(PairingPoints& points, const Surface& cut, const Surface& other, bool cut_is_slave,
          double share, const SearchRadius& radius, const PairsOfCut& pairs, Normals normals,
          const OverlayRules& rules, const Curved& curved, Record* record = nullptr)
      : points_(points), cut_(cut), curved_(curved), record_(record), pairs_(pairs),
        nearby_(pairs.nearby()), own_(pairs.own()), cut_is_slave_(cut_is_slave), share_(share),
        radius_(radius.largest), reach_(radius), normals_(normals), rules_(rules),
        of_itself_(cut.touches_itself() && other.touches_itself())
  {
    if (curved.other.curvature)
      curvature_ = pairs.copy(std::span<const Curvature>(*curved.other.curvature), 1);
    if (curved.other.heights)
      heights_ = pairs.copy(*curved.other.heights, trace_size(other.type(), 2));
  }

  /// Cut all facets. Collective.
  void run()
  {
    if (of_itself_)
    {
      asking_ = true;
      cut_all();
      inside_ = within_body(cut_, asked_x_, asked_normal_, asked_facet_);
      asking_ = false;
    }
    cut_all();
  }

private:
  void cut_all()
  {
    for (std::size_t f = 0; f < cut_.num_facets(); ++f)
    {
      const std::size_t before = points_.size();
      if (pairs_.has_others(f))
        cut(f);
      if (points_.size() == before && !asking_)
        ++points_.num_unpaired;
    }
  }

  void cut(std::size_t f)
  {
    const Frame frame(cut_.type(), cut_.facet_x(f));
    const PlanarFacet planar(cut_.type(), cut_.facet_x(f), frame);
    find_pieces(f, frame, planar);
    find_own_screens(f, frame, planar);
    for (const Piece& piece : pieces_)
      if (piece.counts > 0)
        append(f, planar, piece);
  }

  void find_pieces(std::size_t f, const Frame& frame, const PlanarFacet& planar)
  {
    pieces_.clear();
    backs_.clear();
    outward_ = cut_.normal(f, facet_centre(cut_.type()));
    tie_ = tie_tolerance * cut_.facets().size[f];
    const double area = measure(planar.polygon());
    pairs_.find_others(cut_, f, frame, candidates_);
    for (std::size_t g : candidates_)
    {
      const Vec3 outward = nearby_.outward(g);
      if (is_edge_on(outward))
        continue;
      const bool opposed = dot(outward, outward_) < 0;
      if (of_itself_ && !opposed && same(nearby_.facet_x(g), cut_.facet_x(f)))
        continue; // the same facet, not the other side of a closed slit
      if (!opposed && apart(planar.polygon(), nearby_.facet_x(g), frame))
        continue;
      PlanarFacet other(nearby_.type, nearby_.facet_x(g), frame);
      if (!other.unfolded()) // warped and seen from the side: at most a part faces this facet
        continue;
      if (!opposed)
      {
        backs_.push_back({g, std::move(other), false});
        continue;
      }
      intersect(other.polygon(), planar.polygon(), polygon_);
      if (!(measure(polygon_) > sliver_tolerance * area))
        continue;
      // The points must not depend on the order of a facet's vertices.
      bool even = false;
      if (cut_.type() != FacetType::interval)
        even = !begin_with_facets(f, g, frame);
      pieces_.push_back({g, std::move(other), polygon_,
                         !of_itself_ || has_role(cut_, f, nearby_, g, cut_is_slave_)
                             ? part_of_area(dot(outward, outward_) / norm(outward))
                             : 0.0,
                         even});
    }
  }

  /// Part of the area of facets that is paired. @param cosine between their outward normals
  double part_of_area(double cosine) const
  {
    return record_ ? facing_weight(-cosine).value : (cosine < facing_cosine ? 1.0 : 0.0);
  }

  /// Choose the first vertex of the polygon such that it does not change when both facets rotate:
  /// the vertex that is first along the direction from one facet's middle to the other's, rotated
  /// by half a radian to distinguish symmetric vertices.
  /// @returns false if the middles are opposite to each other
  bool begin_with_facets(std::size_t f, std::size_t g, const Frame& frame)
  {
    const Vec2 way
        = frame.project(facet_point(nearby_.type, nearby_.facet_x(g), facet_centre(nearby_.type)));
    if (std::hypot(way[0], way[1]) < even_tolerance * cut_.facets().size[f])
      return false;
    const double s = cut_.facets().orientation[f] * std::sin(0.5), c = std::cos(0.5);
    polygon_.begin_along({c * way[0] - s * way[1], s * way[0] + c * way[1]});
    return true;
  }

  /// Find facets of the surface that is cut which may be met by the lines between it and the
  /// pieces, or by the continuation of these lines by their own length beyond the pieces.
  void find_own_screens(std::size_t f, const Frame& frame, const PlanarFacet& planar)
  {
    own_screens_.clear();
    if (pieces_.empty() || of_itself_)
      return;
    pairs_.find_own(f, box_of_lines(f, frame), candidates_);
    for (std::size_t g : candidates_)
    {
      if (is_edge_on(own_.outward(g)) || apart(planar.polygon(), own_.facet_x(g), frame)
          || same(own_.facet_x(g), cut_.facet_x(f)))
        continue;
      PlanarFacet other(own_.type, own_.facet_x(g), frame);
      if (other.unfolded() && !has_outside(other.polygon(), planar.polygon().corners()))
        own_screens_.push_back({g, std::move(other), dot(own_.outward(g), outward_) > 0});
    }
  }

  /// Whether a facet is seen edge-on along the lines from the one that is cut. @param outward of
  /// any length
  bool is_edge_on(const Vec3& outward) const
  {
    return std::abs(dot(outward, outward_)) < edge_on_cosine * norm(outward);
  }

  /// Whether a projected facet lies completely beside a polygon. May be false although it does.
  static bool apart(const Polygon& polygon, std::span<const double> x, const Frame& frame)
  {
    std::array<Vec2, 4> q;
    const std::size_t n = x.size() / 3;
    for (std::size_t i = 0; i < n; ++i)
      q[i] = frame.project(facet_vertex(x, static_cast<int>(i)));
    return has_outside(polygon, std::span(q).first(n));
  }

  /// Box of the lines from the facet to its pieces, continued by their own length.
  Box box_of_lines(std::size_t f, const Frame& frame) const
  {
    double low = 0, high = 0;
    for (const Piece& piece : pieces_)
    {
      const auto z = nearby_.facet_x(piece.other);
      for (std::size_t i = 0; i < z.size() / 3; ++i)
      {
        const double s = dot(facet_vertex(z, static_cast<int>(i)) - frame.origin, outward_);
        low = std::min(low, s);
        high = std::max(high, s);
      }
    }
    Box box;
    const auto v = cut_.facet_x(f);
    for (std::size_t i = 0; i < v.size() / 3; ++i)
      for (double s : {2 * std::max(low, -radius_), 2 * std::min(high, radius_)})
      {
        const Vec3 x = facet_vertex(v, static_cast<int>(i)) + s * outward_;
        box.include(x, x);
      }
    return box;
  }

  /// Position at which the line through x, perpendicular to the facet that is cut, meets a facet.
  double place(const FacetCopies& of, std::size_t facet, const PlanarFacet& planar, const Vec2& q,
               const Vec3& x) const
  {
    const Vec3 z = facet_point(of.type, of.facet_x(facet), planar.invert(q));
    return dot(z - x, outward_);
  }

  /// Whether x and y, a point of the piece, are hidden from each other.
  bool is_hidden(std::size_t f, const Piece& piece, const Vec2& q, const Vec3& x, const Vec3& y)
  {
    const double s = dot(y - x, outward_);
    crossings_.clear();
    for (const Piece& p : pieces_)
      if (&p != &piece && contains(p.planar.polygon(), q))
        crossings_.push_back({place(nearby_, p.other, p.planar, q, x), true,
                              comes_first(nearby_.facet_x(p.other), nearby_.facet_x(piece.other))});
    for (const Screen& b : backs_)
      if (contains(b.planar.polygon(), q))
        crossings_.push_back({place(nearby_, b.facet, b.planar, q, x), false, false});
    if (hides(s, crossings_, tie_))
      return true;
    crossings_.clear();
    for (const Screen& b : own_screens_)
      if (contains(b.planar.polygon(), q))
        crossings_.push_back({place(own_, b.facet, b.planar, q, x) - s, b.opposed,
                              comes_first(own_.facet_x(b.facet), cut_.facet_x(f))});
    return hides(-s, crossings_, tie_);
  }

  /// Whether, at q, a facet opposed to the one that is cut lies behind it by more than rounding.
  /// Such a facet is the other side of the body's wall, or belongs to another part of the body,
  /// which this part has penetrated.
  bool is_anything_behind(std::size_t f, const Vec2& q, const Vec3& x) const
  {
    const double flush = flush_tolerance * cut_.facets().size[f];
    return std::ranges::any_of(pieces_,
                               [&](const Piece& p)
                               {
                                 return contains(p.planar.polygon(), q)
                                        && place(nearby_, p.other, p.planar, q, x) < -flush;
                               });
  }

  /// Whether a point of a piece is not the partner of x on the same surface. The partner is on the
  /// first facet in front of x if the place just outside of x is free. If this place is within the
  /// body, the partner is on the first facet behind x, through which x has entered. Facets that are
  /// nearly at x count in both cases.
  bool is_another(std::size_t f, const Piece& piece, const Vec2& q, const Vec3& x, double s,
                  bool inside) const
  {
    const double flush = flush_tolerance * cut_.facets().size[f];
    if (std::abs(s) > flush && (s < 0) != inside)
      return true;
    if (s < -flush
        && is_own_wall(cut_.key(f), nearby_.key_of(piece.other), -s, cut_.facets().size[f]))
      return true;
    const double way = inside ? -1.0 : 1.0;
    const auto nearer = [&](double at) { return way * at > -flush && way * at < way * s - tie_; };
    for (const Piece& p : pieces_)
    {
      if (&p == &piece || !contains(p.planar.polygon(), q))
        continue;
      const double at = place(nearby_, p.other, p.planar, q, x);
      if (nearer(at)
          || (std::abs(at - s) <= tie_
              && comes_first(nearby_.facet_x(p.other), nearby_.facet_x(piece.other))))
        return true;
    }
    return !inside
           && std::ranges::any_of(backs_,
                                  [&](const Screen& b)
                                  {
                                    if (!contains(b.planar.polygon(), q))
                                      return false;
                                    const double at = place(nearby_, b.facet, b.planar, q, x);
                                    return at > tie_ && at < s - tie_;
                                  });
  }

  /// Whether x is behind y, but has entered the body through another face.
  bool has_shorter_way_out(std::size_t f, const Vec3& x, const Vec3& y)
  {
    if (dot(y - x, outward_) >= -shallow_tolerance * cut_.facets().size[f])
      return false;
    if (!ways_out_)
      ways_out_.emplace(std::vector{pairs_.view_of_nearby()}, std::vector{pairs_.view_of_own()});
    return ways_out_->are_shorter({x, y, outward_, false, outward_});
  }

  static bool same(std::span<const double> a, std::span<const double> b)
  {
    return std::ranges::equal(a, b);
  }

  static bool comes_first(std::span<const double> a, std::span<const double> b)
  {
    return name_of(a) < name_of(b);
  }

  /// Outward normal of the surface that is cut, along which the gap is measured.
  /// @param n normal of this surface, @param a normal of the other one, of any length and either
  /// sign
  Vec3 normal(const Vec3& n, const Vec3& a) const
  {
    if (normals_ == Normals::facet || (normals_ == Normals::master && !cut_is_slave_))
      return n;
    const Vec3 there = ((dot(a, n) > 0 ? 1 : -1) / norm(a)) * a;
    if (normals_ == Normals::master)
      return there;
    const Vec3 sum = n + there;
    return (1 / norm(sum)) * sum;
  }

  void append(std::size_t f, const PlanarFacet& planar, const Piece& piece)
  {
    const auto v = cut_.facet_x(f), z = nearby_.facet_x(piece.other);
    q_.clear();
    w_.clear();
    // Shape functions of quadrilaterals are not integrated exactly; the result must not depend on a
    // rotation of the surfaces.
    const bool from_middle = piece.even || !(planar.affine() && piece.planar.affine());
    const Triangles triangles(piece.polygon, from_middle);
    if (record_)
    {
      append_points_of_triangles(piece.polygon, triangles);
      here_.place(planar, q_);
      there_.place(piece.planar, q_);
    }
    else
    {
      if (from_middle)
        append_points_from_middle(piece.polygon, rules_.piece, q_, w_);
      else
        append_points(piece.polygon, rules_.piece, q_, w_);
      here_.compute(cut_.type(), planar, piece.polygon, q_, w_, rules_.edge);
      there_.compute(nearby_.type, piece.planar, piece.polygon, q_, w_, rules_.edge);
    }
    const ShapeValues &here = here_, &there = there_;
    const double reach = reach_.of(cut_.facets().size[f], std::sqrt(squared_size(nearby_.type, z)));
    std::size_t num_recorded = 0;
    for (std::size_t p = 0; p < q_.size(); ++p)
    {
      const Vec3 x = facet_point(cut_.type(), v, here.xi[p]);
      const Vec3 y = facet_point(nearby_.type, z, there.xi[p]);
      const Vec3 n = cut_.normal(f, here.xi[p]);
      const Vec3 a = area_vector(nearby_.type, z, there.xi[p]);
      Vec3 outward = normal(n, a);
      double gap = dot(y - x, outward);
      if (std::abs(gap) > reach)
        continue;
      if (of_itself_)
      {
        const bool behind = is_anything_behind(f, q_[p], x);
        if (asking_ && behind)
        {
          asked_x_.push_back(x);
          asked_normal_.push_back(n);
          asked_facet_.push_back(f);
        }
        if (asking_)
          continue;
        const bool inside = behind && inside_.at(next_answer_++);
        if (is_another(f, piece, q_[p], x, dot(y - x, outward_), inside))
          continue;
      }
      else if (is_hidden(f, piece, q_[p], x, y))
        continue;
      if (has_shorter_way_out(f, x, y))
        continue;
      if (record_)
      {
        if (num_recorded++ == 0)
        {
          record_->append(cut_, f, nearby_, piece.other, cut_is_slave_);
          append_corners(planar, piece, triangles.around);
        }
        const double weight = piece.counts * share_ * w_[p] / planar.jacobian(here.xi[p]);
        record_->append_point({here.xi[p], there.xi[p], weight * stretch(cut_, f, here.xi[p])},
                              places_[p]);
        continue;
      }
      // A curved quadrilateral has more area than its projection.
      const double stretch
          = norm(area_vector(cut_.type(), v, here.xi[p])) / planar.jacobian(here.xi[p]);
      points_.weight.push_back(share_ * w_[p] * stretch * cut_.area_factor(x));
      if (curved_.found)
        gap = chord_error(f, piece.other, p, gap);
      else if (curved_.cut.heights || curved_.other.heights)
        lift(f, piece.other, p, n, nearby_.orientation[piece.other] * a, dot(y - x, outward_),
             outward, gap);
      points_.gap.push_back(gap);
      const Vec3 into = (cut_is_slave_ ? 1.0 : -1.0) * outward;
      points_.normal.insert(points_.normal.end(), into.begin(), into.end());
      append_side(cut_is_slave_, x, cut_.facets().dofs, cut_.facets().owner, f, cut_.type(),
                  cut_.degree(), here, p);
      append_side(!cut_is_slave_, y, nearby_.dofs, nearby_.owner, piece.other, nearby_.type,
                  nearby_.degree, there, p);
      append_record(points_.multiplier_side,
                    cut_is_slave_ ? cut_.facets().vertex_side : nearby_.side,
                    cut_is_slave_ ? f : piece.other, points_.num_multipliers);
    }
  }

  /// Append the points of the triangles of a piece, and their positions in the triangles.
  void append_points_of_triangles(const Polygon& polygon, const Triangles& triangles)
  {
    const auto place = [&](std::uint8_t corner)
    { return corner < polygon.size() ? polygon[corner] : triangles.middle; };
    const bool on_line = cut_.type() == FacetType::interval;
    const std::uint8_t middle = static_cast<std::uint8_t>(polygon.size());
    places_.clear();
    for (std::array<std::uint8_t, 3> corner : triangles.corner)
    {
      const auto [a, b, c] = corner;
      append_points(on_line ? polygon : Polygon{place(a), place(b), place(c)}, rules_.piece, q_,
                    w_);
      std::ranges::replace(corner, middle, middle_corner);
      for (const Vec2& at : rules_.piece.x)
        places_.push_back({corner, at});
    }
  }

  /// Record the sources of the corners of a piece. @param around numbers of the corners that are
  /// not ears
  void append_corners(const PlanarFacet& planar, const Piece& piece,
                      const std::vector<std::uint8_t>& around)
  {
    sources_of_intersection(piece.planar, planar, cut_is_slave_, sources_);
    for (std::size_t i = 0; i < piece.polygon.size(); ++i)
    {
      const auto distance = [&](const CornerSource& source)
      { return std::hypot(source.q[0] - piece.polygon[i][0], source.q[1] - piece.polygon[i][1]); };
      const auto source = std::ranges::min_element(sources_, {}, distance); // 0
      PieceCorner corner{source->b, source->a};
      corner.around = std::ranges::find(around, i) != around.end();
      record_->append_corner(corner);
    }
  }

  /// Change of the gap by the chord errors of flat facets; 0 where the surfaces are not curved the
  /// same way.
  double chord_error(std::size_t f, std::size_t other, std::size_t p, double gap)
  {
    const Curvature of_cut = (*curved_.cut.curvature)[f], of_other = curvature_[other];
    const auto v = cut_.facet_x(f);
    if (!conforming(of_cut, of_other, cut_.type(), v))
      return 0;
    const Curvature K = shared_curvature(of_cut, of_other);
    const double here = bulge(K, cut_.type(), v, here_.N[p]);
    const double there = bulge(K, nearby_.type, nearby_.facet_x(other), there_.N[p]);
    const ConformingPoint point{curved_.cut.is_flat ? here : 0, curved_.other.is_flat ? there : 0,
                                gap - here + there, points_.weight.back()};
    curved_.found->push_back(point);
    return point.slave - point.master;
  }

  /// Replace gap and normal of flat facets by those of the curved facets.
  /// @param n, a normal of the facet that is cut, and area vector of the other, both outward
  /// @param distance of the facets along the line through both points
  void lift(std::size_t f, std::size_t other, std::size_t p, const Vec3& n, const Vec3& a,
            double distance, Vec3& outward, double& gap)
  {
    const auto of_cut = curved_.cut.heights.value_or(std::span<const double>{});
    const Lifted here = lifted(of_cut, f, cut_.type(), cut_.facet_x(f), here_.xi[p], n);
    const Lifted there = lifted(heights_, other, nearby_.type, nearby_.facet_x(other), there_.xi[p],
                                (1 / norm(a)) * a);
    outward = normal((1 / norm(here.normal)) * here.normal, there.normal);
    // Newton's step from each facet along the line to the surface above it. It reaches the surface
    // up to an error of third order.
    const double between = distance - here.height / dot(here.normal, outward_)
                           + there.height / dot(there.normal, outward_);
    gap = between * dot(outward_, outward);
  }

  /// Curved surface above a facet at one point.
  struct Lifted
  {
    double height; ///< above the facet, along its outward normal
    Vec3 normal;   ///< outward, of the surface; of unit length along the facet's normal
  };

  /// @param heights of all facets' nodes; empty for flat facets
  /// @param n outward unit normal of the flat facet
  static Lifted lifted(std::span<const double> heights, std::size_t facet, FacetType type,
                       std::span<const double> v, std::array<double, 2> xi, const Vec3& n)
  {
    if (heights.empty())
      return {0, n};
    const auto nodes = static_cast<std::size_t>(trace_size(type, 2));
    const auto own = heights.subspan(facet * nodes, nodes);
    const auto height = [&](std::array<double, 2> at) { return height_at(type, own, at); };
    return {height(xi), n - surface_gradient(type, v, xi, height)};
  }

  void append_side(bool slave, const Vec3& x, const std::vector<std::int64_t>& dofs,
                   const std::vector<int>& owner, std::size_t facet, FacetType type, int degree,
                   const ShapeValues& shapes, std::size_t p)
  {
    PairingSide& side = slave ? points_.slave : points_.master;
    const auto nt = static_cast<std::size_t>(side.num_nodes), d = nt * points_.block;
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
  Curved curved_;
  Record* record_; // null if only points are needed
  const PairsOfCut& pairs_;
  const NearbyFacets& nearby_;       // of the other surface
  const FacetCopies& own_;           // of the surface that is cut
  std::vector<Curvature> curvature_; // of nearby facets, if requested
  std::vector<double> heights_;      // of nearby facets' nodes of degree 2, if they are known
  std::optional<WaysOut> ways_out_;  // of the first deep overlap
  bool cut_is_slave_;
  double share_, radius_; ///< the largest
  SearchRadius reach_;
  Normals normals_;
  const OverlayRules& rules_;
  // Of the current facet.
  Vec3 outward_{0, 0, 0};
  double tie_ = 0;
  bool of_itself_; ///< whether both are the same surface
  bool asking_ = false;
  std::vector<Vec3> asked_x_, asked_normal_; ///< points with a facet behind them, in order
  std::vector<std::size_t> asked_facet_;
  std::vector<std::uint8_t> inside_; ///< whether they are within another part of the body
  std::size_t next_answer_ = 0;
  std::vector<Piece> pieces_;
  std::vector<Screen> backs_, own_screens_;
  // Reused storage.
  std::vector<std::size_t> candidates_;
  std::vector<Crossing> crossings_;
  Polygon polygon_;
  std::vector<PointPlace> places_;
  std::vector<CornerSource> sources_;
  std::vector<Vec2> q_;
  std::vector<double> w_;
  ShapeValues here_, there_;
};
} // namespace

PairingPoints qsdolfinx::overlay_surfaces(const Surface& slave, const Surface& master, bool both,
                                          const SearchRadius& radius, Normals normals,
                                          const OverlayRules& rules, const Heights& slave_heights,
                                          const Heights& master_heights)
{
  PairingPoints points(slave, &master);
  const double share = both ? 0.5 : 1.0;
  KeptPairs pairs(radius);
  pairs.find(slave, master, both);
  Overlay(points, slave, master, true, share, radius, pairs.of_slave(), normals, rules,
          {{.heights = slave_heights}, {.heights = master_heights}})
      .run();
  points.num_of_slave = points.size();
  if (both)
    Overlay(points, master, slave, false, share, radius, pairs.of_master(), normals, rules,
            {{.heights = master_heights}, {.heights = slave_heights}})
        .run();
  return points;
}

namespace
{
/// Empty pieces for facets of these surfaces.
Pieces no_pieces(const Surface& slave, const Surface& master)
{
  const auto side = [](const Surface& s)
  { return PieceSide{s.type(), s.degree(), s.num_trace(), {}, {}, {}, {}}; };
  if (slave.block() != slave.gdim())
    throw std::invalid_argument("scalar fields have no gaps with updated geometry");
  Pieces out;
  out.gdim = slave.gdim();
  out.axisymmetric = slave.axisymmetric();
  out.num_multipliers = slave.num_vertices();
  out.slave = side(slave);
  out.master = side(master);
  return out;
}
} // namespace

Pieces qsdolfinx::overlay_pieces(const Surface& slave, const Surface& master, bool both,
                                 KeptPairs& pairs, const OverlayRules& rules)
{
  const SearchRadius& radius = pairs.radius();
  Pieces out = no_pieces(slave, master);
  PairingPoints none(slave, &master);
  const double share = both ? 0.5 : 1.0;
  pairs.find(slave, master, both);
  const auto cut = [&](const Surface& surface, const Surface& other, const PairsOfCut& near)
  {
    Record record{out};
    Overlay(none, surface, other, &surface == &slave, share, radius, near, Normals::facet, rules,
            {}, &record)
        .run();
  };
  cut(slave, master, pairs.of_slave());
  if (both)
    cut(master, slave, pairs.of_master());
  solve_pieces(out);
  return out;
}

Conforming qsdolfinx::conforming_points(const Surface& slave, const Surface& master,
                                        const SearchRadius& radius, const OverlayRules& rules,
                                        std::array<bool, 2> are_flat)
{
  Conforming out{PairingPoints(slave, &master), {}};
  const Curved curved{{{}, facet_curvature(slave), are_flat[0]},
                      {{}, facet_curvature(master), are_flat[1]},
                      &out.found};
  const bool flat = is_flat(slave, *curved.cut.curvature),
             master_flat = is_flat(master, *curved.other.curvature);
  if (flat || master_flat)
    return out;
  KeptPairs pairs(radius);
  pairs.find(slave, master, false);
  Overlay(out.points, slave, master, true, 1, radius, pairs.of_slave(), Normals::bisector, rules,
          curved)
      .run();
  return out;
}
