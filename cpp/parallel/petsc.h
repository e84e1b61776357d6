// Checks of PETSc return codes and of the finalisation of PETSc and MPI.
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

/// Whether objects of PETSc and MPI can still be destroyed: Python may release its objects after
/// PETSc and MPI have been finalised.
inline bool petsc_is_running()
{
  PetscBool petsc_ended = PETSC_FALSE;
  int mpi_ended = 0;
  return PetscFinalized(&petsc_ended) == PETSC_SUCCESS && !petsc_ended
         && MPI_Finalized(&mpi_ended) == MPI_SUCCESS && !mpi_ended;
}

} // namespace qsdolfinx
