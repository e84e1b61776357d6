// The extension module, bound folder by folder. Communicators are passed as Fortran handles
// (mpi4py's comm.py2f()), PETSc objects as the `handle` of petsc4py objects, so that no header or
// binary interface of mpi4py or petsc4py is needed.
#include "bindings/module.h"

namespace
{
/// The newest of the levels "", "x86-64-v3" of instructions that this processor has; "" on others.
const char* processor_level()
{
#if defined(__x86_64__)
  if (__builtin_cpu_supports("x86-64-v3"))
    return "x86-64-v3";
#endif
  return "";
}
} // namespace

NB_MODULE(_cpp, m)
{
  m.doc() = "Contact kernels: surfaces, search, pairing points, weighted gaps, tangents.";
  qsdolfinx::bind_surface(m);
  qsdolfinx::bind_search(m);
  qsdolfinx::bind_pairing(m);
  qsdolfinx::bind_gap(m);
  qsdolfinx::bind_sliding(m);
  qsdolfinx::bind_tangent(m);
  qsdolfinx::bind_linear(m);
  m.def("processor_level", &processor_level,
        "Level of x86-64 instructions that this processor has, \"x86-64-v3\" or \"\".");
}
