#include "bindings/arrays.h"
#include "bindings/module.h"
#include "linear/block_product.h"

namespace nb = nanobind;
using namespace nb::literals;
using namespace qsdolfinx;

void qsdolfinx::bind_linear(nb::module_& m)
{
  nb::class_<BlockProduct>(m, "BlockProduct",
                           "Products with a body's matrix; see linear/block_product.h.")
      .def(
          "__init__", [](BlockProduct* self, Handle matrix)
          { new (self) BlockProduct(reinterpret_cast<Mat>(matrix)); }, "matrix"_a,
          "For a matrix that must outlive this object; collective.")
      .def_static(
          "is_for",
          [](Handle matrix) { return BlockProduct::is_for(reinterpret_cast<Mat>(matrix)); },
          "matrix"_a, "Whether a matrix has blocks of size 2 or 3.")
      .def(
          "apply", [](BlockProduct& self, Handle x, Handle y)
          { self.apply(reinterpret_cast<Vec>(x), reinterpret_cast<Vec>(y)); }, "x"_a, "y"_a,
          "Write the product of the matrix and a vector x to y; collective.");
}
