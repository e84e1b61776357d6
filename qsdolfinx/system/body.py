"""One body: its UFL form as residual and diagonal block, with Dirichlet conditions."""

from __future__ import annotations

import hashlib
import typing

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import cpp, fem, la
from dolfinx.fem import petsc as fem_petsc
from ufl.algorithms import expand_derivatives

from qsdolfinx.base.messages import ContactWarning, warn
from qsdolfinx.base.rounding import SOLVED
from qsdolfinx.base.timing import Stopwatch
from qsdolfinx.surface.geometry import Cartesian
from qsdolfinx.system.bare_rows import check_rows, is_everywhere, unrolled
from qsdolfinx.system.compiling import Compiling
from qsdolfinx.system.estimated_degree import waste
from qsdolfinx.system.rows import groups
from qsdolfinx.system.symmetry import halved, is_halved

Array = npt.NDArray[np.float64]


def contains(V: fem.FunctionSpace, part: typing.Any) -> bool:
    """Whether a function space, DOLFINx's wrapper or C++ object, is V or one of its sub-spaces."""
    part = getattr(part, "_cpp_object", part)
    return bool(part == V._cpp_object or V._cpp_object.contains(part))


def body_of(u: typing.Sequence[fem.Function], V: fem.FunctionSpace | None) -> int | None:
    """Index of the body whose space is V or has the sub-space V; None if V is None (rigid tool).

    Raises:
        ValueError: If there is no such body.
    """
    if V is None:
        return None
    for i, function in enumerate(u):
        if contains(function.function_space, V):
            return i
    raise ValueError("V: must be the space of a body, or a sub-space of it")


class Body:
    """Bulk form F(u; v) = 0 of one body.

    Residuals are those of Newton's method with Dirichlet conditions eliminated: r = k (x − g) in
    the rows of constrained unknowns, where k is ``condition_stiffness``, so that all rows are
    forces. Other rows have the residual as it will be after the Newton step has set x = g in the
    constrained unknowns. A form that is linear in u is evaluated as r(x) = r(x₀) + K (x − x₀), with
    K assembled once.

    Args:
        F: Residual, a linear form in the test function.
        u: Unknown of the form.
        bcs: Dirichlet conditions on u.
        J: Derivative of F; by default it is computed by UFL. Not used if F is linear in u.
        compiling: How its forms are compiled.
    """

    def __init__(
        self,
        F: ufl.Form,
        u: fem.Function,
        bcs: typing.Sequence[fem.DirichletBC],
        J: ufl.Form | None = None,
        compiling: Compiling = Compiling(),
    ) -> None:
        self.u = u
        #: How its forms are compiled.
        self.compiling = compiling
        self.bcs = list(bcs)
        self.V = u.function_space
        #: Residual form F.
        self.form = F
        derivative = expand_derivatives(ufl.derivative(F, u))
        #: Whether F is linear in u, so that K is constant.
        self.linear = u not in derivative.coefficients()
        tangent = derivative if self.linear or J is None else J
        self._tangent_ufl = tangent
        self._residual_form = compiling.form(F)
        self._tangent_form = compiling.form(tangent)
        self._K: PETSc.Mat | None = None
        #: Owned unknowns of cells that F is not integrated over: without an entry in K.
        self.bare: npt.NDArray[np.int32] = np.zeros(0, dtype=np.int32)
        #: Place in the list of bodies.
        self.number = 0
        #: PETSc's type of the bulk block; "baij" takes less memory.
        self.matrix_type: str = PETSc.Mat.Type.AIJ
        #: Whether K of a linear form is stored in PETSc's symmetric format, if it is symmetric:
        #: half of the memory, and less time for products.
        self.may_halve = False
        #: Digest of everything that K depends on; empty if F is not linear.
        self.fingerprint = b""
        #: Meaning of its coordinates, set by its contact surfaces.
        self.geometry = Cartesian()
        #: Wall time of this rank in assembly.
        self.watch = Stopwatch()
        #: Number of times that K was assembled.
        self.num_assemblies = 0
        # Whether an exception has interrupted the assembly of a matrix, which cannot be used any
        # more.
        self._is_broken = False
        # Digest of the data from which :meth:`matrix` was last assembled.
        self._assembled = b""
        #: Entry of K in the rows of Dirichlet conditions (force per length); 0 until it is known.
        self.condition_stiffness = 0.0
        #: Magnitude of the diagonal of K, owned rows, when it was last measured.
        self.diagonal: Array = np.zeros(0)

        index_map, bs = self.V.dofmap.index_map, self.V.dofmap.index_map_bs
        self.num_owned: int = index_map.size_local * bs
        self._b = la.vector(index_map, bs, dtype=np.float64)
        self._g = la.vector(index_map, bs, dtype=np.float64)
        constrained = [bc.dof_indices()[0] for bc in self.bcs]
        #: Local unknowns with Dirichlet conditions, ghosts included.
        self.constrained = np.unique(np.concatenate([np.zeros(0, dtype=np.int32), *constrained]))
        self.owned_constrained = self.constrained[self.constrained < self.num_owned]
        #: Owned unknowns without Dirichlet conditions.
        self.free = np.setdiff1d(np.arange(self.num_owned), self.owned_constrained)
        #: Groups of owned rows with the same unit; those of the first group are forces.
        self.groups = groups(self.V)
        #: Largest entry of each owned row of K, if there is more than one group.
        self.terms: Array = np.zeros(0)
        #: Unknowns as used by contact, with Dirichlet values set.
        self.x: PETSc.Vec = self.create_vec()
        #: Work vector of contact forces.
        self.force: PETSc.Vec = self.create_vec()
        self._step: PETSc.Vec = self.create_vec()
        self._r: PETSc.Vec = self.create_vec()
        self._x0: Array = np.zeros(self.num_owned)
        self._r0: Array = np.zeros(self.num_owned)
        self._reactions: Array = np.zeros(len(self.owned_constrained))

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator of the mesh."""
        return self.V.mesh.comm

    @property
    def tangent_form(self) -> ufl.Form:
        """Derivative of F, with derivatives expanded unless the user gave it."""
        return self._tangent_ufl

    def create_vec(self) -> PETSc.Vec:
        """New zero vector of the owned unknowns. Collective."""
        index_map, bs = self.V.dofmap.index_map, self.V.dofmap.index_map_bs
        return PETSc.Vec().createMPI((self.num_owned, index_map.size_global * bs), comm=self.comm)

    def constrained_marker(self) -> PETSc.Vec:
        """New vector with ones at unknowns with Dirichlet conditions. Collective."""
        marker = self.create_vec()
        marker.array[self.owned_constrained] = 1
        return marker

    def set_unknowns(self, values: Array) -> None:
        """Write owned values to u and update its ghosts. Collective."""
        self.u.x.array[: self.num_owned] = values
        self.u.x.scatter_forward()

    def begin_solve(self, part: float = 1.0, start: Array | None = None) -> None:
        """Read new Dirichlet values, loads, material and geometry. Collective.

        Args:
            part: Part of the change of Dirichlet values from the start that is applied.
            start: Unknowns at the start, ghosts included.
        """
        self.u.x.scatter_forward()  # a user may have set owned values only
        for bc in self.bcs:
            bc.set(self._g.array)
        if start is not None:
            at = self.constrained
            self._g.array[at] = (1 - part) * start[at] + part * self._g.array[at]
        self._forget_broken()
        if not self.linear:
            return
        fingerprint = self._state_of_K()
        if self.comm.allreduce(fingerprint != self.fingerprint, op=MPI.LOR):
            self._renew_linear()
            self.fingerprint = fingerprint
        kept = self.u.x.array.copy()
        self.u.x.array[self.constrained] = self._g.array[self.constrained]
        self._x0 = self.u.x.array[: self.num_owned].copy()
        self._r0 = self._assemble_vector()
        self._r0[self.owned_constrained] = 0
        self.u.x.array[:] = kept

    def with_conditions(self, x: Array) -> Array:
        """Copy of the owned unknowns x with their Dirichlet values set."""
        out = x.copy()
        out[self.owned_constrained] = self._g.array[self.owned_constrained]
        return out

    def residual(self, x: Array) -> Array:
        """Residual at the owned unknowns x; sets u = x and ``self.x``. Collective."""
        self.set_unknowns(x)
        owned = self.owned_constrained
        self.x.array[:] = self.with_conditions(x)
        if self.linear:
            assert self._K is not None
            self._step.array[:] = x - self._x0
            self._K.mult(self._step, self._r)
            return np.asarray(self._r.array_r + self._r0)
        r = self._assemble_with_conditions()
        self._reactions = r[owned]
        r[owned] = self.condition_stiffness * (x[owned] - self._g.array[owned])
        return r

    def forces_at(self, x: Array) -> Array:
        """F at the owned unknowns x, in all owned rows; u is as before. Collective."""
        before = self.u.x.array.copy()
        self.set_unknowns(x)
        found = self._assemble_vector()
        self.u.x.array[:] = before
        return found

    @property
    def reference(self) -> Array:
        """Magnitude of the unknowns x₀ at which a linear form is expanded."""
        return np.abs(self._x0)

    def reactions(self) -> Array:
        """F in owned rows with Dirichlet conditions, at the last call of residual(). Collective."""
        if self.linear:  # K does not contain these rows
            self._reactions = self._assemble_vector()[self.owned_constrained]
        return self._reactions

    def add_tangent(self, block: PETSc.Mat) -> None:
        """Add the bulk part to the zeroed diagonal block, at the u of the last residual()."""
        if self.linear:
            block.axpy(1.0, self._K, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        else:
            self._assemble_matrix(block)

    def matrix(self) -> PETSc.Mat:
        """The bulk block alone, for the present u; do not modify. Collective."""
        self._forget_broken()
        if self._K is None:
            self._K, self._assembled = self._new_matrix(), b""
        if self.linear:
            return self._K
        state = self._state_of_K()
        if self.comm.allreduce(state != self._assembled, op=MPI.LOR):
            if self.condition_stiffness == 0:
                self._measure(self._K)
            else:
                self._assemble_matrix(self._K)
            self._assembled = state
        return self._K

    def _new_matrix(self) -> PETSc.Mat:
        """Matrix with the pattern of K, and a diagonal where K has no row. Collective."""
        if is_everywhere(self._tangent_ufl):
            return fem_petsc.create_matrix(self._tangent_form, self.matrix_type)
        pattern = fem.create_sparsity_pattern(self._tangent_form)
        pattern.finalize()
        num_owned = self.V.dofmap.index_map.size_local
        counts = np.diff(np.asarray(pattern.graph[1], dtype=np.int64)[: num_owned + 1])
        empty = np.flatnonzero(counts == 0).astype(np.int32)
        self.bare = unrolled(empty, self.V.dofmap.index_map_bs)
        pattern = fem.create_sparsity_pattern(self._tangent_form)
        pattern.insert_diagonal(empty)
        pattern.finalize()
        return cpp.la.petsc.create_matrix(self.comm, pattern, self.matrix_type)

    def free_matrix(self) -> None:
        """Free the result of :meth:`matrix`, unless it is still needed. Collective."""
        if not self.linear and self._K is not None:
            self._K.destroy()
            self._K = None

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""
        for thing in (self._K, self.x, self.force, self._step, self._r):
            if thing is not None:
                thing.destroy()

    def at_points(self) -> list[fem.Function]:
        """Functions on quadrature elements on which the form depends, such as a plastic strain."""
        found = [c for c in self.form.coefficients() if isinstance(c, fem.Function)]
        return [f for f in found if getattr(f.ufl_element(), "is_quadrature", False)]

    def _measure(self, matrix: PETSc.Mat) -> None:
        """Assemble K, and measure its stiffness. Collective.

        The rows of Dirichlet conditions get a power of two near the mean of the diagonal, so that
        they scale like all other rows when units change.
        """
        self._assemble_matrix(matrix)
        check_rows(self.number, self.V, self.free, self.bare, matrix if self.linear else None)
        diagonal = matrix.getDiagonal()
        self.diagonal = np.abs(diagonal.array_r)
        some = self.diagonal[self.free]
        some = some[some > 0]
        total, number = self.comm.allreduce(np.array([some.sum(), len(some)]), op=MPI.SUM)
        mean = total / number if number and np.isfinite(total) else 1.0
        self.condition_stiffness = float(2.0 ** np.round(np.log2(mean)))
        self.diagonal[self.owned_constrained] = self.condition_stiffness
        diagonal.array[self.owned_constrained] = self.condition_stiffness
        matrix.setDiagonal(diagonal)
        diagonal.destroy()
        if len(self.groups) > 1:
            starts, _, values = matrix.getValuesCSR()
            self.terms = np.maximum.reduceat(np.append(np.abs(values), 0.0), starts[:-1])

    def _renew_linear(self) -> None:
        """Assemble K of a linear form. Collective.

        It is stored in the symmetric format once; if it changes, it will change again, and its
        entries stay where they can be assembled.
        """
        is_first = self._K is None
        if self._K is not None and is_halved(self._K):
            self._K.destroy()
            self._K = None
        if self._K is None:
            self._K = self._new_matrix()
        self._measure(self._K)
        if is_first and self.may_halve:
            self._K = halved(self._K)

    def _assemble_matrix(self, matrix: PETSc.Mat) -> None:
        form, stiffness = self._tangent_form, self.condition_stiffness or 1.0
        self._is_broken = True
        with self.watch.stage("bulk assembly"):
            matrix.zeroEntries()
            # mypy sees another one of the functions to which this name dispatches.
            fem_petsc.assemble_matrix(matrix, form, self.bcs, stiffness)  # type: ignore[arg-type]
            matrix.assemble()
        self._is_broken = False
        self.num_assemblies += 1
        if self.num_assemblies == 1:
            self._check_degree()

    def _check_degree(self) -> None:
        """Warn if most of the time of the first assembly was wasted. Collective."""
        found = waste(self._tangent_ufl, self.V)
        if found is not None:
            seconds = self.comm.allreduce(self.watch.seconds["bulk assembly"], op=MPI.MAX)
            warn(found.text(self.number, seconds), ContactWarning)

    def _forget_broken(self) -> None:
        """Drop a matrix whose assembly was interrupted, since PETSc would not accept it."""
        if self._is_broken:
            self._is_broken, self._K, self.fingerprint = False, None, b""
            self._assembled = b""

    def _assemble_with_conditions(self) -> Array:
        """Assemble F as it will be when the constrained unknowns have their values. Collective.

        If they deviate only by the error of a linear solver, F is assembled at these values, since
        lifting costs an assembly of the tangent.
        """
        x, u, g = self.u.x.array, self.u.x.array[self.constrained], self._g.array[self.constrained]
        off = np.abs(u - g).max(initial=0.0)
        if off == 0 or off > SOLVED * np.abs(x).max():
            return self._assemble_vector(lift=bool(off > 0))
        x[self.constrained] = g
        out = self._assemble_vector()
        x[self.constrained] = u
        return out

    def _assemble_vector(self, lift: bool = False) -> Array:
        """Assemble F at u on owned unknowns; with lift, as if constrained ones had their values."""
        with self.watch.stage("bulk assembly"):
            self._b.array[:] = 0
            fem.assemble_vector(self._b.array, self._residual_form)
            if lift:
                form, x = self._tangent_form, self.u.x.array
                fem.apply_lifting(self._b.array, [form], [self.bcs], x0=[x], alpha=-1.0)
            self._b.scatter_reverse(la.InsertMode.add)
        return np.array(self._b.array[: self.num_owned])

    def _state_of_K(self) -> bytes:
        """Digest of everything that K depends on."""
        digest = hashlib.blake2b(np.ascontiguousarray(self.V.mesh.geometry.x))
        for constant in self._tangent_ufl.constants():
            digest.update(np.ascontiguousarray(constant.value))
        for coefficient in self._tangent_ufl.coefficients():
            digest.update(np.ascontiguousarray(coefficient.x.array))
        return digest.digest()
