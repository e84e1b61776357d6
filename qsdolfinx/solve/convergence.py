"""Convergence criteria of Newton's method: residual of each body relative to the forces on it."""

from __future__ import annotations

import dataclasses

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.rounding import SOLVED
from qsdolfinx.system.system import ContactSystem

Array = npt.NDArray[np.float64]

#: Norm of the residual due to rounding errors, over the norm of eps K_ii x_i, and rounding errors
#: of forces and gaps in units in the last place of the largest coordinate. With less, solves near
#: rounding level do not end; with much more, they end early.
ROUNDING = 50.0

#: Last step over the unknowns, both in the 2-norm, below which the unknowns no longer change. With
#: much more, solves that diverge would end as if rounding hid their forces.
RESTING = 1e-4

#: Displacement over the size of a cell, of a body that counts as undeformed. With much more,
#: rounding would end solves of deformed bodies.
UNDEFORMED = 1e-4

#: The same ratio, above which a body counts as very far away: a step that is small relative to such
#: a displacement does not mean that the body is at rest.
FLOWN = 1e6


@dataclasses.dataclass(frozen=True)
class Measures:
    """Norms for the convergence test, one for each group of rows of each body.

    Attributes:
        residuals: Norms of the residual.
        sizes: Norms of the contact forces and reactions in these rows. In the rows of a constraint,
            such as incompressibility, norms of the terms that cancel: the terms of the displacement
            and, for a body at rest, the terms of the constraint's own unknown.
        rounding: Bounds of the rounding errors, including rounding of gaps relative to coordinates.
            They matter where an iteration no longer reduces the residual.
        settled: The same bounds while the active set is unchanged: gaps then change with the
            displacements.
        nothing: Norms of a residual that is negligible relative to the largest forces on any body.
        undeformed: Whether the body's displacements are small relative to its cell size.
        flown: Whether the displacements are far larger than the cell size.
    """

    residuals: Array
    sizes: Array
    rounding: Array
    settled: Array
    nothing: Array
    undeformed: npt.NDArray[np.bool_]
    flown: npt.NDArray[np.bool_]

    def limits(self, relative: float) -> Array:
        """Norms at which a run of Newton's method may end, if they are above rounding level.

        Args:
            relative: Tolerance, in units of ``sizes``.
        """
        return np.maximum(relative * self.sizes, self.nothing)

    def with_rounding(self, limits: Array, least: Array, forces: Array, rests: bool) -> Array:
        """Raise the limits to rounding level where an iteration no longer reduces the residual.

        The limits are not raised if the rounding level is a large part of the forces: the iterates
        of a diverging method become so large that rounding hides all forces. There are two
        exceptions: the unknowns no longer change, or they are so small that rounding is that of an
        undeformed body, on which possibly no forces act.

        Args:
            limits: The limits.
            least: Smallest norms of the run so far.
            forces: Forces that acted, or were not balanced, earlier in the solve.
            rests: Whether the last step was small.
        """
        stalled = self.residuals > 0.5 * least  # not halved: it has reached rounding level
        hidden = self.rounding > SOLVED * np.maximum(self.sizes, forces)
        small = self.undeformed | ~hidden | (~self.flown & rests)
        return np.where(stalled & small, np.maximum(limits, self.rounding), limits)


class Convergence:
    """Measure the residual of a system at its last evaluation.

    Each body's forces are measured against that body's own contact forces and reactions, so the
    units of length, force and stiffness do not matter, nor does a stiffer body next to it.

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
            reactions: Whether to compute the reactions of linear bodies, too; this assembles F.
        """
        bodies = self._system.bodies
        rows, most, moved = [], [], []
        for i, body in enumerate(bodies):
            x = np.abs(self._system.part(self._system.evaluated, i))
            residual, acting = self._system.residuals[i], body.force.array_r.copy()
            bound, settled = self._rounding(i, x)
            known = reactions or not body.linear
            # Contact forces on constrained unknowns are arbitrary, since reactions balance them.
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
            # Velocities of a body at rest that are due to rounding of the forces satisfy no
            # constraint.
            share = np.divide(bound, sizes, out=np.ones(len(bound)), where=sizes > bound)[forces]
            of_body = np.cumsum(forces) - 1
            left.append(np.where(forces, bound, np.maximum(bound, share[of_body] * sizes)))
        nothing = np.where(forces, eps * sizes[forces].max(), 0.0)
        flags = largest[1] <= UNDEFORMED, largest[1] > FLOWN
        return Measures(norms[0], sizes, left[0], left[1], nothing, *flags)

    def _rounding(self, i: int, x: Array) -> tuple[Array, Array]:
        """Terms that rounding errors of body i's owned rows scale with: any set, unchanged set.

        For a linear form these terms are K (x - x0). For other forms, strains have rounding errors
        relative to 1, which counts as a displacement of one cell size. Gaps have rounding errors
        relative to coordinates, also where rounding deactivates a constraint that is active in the
        tangent.

        Args:
            i: Index of the body.
            x: Magnitude of its owned unknowns.
        """
        body, scale = self._system.bodies[i], self._system.scales[i]
        place = np.abs(body.V.mesh.geometry.x).max(initial=0.0) / scale
        beside = body.reference if body.linear else self._cells[i] / scale
        both = np.maximum(self._system.made.tangent.diagonal(i), body.diagonal)
        settled = body.diagonal * beside + both * x
        return np.asarray(settled + (both - body.diagonal) * place), np.asarray(settled)
