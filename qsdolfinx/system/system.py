"""Bodies and contacts as one system of equations: its residual and its tangent."""

from __future__ import annotations

import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.timing import Span, Stopwatch, spans
from qsdolfinx.contact.contact import Contact
from qsdolfinx.contact.penalty import automatic_penalty, nodal_stiffness
from qsdolfinx.contact.penalty import source as penalty_source
from qsdolfinx.solve.arguments import body_of
from qsdolfinx.surface.surface import Surface
from qsdolfinx.system.additive import Additive
from qsdolfinx.system.blocks import Blocks, Side, is_symmetric
from qsdolfinx.system.body import Body
from qsdolfinx.system.free_motion import Hold, Tangent
from qsdolfinx.system.monolithic import Monolithic
from qsdolfinx.system.rigid_modes import RigidMotion, orthonormal, rigid_modes, set_near_nullspace
from qsdolfinx.tools.rigid_surface import RigidSurface

Array = npt.NDArray[np.float64]


class ContactSystem:
    """Residual and tangent of all bodies and contacts together.

    The unknowns of a rank are those of its part of body 0, then of body 1, and so on.

    Args:
        bodies: The bodies.
        contacts: Contacts between them.
        kind: ``"mpi"`` or ``"nest"``, the matrix type that the linear solver sees.
    """

    def __init__(
        self, bodies: typing.Sequence[Body], contacts: typing.Sequence[Contact], kind: str
    ) -> None:
        self.bodies = list(bodies)
        self.u = [body.u for body in bodies]
        self.contacts = list(contacts)
        #: Bodies of the slave and the master of each contact; None for a rigid tool.
        self.sides: list[Side] = [
            (body_of(self.u, c.slave.V, "slave"), self._master_body(c)) for c in contacts
        ]
        for contact, sides in zip(contacts, self.sides, strict=True):
            for i in sides:
                if i is not None:
                    self.bodies[i].axisymmetric = contact.slave.axisymmetric
        self._kind = kind
        #: Whether the linear solver needs no more of an AIJ matrix than its product.
        self._sums = False
        for body in self.bodies:
            if kind == "mpi" and body.V.dofmap.index_map_bs > 1:
                body.matrix_type = PETSc.Mat.Type.BAIJ
        #: Wall time that this rank has spent in conversion and in the solver.
        self.watch = Stopwatch()
        self._offsets = np.cumsum([0, *(body.num_owned for body in self.bodies)])
        self._rigid: RigidMotion | None = None
        self._hold: Hold | None = None
        self.blocks: Blocks | None = None
        self._tangent: Tangent | None = None
        self._matrix: PETSc.Mat | None = None
        self._paired: list[int] = []
        self._assembled: list[object] | None = None
        self._evaluated: Array = np.zeros(0)
        self._moduli: list[float] = []
        self._bulk_symmetric = True
        self._x = PETSc.Vec().createMPI((self._offsets[-1], PETSc.DETERMINE), comm=self.comm)
        self._r = self._x.duplicate()

    def _master_body(self, contact: Contact) -> int | None:
        """Index of the master's body, None of a rigid tool."""
        if isinstance(contact.master, RigidSurface):
            return None
        return body_of(self.u, contact.master.V, "master")

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator of the bodies."""
        return self.bodies[0].comm

    @property
    def unknowns(self) -> list[str]:
        """``"displacement"`` or ``"velocity"``, for each body, as its contacts say."""
        unknowns = ["displacement"] * len(self.bodies)
        for contact, sides in zip(self.contacts, self.sides, strict=True):
            for i, unknown in zip(sides, contact.unknown, strict=True):
                if i is not None:
                    unknowns[i] = unknown
        return unknowns

    @property
    def _scales(self) -> list[float]:
        """Displacement per unknown of each body."""
        scales = [1.0] * len(self.bodies)
        for contact, sides in zip(self.contacts, self.sides, strict=True):
            for i, scale in zip(sides, contact.scale, strict=True):
                if i is not None:
                    scales[i] = scale
        return scales

    @property
    def timings(self) -> dict[str, Span]:
        """Wall time (s) since the problem was made, of the contacts since they were. Collective.

        Returns:
            The most and the least that any rank has spent in each stage: ``"pairing"``, ``"gap"``,
            ``"insertion"`` of contact blocks, ``"bulk assembly"``, ``"conversion"`` of the MatNest,
            and ``"solve"``, which is what is left of the nonlinear solver: the linear one. The
            stages of PETSc's ``-log_view`` are the same.
        """
        watches = [*(b.watch for b in self.bodies), *(c.watch for c in self.contacts), self.watch]
        return spans(self.comm, watches)

    # --- Matrices

    def _rebuild(self) -> None:
        """Penalties, patterns and matrices after the contacts have paired. Collective."""
        self._destroy_matrices()
        matrices = [body.matrix() for body in self.bodies]
        markers = [body.constrained_marker() for body in self.bodies]
        self._bulk_symmetric = all([is_symmetric(matrix) for matrix in matrices])
        self._moduli = []
        for contact, (s, m) in zip(self.contacts, self.sides, strict=True):
            contact.constrain(markers[s], None if m is None else markers[m])
            deformable = [(contact.slave, s)]
            if isinstance(contact.master, Surface) and m is not None:
                deformable.append((contact.master, m))
            stiffness, modulus = zip(
                *(
                    nodal_stiffness(surface, matrices[i], markers[i], self._scales[i])
                    for surface, i in deformable
                ),
                strict=True,
            )
            contact.stiffness = stiffness
            if contact.needs_penalty:
                together = self._sums and contact.law.linear
                known = stiffness, modulus, contact.quadrature, contact.augmented, together
                contact.set_automatic_penalty(automatic_penalty(*known), penalty_source(*known))
            self._moduli.append(1 / sum(1 / E for E in modulus) if min(modulus) < np.inf else 0.0)
        nest = self._kind == "nest"
        self.blocks = Blocks(self.bodies, self.contacts, self.sides, matrices, bulk=nest)
        if nest:
            self._tangent, self._matrix = self.blocks, self.blocks.nest
            for body in self.bodies:
                body.free_matrix()
        else:
            form = Additive if self._sums else Monolithic
            self._tangent = form(self.bodies, self.blocks, matrices, self.watch)
            self._matrix = self._tangent.matrix
        self._rigid = RigidMotion(self.bodies)
        self._hold = Hold(self._rigid, self.bodies, self.contacts, self.sides)
        self._set_near_nullspaces()
        for marker in markers:
            marker.destroy()
        self._paired = [c.version for c in self.contacts]
        self._assembled = None

    def _destroy_matrices(self) -> None:
        """Free the matrices; in parallel petsc4py would keep them. Collective."""
        if isinstance(self._tangent, Monolithic | Additive):
            self._tangent.destroy()
        if self.blocks is not None:
            self.blocks.destroy()
        if self._rigid is not None:
            self._rigid.destroy()
        self.blocks = self._tangent = self._matrix = self._rigid = None

    # --- Evaluation

    def _part(self, array: Array, i: int) -> Array:
        """The part of an array of owned unknowns that is body i's."""
        return array[self._offsets[i] : self._offsets[i + 1]]

    def _evaluate(self, x: Array) -> Array:
        """Residual at the owned unknowns x; leaves u, gaps and multipliers at x. Collective."""
        self._evaluated = x.copy()
        residuals = [body.residual(self._part(x, i)) for i, body in enumerate(self.bodies)]
        self._bulk_residuals = [residual.copy() for residual in residuals]
        forces = [body.force for body in self.bodies]
        for force in forces:
            force.zeroEntries()
        for contact, (s, m) in zip(self.contacts, self.sides, strict=True):
            contact.evaluate(self.bodies[s].x, None if m is None else self.bodies[m].x)
            contact.add_residual(forces[s], None if m is None else forces[m])
        for body, residual, force in zip(self.bodies, residuals, forces, strict=True):
            residual[body.free] += force.array_r[body.free]
        return np.concatenate(residuals)

    def _assemble(self) -> bool:
        """Tangent at the last evaluation, unless it is there already. Collective.

        For linear bodies it depends on the active set alone: while that stays, the linear solver
        keeps its factors.

        Returns:
            Whether it has changed.
        """
        assert self._tangent is not None and self._hold is not None and self._matrix is not None
        constant = all(body.linear for body in self.bodies)
        state: list[object] = [body.fingerprint for body in self.bodies]
        for contact in self.contacts:
            state += [contact.eps, contact.scale, contact.tangent_state()]
        if constant and self.comm.allreduce(self._assembled == state, op=MPI.LAND):
            return False
        self._tangent.assemble()
        self._hold.add_to(self._tangent)
        self._matrix.setOption(PETSc.Mat.Option.SYMMETRIC, self.symmetric)
        self._assembled = state
        return True

    def _assemble_bulk(self) -> None:
        """The tangent without contact. Collective."""
        assert isinstance(self._tangent, Additive) and self._hold is not None
        self._tangent.assemble(contact=False)
        self._hold.add_to(self._tangent, contact=False)
        self._assembled = None

    def _rounding(self) -> float:
        """Norm of the residual that rounding leaves at the last evaluation. Collective.

        The products K_ij x_j that sum up to nothing are of the size of K_ii x_i. Where one body is
        10^8 times as stiff as the other this is more than a small part of the loads.
        """
        assert self._tangent is not None
        products = [
            (self._tangent.diagonal(i) * self._part(self._evaluated, i))[body.free]
            for i, body in enumerate(self.bodies)
        ]
        square = self.comm.allreduce(float(sum(p @ p for p in products)), op=MPI.SUM)
        return float(np.finfo(np.float64).eps * np.sqrt(square))

    @property
    def symmetric(self) -> bool:
        """Whether the tangent is symmetric, as its matrix is told."""
        return self._bulk_symmetric and all(contact.symmetric for contact in self.contacts)

    def _set_near_nullspaces(self) -> None:
        """Rigid modes of each body on its block, and of all together on the AIJ matrix."""
        assert self.blocks is not None and self._rigid is not None and self._matrix is not None
        for i, modes in enumerate(self._rigid.modes):
            block = self.blocks.block(i, i)
            if modes and block is not None:
                set_near_nullspace(block, modes)
        if self._kind == "nest" or self._sums or not all(self._rigid.modes):
            return
        gdim = self.bodies[0].V.mesh.geometry.dim
        if all(body.V.dofmap.index_map_bs == gdim for body in self.bodies):
            self._matrix.setBlockSize(gdim)  # multigrid's
        vecs = []
        for parts in zip(*map(rigid_modes, self.bodies), strict=True):
            vecs.append(self._x.duplicate())
            vecs[-1].array[:] = np.concatenate(parts)
        set_near_nullspace(self._matrix, orthonormal(vecs))
        for vec in vecs:
            vec.destroy()
