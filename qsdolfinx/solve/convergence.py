"""When Newton's method may end: forces on each body against the forces that act on that body."""

from __future__ import annotations

import dataclasses

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.system.system import ContactSystem

Array = npt.NDArray[np.float64]

#: Norm of the residual that rounding may leave, over that of eps K_ii x_i.
ROUNDING = 50.0

#: Rounding that may be left, over the forces.
NOTICED = 1e-6

#: Last step over the unknowns, both in the 2-norm, of a method that has come to rest.
RESTING = 1e-4

#: Displacement over the size of a cell, of a body that counts as undeformed.
UNDEFORMED = 1e-4

#: The same of a body that has flown away: a step that is small beside that is no rest.
FLOWN = 1e6

#: A residual that an iteration leaves above this part has met rounding.
STALLED = 0.5


@dataclasses.dataclass(frozen=True)
class Measures:
    """Norms, one for each group of rows of each body.

    Attributes:
        residuals: Of the residual.
        sizes: Of what acts in these rows: contact forces and reactions; in those of a constraint,
            such as incompressibility, of the terms that cancel: of the displacement, and what a
            body at rest has, of the constraint's own unknown.
        rounding: Of what rounding may leave, of gaps beside coordinates too: a bound, which matters
            where an iteration no longer helps.
        settled: Of the same while the active set stays: gaps are changed as displacements are.
        nothing: Of a residual that is none beside the largest forces on any body.
        undeformed: Whether the body's displacements are a small part of its cells.
        flown: Whether they are by far larger.
    """

    residuals: Array
    sizes: Array
    rounding: Array
    settled: Array
    nothing: Array
    undeformed: npt.NDArray[np.bool_]
    flown: npt.NDArray[np.bool_]

    def limits(self, relative: float) -> Array:
        """Norms with which a run of Newton's method may end, if rounding allows.

        Args:
            relative: Tolerance, in units of ``sizes``.
        """
        return np.maximum(relative * self.sizes, self.nothing)

    def with_rounding(self, limits: Array, least: Array, forces: Array, rests: bool) -> Array:
        """The limits, raised to what rounding leaves where an iteration no longer helps.

        Not where that is no small part of the forces, unless the unknowns have come to rest or are
        so small that rounding is that of an undeformed body, on which nothing may act: the
        iterates of a method that diverges become so large that rounding hides all forces.

        Args:
            limits: The limits.
            least: The least norms of the run so far.
            forces: What acted, or was not balanced, earlier in the solve.
            rests: Whether the last step was small.
        """
        stalled = self.residuals > STALLED * least
        hidden = self.rounding > NOTICED * np.maximum(self.sizes, forces)
        small = self.undeformed | ~hidden | (~self.flown & rests)
        return np.where(stalled & small, np.maximum(limits, self.rounding), limits)


class Convergence:
    """Measures the residual of a system where it was evaluated last.

    Each body's forces are measured against that body's own contact forces and reactions, so that
    no unit of length, force or stiffness matters, nor a stiffer body beside it.

    Args:
        system: The system, with matrices.
    """

    def __init__(self, system: ContactSystem) -> None:
        self._system = system
        #: Size of the largest cell of each body on this rank.
        self._cells: list[float] = []
        for body in system.bodies:
            msh = body.V.mesh
            tdim = msh.topology.dim
            cells = np.arange(msh.topology.index_map(tdim).size_local, dtype=np.int32)
            self._cells.append(float(msh.h(tdim, cells).max(initial=0.0)))

    def measure(self, reactions: bool = True) -> Measures:
        """Norms at the last evaluation. Collective.

        Args:
            reactions: Whether to find those of linear bodies, too: F is assembled for that.
        """
        bodies = self._system.bodies
        rows, most, moved = [], [], []
        for i, body in enumerate(bodies):
            x = np.abs(self._system.part(self._system.evaluated, i))
            residual, acting = self._system.residuals[i], body.force.array_r.copy()
            bound, settled = self._rounding(i, x)
            known = reactions or not body.linear
            # Contact forces on held unknowns may be anything, without balance.
            acting[body.owned_constrained] = body.reactions() if known else 0.0
            own = body.diagonal * x
            own[body.owned_constrained] = 0.0
            cell = self._cells[i] / self._system.scales[i]
            displacement = x[body.groups[0]].max(initial=0.0)
            for k, group in enumerate(body.groups):
                moved.append(displacement / cell if displacement > 0 else 0.0)
                parts = residual, body.terms if k else acting, bound, settled, own
                rows.append([float(part[group] @ part[group]) for part in parts])
                most.append(x[body.groups[0]].max(initial=0.0) if k else 1.0)
        squares, largest = np.array(rows).T.copy(), np.array([most, moved])
        self._system.comm.Allreduce(MPI.IN_PLACE, squares, op=MPI.SUM)
        self._system.comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
        norms = np.sqrt(squares)
        eps = np.finfo(np.float64).eps
        forces = np.concatenate([np.arange(len(body.groups)) == 0 for body in bodies])
        sizes = norms[1] * largest[0] + np.where(forces, 0.0, norms[4])
        left = []
        for of_forces in norms[2:4]:
            bound = ROUNDING * eps * np.where(forces, of_forces, sizes)
            # Velocities that rounding of the forces leaves to a body at rest meet no constraint.
            share = np.divide(bound, sizes, out=np.ones(len(bound)), where=sizes > bound)[forces]
            of_body = np.cumsum(forces) - 1
            left.append(np.where(forces, bound, np.maximum(bound, share[of_body] * sizes)))
        nothing = np.where(forces, eps * sizes[forces].max(), 0.0)
        flags = largest[1] <= UNDEFORMED, largest[1] > FLOWN
        return Measures(norms[0], sizes, left[0], left[1], nothing, *flags)

    def _rounding(self, i: int, x: Array) -> tuple[Array, Array]:
        """Terms of body i's owned rows of which rounding takes its part: of any, of a settled set.

        Those of a linear form are K (x - x0); strains of others round beside 1, which counts as a
        displacement of a cell's size; gaps round beside coordinates, also where rounding opens
        what the tangent takes for closed.

        Args:
            i: The body.
            x: Magnitude of its owned unknowns.
        """
        body, scale = self._system.bodies[i], self._system.scales[i]
        place = np.abs(body.V.mesh.geometry.x).max(initial=0.0) / scale
        beside = body.reference if body.linear else self._cells[i] / scale
        both = np.maximum(self._system.made.tangent.diagonal(i), body.diagonal)
        settled = body.diagonal * beside + both * x
        return np.asarray(settled + (both - body.diagonal) * place), np.asarray(settled)
