"""Matrices for the present contact pairs: tangent, near-nullspaces, free rigid motions."""

from __future__ import annotations

import enum
import typing

from petsc4py import PETSc

import numpy as np

from qsdolfinx.base.timing import Stopwatch
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.system.additive import Additive
from qsdolfinx.system.blocks import Blocks, Sides
from qsdolfinx.system.body import Body
from qsdolfinx.system.free_motion import Hold
from qsdolfinx.system.monolithic import Monolithic
from qsdolfinx.system.rigid_modes import RigidMotion, rigid_modes, set_modes, set_near_nullspace
from qsdolfinx.system.symmetry import is_symmetric
from qsdolfinx.system.tangent import Tangent


class Form(str, enum.Enum):
    """Matrix format for the linear solver: MatNest, one AIJ matrix, or an unassembled sum."""

    NEST = "nest"
    MPI = "mpi"
    SUM = "sum"


class Matrices:
    """Objects that must be built anew after each update of the contact pairs.

    Args:
        bodies: The bodies.
        contacts: Contacts with the penalty already known.
        sides: Bodies of each contact.
        bulk: Bulk block of each body.
        scales: Displacement per unknown of each body.
        form: Matrix format for the linear solver.
        watch: Counts the time for the stage "conversion".
    """

    def __init__(
        self,
        bodies: typing.Sequence[Body],
        contacts: typing.Sequence[ContactModel],
        sides: Sides,
        bulk: typing.Sequence[PETSc.Mat],
        scales: typing.Sequence[float],
        form: Form,
        watch: Stopwatch,
    ) -> None:
        self._bodies = bodies
        self._form = form
        symmetric = [is_symmetric(matrix) for matrix in bulk]
        self._are_symmetric = symmetric
        self._asked = [body.num_assemblies for body in bodies]
        #: Contact blocks, which include bulk only in the MatNest; None for a sum.
        self.blocks: Blocks | None = None
        #: The tangent, which is assembled.
        self.tangent: Tangent
        if form is Form.SUM:
            self.tangent = Additive(bodies, contacts, sides, bulk, scales, symmetric, watch)
        else:
            is_nest = form is Form.NEST
            self.blocks = Blocks(bodies, contacts, sides, bulk, bulk=is_nest)
            self.tangent = self.blocks if is_nest else Monolithic(bodies, self.blocks, bulk, watch)
        if form is Form.NEST:
            for body in bodies:
                body.free_matrix()
        self.rigid = RigidMotion(bodies)
        self.hold = Hold(self.rigid, bodies, contacts, sides)
        self._set_near_nullspaces()

    @property
    def bulk_symmetric(self) -> bool:
        """Whether the bulk blocks are symmetric; for a sum the present blocks. Collective."""
        if isinstance(self.tangent, Additive):
            return all(self.tangent.are_symmetric)
        self._ask()
        return all(self._are_symmetric)

    def assemble(self) -> None:
        """Assemble the tangent for the present state of bodies and contacts. Collective."""
        if not isinstance(self.tangent, Additive):  # the sum checks this itself
            self._ask()
        self.tangent.assemble()

    def _ask(self) -> None:
        """Check whether blocks of linear bodies are symmetric, if they have changed."""
        for i, body in enumerate(self._bodies):
            if body.linear and body.num_assemblies != self._asked[i]:  # a Constant has changed
                self._are_symmetric[i] = is_symmetric(body.matrix())
                self._asked[i] = body.num_assemblies

    @property
    def matrix(self) -> PETSc.Mat:
        """The tangent as a matrix for the linear solver."""
        return self.tangent.matrix

    def destroy(self) -> None:
        """Free the matrices, which petsc4py would keep in parallel. Collective."""
        self.tangent.destroy()
        if self.blocks is not None and self.blocks is not self.tangent:
            self.blocks.destroy()
        self.rigid.destroy()

    def _set_near_nullspaces(self) -> None:
        for i in range(len(self.rigid.modes)):
            block = None if self.blocks is None else self.blocks.block(i, i)
            if block is not None:
                self.set_near_nullspace(i, block)
        if self._form is Form.MPI:
            self.set_near_nullspaces(self.matrix)

    def set_near_nullspace(self, i: int, block: PETSc.Mat) -> None:
        """Set the rigid modes of body i on its block. Collective."""
        if self.rigid.modes[i]:
            set_near_nullspace(block, self.rigid.modes[i])

    def set_near_nullspaces(self, matrix: PETSc.Mat) -> None:
        """Set the rigid modes of all bodies on the AIJ matrix, if all have modes. Collective."""
        if not all(self.rigid.modes):
            return
        gdim = self._bodies[0].V.mesh.geometry.dim
        if all(body.V.dofmap.index_map_bs == gdim for body in self._bodies):
            matrix.setBlockSize(gdim)  # for multigrid
        set_modes(matrix, np.hstack([rigid_modes(body) for body in self._bodies]))
