"""Contact blocks of the tangent as a MatNest, optionally with the bulk on its diagonal."""

from __future__ import annotations

import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.contact import terms
from qsdolfinx.contact.model import BlocksOf, ContactModel
from qsdolfinx.system.body import Body

#: Body (index) of the slave's and of the master's side of a contact, None for a rigid tool.
Side = tuple[int, int | None]
Sides = typing.Sequence[Side]


class Blocks:
    """MatNest whose pattern is constant until the contact pairs are updated.

    Args:
        bodies: The bodies.
        contacts: Contacts with the penalty already known.
        sides: Bodies of each contact.
        matrices: Bulk block of each body, for its layout, and for its pattern if ``bulk`` is set.
        bulk: Whether the blocks on the diagonal include the bulk.
    """

    def __init__(
        self,
        bodies: typing.Sequence[Body],
        contacts: typing.Sequence[ContactModel],
        sides: Sides,
        matrices: typing.Sequence[PETSc.Mat],
        bulk: bool,
    ) -> None:
        self._bulk = bulk
        self._bodies = bodies
        self._contacts = contacts
        self._sides = sides
        coupled = {(i, i) for i in range(len(bodies))}
        coupled |= {pair for s, m in sides if m is not None for pair in ((s, m), (m, s))}
        self._mats = {(i, j): _contact_pattern(matrices, i, j) for i, j in sorted(coupled)}
        for contact, side in zip(contacts, sides, strict=True):
            terms.add_pattern(contact, self._of(*side))
        for (i, j), mat in self._mats.items():
            mat.assemble()
            if i == j and bulk:
                mat.axpy(1.0, matrices[i], structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
                mat.setLGMap(*matrices[i].getLGMap())
            mat.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
            forbid_allocation(mat)
        rows = range(len(bodies))
        self.matrix: PETSc.Mat = PETSc.Mat().createNest(
            [[self._mats.get((i, j)) for j in rows] for i in rows], comm=bodies[0].comm
        )
        self.matrix.assemble()

    @property
    def nest(self) -> PETSc.Mat:
        """The MatNest."""
        return self.matrix

    def _of(self, slave: int, master: int | None) -> BlocksOf:
        """Blocks ss, sm, ms, mm of a contact; those of a rigid master are None."""
        if master is None:
            return self._mats[slave, slave], None, None, None
        of = self._mats
        return of[slave, slave], of[slave, master], of[master, slave], of[master, master]

    def block(self, i: int, j: int) -> PETSc.Mat | None:
        """Block of bodies i and j, None where no contact couples them."""
        return self._mats.get((i, j))

    def diagonal(self, i: int) -> npt.NDArray[np.float64]:
        """Diagonal of body i's block on this rank. Collective."""
        diagonal = self._mats[i, i].getDiagonal()
        out: npt.NDArray[np.float64] = diagonal.array_r.copy()
        diagonal.destroy()
        return out

    def set_diagonal(self, i: int, values: npt.NDArray[np.float64]) -> None:
        """Replace the diagonal of body i's block. Collective."""
        diagonal = self._mats[i, i].getDiagonal()
        diagonal.array[:] = values
        self._mats[i, i].setDiagonal(diagonal)
        diagonal.destroy()

    def renew(self) -> None:
        """Do nothing: no state is kept between assemblies."""

    def destroy(self) -> None:
        """Free the matrices. Collective."""
        self.matrix.destroy()
        for mat in self._mats.values():
            mat.destroy()

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Bodies of each existing block."""
        return list(self._mats)

    def assemble(self) -> None:
        """Fill all blocks for the bodies' and the contacts' present state. Collective."""
        for mat in self._mats.values():
            mat.zeroEntries()
        for i, body in enumerate(self._bodies):
            if self._bulk:
                body.add_tangent(self._mats[i, i])
        for one, side in zip(self._contacts, self._sides, strict=True):
            terms.add_tangent(one, self._of(*side))
        for mat in self._mats.values():
            mat.assemble()
        self.matrix.assemble()


def forbid_allocation(mat: PETSc.Mat) -> None:
    """Make PETSc raise if an entry is ever inserted outside the pattern."""
    mat.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, True)
    mat.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, True)


def _contact_pattern(matrices: typing.Sequence[PETSc.Mat], i: int, j: int) -> PETSc.Mat:
    """Empty matrix that takes any entries, until it is assembled."""
    comm: MPI.Intracomm = matrices[i].comm
    mat = PETSc.Mat().create(comm=comm)
    mat.setSizes((matrices[i].getSizes()[0], matrices[j].getSizes()[1]))
    mat.setType(PETSc.Mat.Type.AIJ)
    mat.setBlockSizes(matrices[i].getBlockSizes()[0], matrices[j].getBlockSizes()[1])
    mat.setUp()
    return mat
