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

#: A residual that an iteration leaves above this part has met rounding.
STALLED = 0.5


@dataclasses.dataclass(frozen=True)
class Measures:
    """Norms, one for each group of rows of each body.

    Attributes:
        residuals: Of the residual.
        sizes: Of what acts in these rows: contact forces and reactions; in those of a constraint,
            such as incompressibility, of the terms that cancel.
        rounding: Of what rounding may leave.
        nothing: Of a residual that is none beside the largest forces on any body.
    """

    residuals: Array
    sizes: Array
    rounding: Array
    nothing: Array

    def limits(self, relative: float, fall: float, first: Array) -> Array:
        """Norms with which a run of Newton's method may end, if rounding allows.

        Args:
            relative: Tolerance, in units of ``sizes``.
            fall: Part of its first norm that each residual has to fall to, at most 1; not below
                that part of what is allowed.
            first: The first norms of the run.
        """
        limits = relative * self.sizes
        if fall < 1:
            limits = np.maximum(np.minimum(limits, fall * first), fall * limits)
        return np.maximum(limits, self.nothing)

    def with_rounding(self, limits: Array, least: Array, forces: Array, rests: bool) -> Array:
        """The limits, raised to what rounding leaves where an iteration no longer helps.

        Not where that is no small part of the forces, unless the unknowns have come to rest: the
        iterates of a method that diverges become so large that rounding hides all forces.

        Args:
            limits: The limits.
            least: The least norms of the run so far.
            forces: What acted at the beginning of the run.
            rests: Whether the last step was small.
        """
        stalled = self.residuals > STALLED * least
        small = rests | (self.rounding <= NOTICED * np.maximum(self.sizes, forces))
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
        self._cells = []
        for body in system.bodies:
            msh = body.V.mesh
            tdim = msh.topology.dim
            cells = np.arange(msh.topology.index_map(tdim).size_local, dtype=np.int32)
            self._cells.append(msh.h(tdim, cells).max(initial=0.0))
        self._has_reactions = any(
            system.comm.allreduce(len(body.owned_constrained)) > 0 and body.linear
            for body in system.bodies
        )

    def measure(self, reactions: bool = True) -> Measures:
        """Norms at the last evaluation. Collective.

        Args:
            reactions: Whether to find those of linear bodies, too: F is assembled for that.
        """
        system = self._system
        squares: list[list[float]] = []
        largest: list[float] = []
        for i, (body, scale) in enumerate(zip(system.bodies, system.scales, strict=True)):
            x, residual = np.abs(system.part(system.evaluated, i)), system.residuals[i]
            acting = body.force.array_r.copy()
            touched = acting != 0
            if reactions or not body.linear:
                acting[body.owned_constrained] = body.reactions()
            place = np.abs(body.V.mesh.geometry.x).max(initial=0.0) / scale
            near = 0.0 if body.linear else self._cells[i] / scale
            both = np.maximum(system.made.tangent.diagonal(i), body.diagonal)
            left = body.diagonal * (x + near + body.reference) + touched * (both - body.diagonal) * (x + place)
            for k, rows in enumerate(body.groups):
                parts = residual, body.terms if k else acting, left
                squares.append([float(part[rows] @ part[rows]) for part in parts])
                largest.append(x[body.groups[0]].max(initial=0.0) if k else 1.0)
        norms = np.sqrt(system.comm.allreduce(np.array(squares), op=MPI.SUM))
        by = system.comm.allreduce(np.array(largest), op=MPI.MAX)
        sizes = norms[:, 1] * by
        constraints = np.array([k > 0 for body in system.bodies for k in range(len(body.groups))])
        eps = np.finfo(np.float64).eps
        left = ROUNDING * eps * np.where(constraints, sizes, norms[:, 2])
        # Bodies on which nothing acts have rounding errors of the others in one linear system.
        largest_force = eps * sizes[~constraints].max()
        return Measures(norms[:, 0], sizes, left, np.where(constraints, 0.0, largest_force))
