// NumPy arrays and handles in the bindings, with types that are exact in the generated stub.
#pragma once

#include "geometry/facet.h"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace qsdolfinx
{

/// Argument: an array in C order.
template <typename T>
struct In
{
  using Array = nanobind::ndarray<const T, nanobind::c_contig, nanobind::device::cpu>;
  Array array;

  std::span<const T> view() const { return {array.data(), array.size()}; }
};

/// Result: an array that owns its data.
template <typename T>
using Out = nanobind::typed<nanobind::object, In<T>>;

/// NumPy array of the given shape. It owns a copy of the data; temporary data are moved, not
/// copied.
template <typename T>
Out<T> copy(std::vector<T> data, std::initializer_list<std::size_t> shape)
{
  auto* owned = new std::vector<T>(std::move(data));
  nanobind::capsule owner(owned, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  const nanobind::ndarray<nanobind::numpy, T> array(owned->data(), shape, owner);
  return nanobind::steal<Out<T>>(nanobind::cast(array).release());
}

/// PETSc object, passed as the `handle` of the petsc4py object.
using Handle = std::uintptr_t;

inline FacetType facet_type(int num_vertices)
{
  if (num_vertices < 2 || num_vertices > 4)
    throw nanobind::value_error("a facet has 2, 3 or 4 vertices");
  return static_cast<FacetType>(num_vertices);
}

} // namespace qsdolfinx

namespace nanobind::detail
{
// nanobind's own names for arrays would leave the entry type of an array out of the stub.
template <typename T>
constexpr auto array_name = [] { static_assert(sizeof(T) == 0, "no name for this type"); }();
template <>
inline constexpr auto array_name<double> = const_name("numpy.typing.NDArray[numpy.float64]");
template <>
inline constexpr auto array_name<std::int64_t> = const_name("numpy.typing.NDArray[numpy.int64]");
template <>
inline constexpr auto array_name<std::int32_t> = const_name("numpy.typing.NDArray[numpy.int32]");
template <>
inline constexpr auto array_name<std::uint8_t> = const_name("numpy.typing.NDArray[numpy.uint8]");

template <typename T>
struct type_caster<qsdolfinx::In<T>>
{
  NB_TYPE_CASTER(qsdolfinx::In<T>, array_name<T>)

  bool from_python(handle source, std::uint8_t flags, cleanup_list* cleanup) noexcept
  {
    make_caster<typename qsdolfinx::In<T>::Array> caster;
    if (!caster.from_python(source, flags, cleanup))
      return false;
    value.array = std::move(caster.value);
    return true;
  }
};
} // namespace nanobind::detail
