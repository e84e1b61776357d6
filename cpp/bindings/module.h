// Functions that add the bindings of each folder to the extension module.
#pragma once

#include <nanobind/nanobind.h>

namespace qsdolfinx
{
void bind_surface(nanobind::module_& m);
void bind_search(nanobind::module_& m);
void bind_pairing(nanobind::module_& m);
void bind_gap(nanobind::module_& m);
void bind_sliding(nanobind::module_& m);
void bind_tangent(nanobind::module_& m);
void bind_linear(nanobind::module_& m);
} // namespace qsdolfinx
