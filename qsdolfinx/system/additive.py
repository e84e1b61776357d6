"""The tangent as an unassembled sum of the matrices of the bodies and of contact."""

from __future__ import annotations

import functools
import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.timing import Stopwatch
from qsdolfinx.contact import terms
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.system.blocks import Blocks, Sides
from qsdolfinx.system.body import Body
from qsdolfinx.system.entries import joined
from qsdolfinx.system.factored import Formed
from qsdolfinx.system.factors import ContactFactors
from qsdolfinx.system.sum import Sum
from qsdolfinx.system.symmetry import is_symmetric

Array = npt.NDArray[np.float64]


class Additive:
    """Tangent of all bodies, see :class:`Sum`.

    The matrices of the bodies are not copied. Contact is kept in factors, except for friction that
    depends on the pressure at points, whose gaps get new weights each time.

    Args:
        bodies: The bodies.
        contacts: Contacts with the penalty already known.
        sides: Bodies of each contact.
        matrices: Bulk block of each body.
        scales: Displacement per unknown of each body.
        symmetric: Whether the bulk blocks are symmetric.
        watch: Counts the time for the stage "conversion".
    """

    def __init__(
        self,
        bodies: typing.Sequence[Body],
        contacts: typing.Sequence[ContactModel],
        sides: Sides,
        matrices: typing.Sequence[PETSc.Mat],
        scales: typing.Sequence[float],
        symmetric: typing.Sequence[bool],
        watch: Stopwatch,
    ) -> None:
        self._bodies, self._watch = bodies, watch
        #: Whether the present block of each body is symmetric.
        self.are_symmetric = list(symmetric)
        self._asked = [body.num_assemblies for body in bodies]
        self._contact: ContactFactors | ContactFormed
        if all(terms.has_factors(contact) for contact in contacts):
            with watch.stage("conversion"):
                self._contact = ContactFactors(contacts, sides, matrices, scales)
        else:
            self._contact = ContactFormed(bodies, contacts, sides, watch)
        #: Whether the pattern of contact has changed since the last set-up of multigrid.
        self.has_other_pattern = False
        parts = [(K, body.linear) for K, body in zip(matrices, bodies, strict=True)]
        #: The terms of the sum.
        self.sum = Sum(parts, self._contact.product)
        self.matrix = self.sum.matrix

    @property
    def factors(self) -> ContactFactors:
        """The contact terms in factors."""
        assert isinstance(self._contact, ContactFactors)
        return self._contact

    @property
    def has_factors(self) -> bool:
        """Whether contact is kept in factors."""
        return isinstance(self._contact, ContactFactors)

    @property
    def contact_matrix(self) -> PETSc.Mat:
        """Contact as a single matrix; only if it is not kept in factors."""
        assert isinstance(self._contact, ContactFormed)
        return self._contact.product.matrix

    def assemble(self) -> None:
        """Update the sum to the present state of bodies and contacts. Collective."""
        self._follow_bodies()
        if isinstance(self._contact, ContactFormed) and self._contact.is_other:
            self.has_other_pattern = True
        self._contact.update()
        self.sum.renew()

    def assemble_with(
        self,
        stiffness: typing.Sequence[tuple[WeightedGap | Slip, terms.Weights]],
        shift: Array | None,
    ) -> None:
        """Update the sum to the bodies' present state and given contact stiffness. Collective.

        Args:
            stiffness: Stiffness of the constraints of gaps and slips.
            shift: Values added to the diagonal, for owned unknowns.
        """
        self._follow_bodies()
        self.factors.set(stiffness)
        self.sum.renew(shift)

    def assemble_beside(self, contact: PETSc.Mat, shift: Array | None) -> None:
        """Update the sum to the bodies' present state and a contact matrix. Collective.

        Args:
            contact: AIJ matrix, which this object then owns; its pattern may differ from the
                previous one. Or :attr:`contact_matrix` with other entries.
            shift: Values added to the diagonal, for owned unknowns.
        """
        self._follow_bodies()
        assert isinstance(self._contact, ContactFormed)
        same = contact is self.contact_matrix
        if not same and not self._contact.product.take(contact):
            self._contact.is_other = self.has_other_pattern = True
        self.sum.renew(shift)

    def _follow_bodies(self) -> None:
        """Get the present matrices of the bodies. Collective."""
        for i, body in enumerate(self._bodies):
            K = body.matrix()
            self.sum.take(i, K)
            if body.num_assemblies != self._asked[i]:  # convective terms are symmetric only at rest
                self.are_symmetric[i] = is_symmetric(K)
                self._asked[i] = body.num_assemblies

    def diagonal(self, i: int) -> Array:
        """Diagonal of body i's block on this rank. Collective."""
        diagonal = self.matrix.getDiagonal()
        out: Array = diagonal.array_r[self.sum.parts[i]].copy()
        diagonal.destroy()
        return out

    def set_diagonal(self, i: int, values: Array) -> None:
        """Replace the diagonal of body i's block. Collective."""
        parts, shift = self.sum.parts, self.sum.shift
        out = np.zeros(parts[-1].stop) if shift is None else shift.copy()
        out[parts[i]] += values - self.diagonal(i)
        self.sum.renew(out)

    def renew(self) -> None:
        """Do nothing: no state is kept between assemblies."""

    def destroy(self) -> None:
        """Free the matrices, except those of the bodies. Collective."""
        self.sum.destroy()
        self._contact.destroy()


class ContactFormed:
    """All contacts as one AIJ matrix.

    Args:
        bodies: The bodies.
        contacts: Contacts with the penalty already known.
        sides: Bodies of each contact.
        watch: Counts the time for the stage "conversion".
    """

    def __init__(
        self,
        bodies: typing.Sequence[Body],
        contacts: typing.Sequence[ContactModel],
        sides: Sides,
        watch: Stopwatch,
    ) -> None:
        self._watch = watch
        self._blocks: Blocks | None = None
        self._bodies, self._make = bodies, functools.partial(Blocks, bodies, contacts, sides)
        size = sum(body.num_owned for body in bodies)
        #: The matrix, empty at first, and whether its pattern differs from that of the blocks.
        self.product = Formed(joined([]).matrix(size, size, bodies[0].comm))
        self.is_other = True

    def update(self) -> None:
        """Update the matrix to the present contacts. Collective."""
        if self._blocks is None:
            self._blocks = self._make([body.matrix() for body in self._bodies], bulk=False)
        self._blocks.assemble()
        with self._watch.stage("conversion"):
            if self.is_other:
                self.product.replace(self._blocks.matrix.convert("aij", PETSc.Mat()))
                self.is_other = False
            else:
                self._blocks.matrix.convert(PETSc.Mat.Type.AIJ, self.product.matrix)

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""
        self.product.destroy()
        if self._blocks is not None:
            self._blocks.destroy()
