#include "pairing/roles.h"

using namespace qsdolfinx;

namespace
{
/// Cosine of the angle between normals below which facets faced each other.
constexpr double opposed_cosine = -0.2;

} // namespace

int qsdolfinx::is_slave_of(std::span<const double> key, std::span<const double> other)
{
  constexpr Vec3 along{0.61803398875, 0.7548776662, 0.2207440846};
  const Vec3 n = facet_vertex(key, 0), m = facet_vertex(other, 0);
  const int what = dot(n, m) < opposed_cosine ? 0 : 1; // normal or middle
  const double here = dot(facet_vertex(key, what), along),
               there = dot(facet_vertex(other, what), along);
  return here > there ? 1 : (here < there ? -1 : 0);
}

bool qsdolfinx::is_own_wall(std::span<const double> key, std::span<const double> other,
                            double depth, double size)
{
  constexpr double thinnest = 0.3; // fraction of the initial wall thickness
  const Vec3 n = facet_vertex(key, 0), m = facet_vertex(other, 0);
  const double thickness = dot(facet_vertex(key, 1) - facet_vertex(other, 1), n);
  const bool both_free = key[6] > 0 && other[6] > 0;
  return dot(n, m) < opposed_cosine && both_free && thickness > flush_tolerance * size
         && depth > thinnest * thickness;
}
