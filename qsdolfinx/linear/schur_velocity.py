"""The velocity block of the linear solver ``"schur"``."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.linear.condensed import Condensed
from qsdolfinx.linear.hierarchy import Hierarchy
from qsdolfinx.linear.presets import VELOCITY
from qsdolfinx.system.body import Body
from qsdolfinx.system.sum import Sum

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class VelocityBlock:
    """Multigrid for the velocities and displacements of all bodies, with contact.

    Contact is neither added to the bodies' blocks nor coarsened with them, see
    :class:`qsdolfinx.linear.multigrid.Multigrid`.

    Args:
        bodies: The bodies.
        tangent: The tangent of all unknowns.
        pressures: Owned pressure unknowns of each body.
        scales: Displacement per unknown of each body.
        hierarchy: Multigrid's spaces.
        prefix: Prefix of the options.
    """

    def __init__(
        self,
        bodies: typing.Sequence[Body],
        tangent: Sum,
        pressures: typing.Sequence[Indices],
        scales: typing.Sequence[float],
        hierarchy: Hierarchy,
        prefix: str,
    ) -> None:
        self._tangent, self._hierarchy = tangent, hierarchy
        self._parts = [
            Condensed(body, K, dofs, scale)
            for body, (K, _), dofs, scale in zip(
                bodies, tangent.bodies, pressures, scales, strict=True
            )
        ]
        ends = zip(tangent.parts, self._parts, strict=True)
        #: Owned unknowns of all bodies in the multigrid matrix.
        self._vertices = np.concatenate([part.start + body.vertices for part, body in ends])
        first, comm = tangent.matrix.getOwnershipRange()[0], tangent.matrix.comm
        self._set = PETSc.IS().createGeneral((first + self._vertices).astype(np.int32), comm=comm)
        sizes = (self._vertices.size, PETSc.DETERMINE)
        self._r, self._x, self._scale = (PETSc.Vec().createMPI(sizes, comm=comm) for _ in range(3))
        rows = [np.full(p.vertices.size, s) for p, s in zip(self._parts, scales, strict=True)]
        self._scale.array[:] = np.concatenate(rows)
        self._contact = tangent.contact.restricted(self._set, self._scale)
        blocks = [(part.A, part.stays) for part in self._parts]
        self._sum = Sum(blocks, self._contact)
        self._pc = PETSc.PC().create(comm)
        self._pc.setOptionsPrefix(prefix + VELOCITY)
        self._pc.setFromOptions()

    def update(self) -> None:
        """Update for the present tangent. Collective."""
        for part in self._parts:
            part.update()
        self._contact.follow()
        shift = self._tangent.shift
        self._sum.renew(None if shift is None else self._scale.array_r * shift[self._vertices])
        modes = [part.modes for part in self._parts]
        self._hierarchy.update(self._pc, self._sum, modes)
        self._pc.setOperators(self._sum.matrix)  # a new hierarchy begins with a reset
        self._pc.setUp()

    def apply(self, r: Array, out: Array) -> None:
        """Approximate solution; the pressures of ``out`` are unchanged. Collective.

        Args:
            r: Right-hand side, owned values of all unknowns.
            out: Owned values of the solution.
        """
        parts, vertices = self._tangent.parts, self._sum.parts
        for body, part, place in zip(self._parts, parts, vertices, strict=True):
            self._r.array[place] = body.reduce(r[part])
        self._pc.apply(self._r, self._x)
        for body, part, place in zip(self._parts, parts, vertices, strict=True):
            body.expand(self._x.array_r[place], out[part])

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""
        self._hierarchy.forget()
        for body in self._parts:
            body.destroy()
        self._sum.destroy()
        things = self._pc, self._set, self._contact, self._r, self._x, self._scale
        for thing in things:
            thing.destroy()
