// Return codes of PETSc.
#pragma once

#include <petscsys.h>
#include <stdexcept>
#include <string>

namespace qsdolfinx
{

/// Throw if a PETSc call failed.
inline void check(PetscErrorCode code)
{
  if (code != PETSC_SUCCESS)
    throw std::runtime_error("PETSc error " + std::to_string(code));
}

} // namespace qsdolfinx
