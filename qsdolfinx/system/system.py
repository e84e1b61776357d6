"""Bodies and contacts as one system of equations: its residual and its tangent."""

from __future__ import annotations

import itertools
import operator
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.rounding import SOLVED
from qsdolfinx.base.timing import Span, Stopwatch, spans
from qsdolfinx.contact import active_set, terms
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.friction.slip import Slip
from qsdolfinx.gap.weighted_gap import WeightedGap
from qsdolfinx.system import stiffness
from qsdolfinx.system.blocks import Side
from qsdolfinx.system.body import Body, body_of
from qsdolfinx.system.matrices import Form, Matrices
from qsdolfinx.tools.rigid_surface import AnySurface

Array = npt.NDArray[np.float64]


class ContactSystem:
    """Residual and tangent of all bodies and contacts together.

    The unknowns of a rank are those of its part of body 0, then of body 1, and so on.

    Args:
        bodies: The bodies.
        contacts: Contacts between them, as used by solvers.
        form: Matrix format for the linear solver.
    """

    def __init__(
        self, bodies: typing.Sequence[Body], contacts: typing.Sequence[ContactModel], form: Form
    ) -> None:
        self.bodies = list(bodies)
        self.u = [body.u for body in bodies]
        for number, body in enumerate(self.bodies):
            body.number = number
        self.contacts = list(contacts)
        #: Bodies of the slave and the master of each contact; None for a rigid tool.
        self.sides: list[Side] = []
        for contact in contacts:
            slave, master = body_of(self.u, contact.slave.V), body_of(self.u, contact.master.V)
            assert slave is not None
            self.sides.append((slave, master))
            for i in (slave, master):
                if i is not None:
                    self.bodies[i].geometry = contact.slave.geometry
        #: Rigid tools, each once, and the number of each contact's tool; None for a body.
        self.tools = list(dict.fromkeys(tool for c in contacts for tool in c.master.tools))
        numbers: dict[AnySurface, int] = {tool: i for i, tool in enumerate(self.tools)}
        self.tool_numbers = [numbers.get(contact.master) for contact in contacts]
        for contact, side in zip(self.contacts, self.sides, strict=True):
            if contact.mechanics is not None and contact.mechanics.of in self.contacts:
                same = self.sides[self.contacts.index(contact.mechanics.of)] == side
                contact.with_bodies = same
        self.form = form
        multigrid = all(body.V.dofmap.index_map_bs > 1 for body in bodies)  # without pressures
        for body in self.bodies:
            if form is not Form.NEST and body.V.dofmap.index_map_bs > 1:
                body.matrix_type = PETSc.Mat.Type.BAIJ
                body.may_halve = form is Form.SUM and multigrid
        #: Wall time of this rank in conversion and in the solver.
        self.watch = Stopwatch()
        self._ends = np.cumsum([body.num_owned for body in self.bodies])
        self._made: Matrices | None = None
        #: Whether PETSc's objects have been freed.
        self.is_destroyed = False
        self._paired: list[object] = []
        self._driven: list[bool] = []
        self._scales: list[float] = []
        self._assembled: list[object] | None = None
        self._assembled_at: list[object] = []
        #: Modulus E of each contact (stress), when matrices were last made.
        self.moduli: list[float] = []
        #: Owned unknowns at the last evaluation.
        self.evaluated: Array = np.zeros(0)
        #: Residual of the bulk forms at the last evaluation, owned unknowns of each body.
        self.bulk_residuals: list[Array] = []
        #: Total residual at the last evaluation, owned rows of each body.
        self.residuals: list[Array] = []
        sizes = self._ends[-1], PETSc.DETERMINE
        self._x: PETSc.Vec = PETSc.Vec().createMPI(sizes, comm=self.comm)
        self._r: PETSc.Vec = self._x.duplicate()

    @property
    def x(self) -> PETSc.Vec:
        """Unknowns of all bodies."""
        self.check_alive()
        return self._x

    @property
    def r(self) -> PETSc.Vec:
        """Residual of all bodies."""
        self.check_alive()
        return self._r

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator of the bodies."""
        return self.bodies[0].comm

    @property
    def unknowns(self) -> list[str]:
        """Unknowns of each body, set by its contacts: ``"displacement"`` or ``"velocity"``."""
        return self._of_bodies(
            "displacement", [contact.kinematics.unknown for contact in self.contacts]
        )

    @property
    def scales(self) -> list[float]:
        """Displacement per unknown of each body."""
        return self._of_bodies(1.0, [contact.kinematics.scale for contact in self.contacts])

    def _of_bodies(self, default: typing.Any, of_contacts: list[typing.Any]) -> list[typing.Any]:
        """Values that contacts give for their two bodies, sorted by body."""
        out = [default] * len(self.bodies)
        for contact, sides, values in zip(self.contacts, self.sides, of_contacts, strict=True):
            if contact.is_scalar:
                continue  # a field on a body does not determine its motion
            for i, value in zip(sides, values, strict=True):
                if i is not None:
                    out[i] = value
        return out

    @property
    def timings(self) -> dict[str, Span]:
        """Wall time (s) by stage, see :attr:`qs.ContactProblem.timings`. Collective."""
        watches = [*(b.watch for b in self.bodies), *(c.watch for c in self.contacts), self.watch]
        return spans(self.comm, watches)

    @property
    def gaps(self) -> list[WeightedGap]:
        """Gaps of all contacts."""
        return [gap for contact in self.contacts for gap in contact.gaps]

    @property
    def slips(self) -> list[Slip]:
        """Slips of all contacts; none without friction."""
        return [slip for contact in self.contacts for slip in contact.slips]

    @property
    def linear(self) -> bool:
        """Whether all bodies and gaps are linear as long as the active set does not change."""
        bodies = all(body.linear for body in self.bodies)
        return bodies and all(contact.is_linear for contact in self.contacts)

    def have_vertices_changed(self) -> bool:
        """Update which vertices have their own points; return whether they change. Collective."""
        return any([gap.choose_vertices() for gap in self.gaps])

    @property
    def free_bodies(self) -> list[int]:
        """Numbers of the bodies with a rigid motion that no condition prevents."""
        rigid = self.made.rigid
        ends = np.cumsum([0, *(len(modes) for modes in rigid.modes)])
        motions = rigid.free_motions
        free = [np.abs(motions[a:b]).max(initial=0.0) for a, b in itertools.pairwise(ends)]
        return [i for i, size in enumerate(free) if size > SOLVED]

    def fits_pattern(self) -> bool:
        """Whether the patterns of matrices contain contact at present positions. Collective."""
        following = [gap for c in self.contacts if c.follows for gap in c.gaps]
        if not following:
            return True
        fits = all([gap.fits_pattern() for gap in following])
        return bool(self.comm.allreduce(fits, op=MPI.LAND))

    def num_active_local(self) -> list[int]:
        """Number of active constraints of each contact on this rank at the last evaluation."""
        return [active_set.num_closed(contact) for contact in self.contacts]

    def num_paired(self) -> int:
        """Number of paired nodes of all ranks at the last evaluation. Collective.

        Only contacts with finite sliding are counted.
        """
        gaps = [gap for contact in self.contacts if contact.follows for gap in contact.gaps]
        if not gaps:
            return 0
        found = sum(len(gap.rows.reached) for gap in gaps)
        return int(self.comm.allreduce(found, op=MPI.SUM))

    def part(self, array: Array, i: int) -> Array:
        """Part of an array of owned unknowns that belongs to body i."""
        return array[self._ends[i] - self.bodies[i].num_owned : self._ends[i]]

    def parts(self, array: Array) -> list[Array]:
        """Parts of an array of owned unknowns for all bodies."""
        return [self.part(array, i) for i in range(len(self.bodies))]

    def norm(self, owned: Array) -> float:
        """2-norm of a vector given by its owned values. Collective."""
        return float(np.sqrt(self.comm.allreduce(owned @ owned, op=MPI.SUM)))

    # --- Matrices

    @property
    def made(self) -> Matrices:
        """Matrices for the present contact pairs; see :meth:`rebuild`."""
        self.check_alive()
        assert self._made is not None
        return self._made

    @property
    def matrix(self) -> PETSc.Mat:
        """The tangent as a matrix for the linear solver."""
        return self.made.matrix

    @property
    def has_matrices(self) -> bool:
        """Whether matrices have been made."""
        return self._made is not None

    @property
    def is_stale(self) -> bool:
        """Whether matrices have to be built, or rebuilt."""
        # A failed attempt, after which penalties are restored, may have been the first to measure
        # them.
        forgotten = any(not contact.penalty.is_measured for contact in self.contacts)
        return self._made is None or forgotten or not self._is_paired()

    def _is_paired(self) -> bool:
        """Whether the matrices were made for the present contact pairs.

        This includes that the same tools are force-controlled, since it determines which nodes are
        constrained on both sides, and that the displacement per unknown is the same.
        """
        paired = [contact.paired for contact in self.contacts]
        same = len(paired) == len(self._paired) and all(map(operator.is_, paired, self._paired))
        driven = self._driven == [tool.driven is not None for tool in self.tools]
        return same and driven and self._scales == self.scales

    def make_stale(self) -> None:
        """Mark the matrices as outdated, so that they are rebuilt before the next use."""
        self._paired = [None] * (len(self.contacts) + 1)

    def rebuild(self) -> None:
        """Rebuild penalties, patterns and matrices after contact updates. Collective."""
        self.check_alive()
        self.renew_matrices(measures=True)
        self._paired = [c.paired for c in self.contacts]
        self._driven = [tool.driven is not None for tool in self.tools]
        self._scales = self.scales

    def renew_matrices(self, measures: bool = False) -> None:
        """Create patterns and matrices for the present positions. Collective.

        Args:
            measures: Whether stiffness and penalties are computed again. This changes results.
        """
        self.destroy_matrices()
        bulk = [body.matrix() for body in self.bodies]
        parts = self.bodies, self.contacts, self.sides
        if measures:
            self.moduli = stiffness.measure(*parts, self.scales, bulk, self.form)
        self._made = Matrices(*parts, bulk, self.scales, self.form, self.watch)
        self._assembled = None

    def destroy_matrices(self) -> None:
        """Free the matrices. Collective."""
        made, self._made = self._made, None
        if made is not None:
            made.destroy()

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""
        self.is_destroyed = True
        self.destroy_matrices()
        self._x.destroy()
        self._r.destroy()
        for body in self.bodies:
            body.destroy()

    def check_alive(self) -> None:
        """Raise an error if PETSc's objects have been freed: any use would crash.

        Raises:
            RuntimeError: If the objects have been freed.
        """
        if self.is_destroyed:
            raise RuntimeError("the problem has been destroyed: make a new one")

    def replace_vectors(self) -> None:
        """Replace the vectors: PETSc leaves vectors locked after an error in a callback."""
        new = [vec.duplicate() for vec in (self.x, self.r)]
        self.x.copy(new[0])
        self.x.destroy()
        self.r.destroy()
        self._x, self._r = new
        self.make_stale()  # users of the old vectors are set up again

    # --- Evaluation

    def residual(self, x: Array) -> Array:
        """Residual at the owned unknowns x; sets u, gaps and multipliers to x. Collective."""
        self.check_alive()
        self.evaluated = x.copy()
        residuals = [body.residual(self.part(x, i)) for i, body in enumerate(self.bodies)]
        self.bulk_residuals = [residual.copy() for residual in residuals]
        forces = [body.force for body in self.bodies]
        for force in forces:
            force.zeroEntries()
        self.evaluate_contacts()
        for contact, (s, m) in zip(self.contacts, self.sides, strict=True):
            terms.add_residual(contact, forces[s], None if m is None else forces[m])
        for body, residual, force in zip(self.bodies, residuals, forces, strict=True):
            residual[body.free] += force.array_r[body.free]
        self.residuals = residuals
        return np.concatenate(residuals)

    def evaluate_contacts(self) -> None:
        """Compute gaps and slips for the present unknowns of the bodies. Collective."""
        pairs = list(zip(self.contacts, self.sides, strict=True))
        # Conductances depend on the contact of the bodies, which is therefore evaluated first.
        for contact, (s, m) in sorted(pairs, key=lambda pair: pair[0].mechanics is not None):
            terms.evaluate(contact, self.bodies[s].x, None if m is None else self.bodies[m].x)

    def tangent(self, x: Array) -> PETSc.Mat:
        """Derivative of the residual at the owned unknowns x, in ``matrix``. Collective."""
        self.residual(x)
        self._assembled = None
        self.assemble()
        return self.matrix

    def assemble(self) -> bool:
        """Assemble the tangent at the last evaluation, unless it is up to date. Collective.

        For linear bodies it depends only on the active set: while this does not change, the linear
        solver keeps its factors.

        Returns:
            Whether the tangent has changed.
        """
        self.check_alive()
        discrete = self._discrete_state()
        state = discrete + [active_set.tangent_state(contact) for contact in self.contacts]
        if self.linear and self.comm.allreduce(self._assembled == state, op=MPI.LAND):
            return False
        self.made.assemble()
        self.made.hold.add_to(self.made.tangent)
        self.matrix.setOption(PETSc.Mat.Option.SYMMETRIC, self.symmetric)
        self._assembled, self._assembled_at = state, discrete
        return True

    def forget_tangent(self) -> None:
        """Mark the tangent as outdated, so that it is assembled before the next use."""
        self._assembled = None

    def tangent_fits(self) -> bool:
        """Whether the tangent was assembled with the present active set. Collective."""
        same = self._assembled is not None and self._assembled_at == self._discrete_state()
        return self.comm.allreduce(same, op=MPI.LAND)

    def _discrete_state(self) -> list[object]:
        """State that determines the tangent besides the positions and slip rates of bodies."""
        state: list[object] = [body.fingerprint for body in self.bodies]
        for contact in self.contacts:
            state += [contact.eps, contact.kinematics.scale, active_set.active_state(contact)]
        return state

    @property
    def moves(self) -> bool:
        """Whether constraints of any contact move with the bodies (finite sliding)."""
        return any(contact.settings.sliding == "finite" for contact in self.contacts)

    @property
    def symmetric(self) -> bool:
        """Whether the tangent is symmetric; this is set on its matrix."""
        bulk = self._made is None or self._made.bulk_symmetric
        return bulk and all(contact.symmetric for contact in self.contacts)
