"""Linear solver ``"schur"``: Schur complement for velocity–pressure bodies.

The velocities of all bodies, with contact, form one block A, together with the displacements of
bodies that have no pressure. The pressures of all bodies form the other block. The block A is
eliminated. Its Schur complement S = C - B A⁻¹ Bᵀ is replaced by a mass matrix of the pressures,
weighted by the inverse of the viscosity, which is spectrally equivalent on any mesh (Elman,
Silvester and Wathen, 2014).
"""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import ufl
from dolfinx import fem

from qsdolfinx.base.passing import passing
from qsdolfinx.compat import num_entity_dofs
from qsdolfinx.linear.hierarchy import Hierarchy
from qsdolfinx.linear.presets import PRESSURE
from qsdolfinx.linear.schur_pressure import PressureMass, layout
from qsdolfinx.linear.schur_velocity import VelocityBlock
from qsdolfinx.system.body import Body
from qsdolfinx.system.sum import Sum

Forms = typing.Sequence[ufl.Form | None] | None

Array = npt.NDArray[np.float64]


def has_schur(F: typing.Sequence[ufl.Form], u: typing.Sequence[fem.Function]) -> bool:
    """Whether ``"schur"`` can be used for these bodies."""
    try:
        has_pressure = any(pressure is not None for pressure in _pressures(u))
    except ValueError:
        return False
    return has_pressure and _across_cells(F, u) is None


def check_schur(
    F: typing.Sequence[ufl.Form],
    u: typing.Sequence[fem.Function],
    solver: str,
    kind: str,
    forms: Forms,
) -> None:
    """Check that ``"schur"`` can be used: bodies with pressure, suitable forms."""
    if solver not in ("schur", "auto") and forms is not None:
        raise ValueError(f'pressure_preconditioner: is for linear_solver="schur", not {solver!r}')
    if solver == "schur":
        if kind == "nest":
            raise ValueError('kind: linear_solver="schur" needs the AIJ matrix, kind="mpi"')
        if all(pressure is None for pressure in _pressures(u)):
            raise ValueError(
                'solver: "schur" needs a body in velocity and pressure, see materials.mini_space; '
                'for displacements there is "amg"'
            )
        i = _across_cells(F, u)
        if i is not None:
            raise ValueError(
                f'solver: "schur" eliminates unknowns inside cells, and F[{i}] has integrals over '
                'interior facets, which couple those of two cells: take "direct"'
            )
    if forms is not None:
        _check_forms(u, forms)


def num_inside_cells(V: fem.FunctionSpace) -> int:
    """Number of unknowns inside cells, over all ranks."""
    dim = V.mesh.topology.dim
    cells = int(V.mesh.topology.index_map(dim).size_global)
    return cells * num_entity_dofs(V, dim) * int(V.dofmap.dof_layout.block_size)


def _across_cells(F: typing.Sequence[ufl.Form], u: typing.Sequence[fem.Function]) -> int | None:
    """The first body with unknowns inside cells and integrals over interior facets."""
    for i, (form, function) in enumerate(zip(F, u, strict=True)):
        kinds = {integral.integral_type() for integral in form.integrals()}
        if any(k.startswith("interior") for k in kinds) and num_inside_cells(
            function.function_space
        ):
            return i
    return None


def _pressures(u: typing.Sequence[fem.Function]) -> list[typing.Any]:
    """For each body the sub-space of the pressure, None for displacements."""
    return [layout(function.function_space)[1] for function in u]


def _check_forms(u: typing.Sequence[fem.Function], forms: typing.Any) -> None:
    if not isinstance(forms, typing.Sequence) or len(forms) != len(u):
        raise ValueError(f"pressure_preconditioner: must have an entry for each of {len(u)} bodies")
    for i, (form, pressure, function) in enumerate(zip(forms, _pressures(u), u, strict=True)):
        if form is None:
            continue
        if not isinstance(form, ufl.Form):
            raise TypeError(f"pressure_preconditioner: entry {i} must be a UFL form or None")
        spaces = [argument.ufl_function_space() for argument in form.arguments()]
        if pressure is None or spaces != [function.function_space] * 2:
            raise ValueError(
                f"pressure_preconditioner: entry {i} must be bilinear on the space of u[{i}], "
                "and that must have a pressure"
            )


class Schur:
    """PETSc preconditioner (PCPYTHON) for a tangent: solve for pressures by S, velocities by A.

    Args:
        ksp: The linear solver.
        bodies: The bodies.
        forms: For each body a form instead of the automatic pressure mass matrix, or None.
    """

    def __init__(self, ksp: PETSc.KSP, bodies: typing.Sequence[Body], forms: Forms = None) -> None:
        self._ksp, self._bodies = ksp, bodies
        self._comm = bodies[0].comm
        prefix = ksp.getOptionsPrefix() or ""
        #: Pressure of each body; None for displacements.
        self.pressures = [
            None
            if layout(body.V)[1] is None
            else Pressure(body, None if forms is None else forms[i], prefix)
            for i, body in enumerate(bodies)
        ]
        self._hierarchy = Hierarchy(bodies)
        self._velocity: VelocityBlock | None = None
        self._tangent: Sum | None = None

    def set_up(self, pc: PETSc.PC, tangent: Sum, scales: typing.Sequence[float]) -> None:
        """Set up for a new tangent. Collective.

        Args:
            pc: The preconditioner, of type "python".
            tangent: The tangent, not yet assembled.
            scales: Displacement per unknown of each body.
        """
        self.forget()
        self._tangent = tangent
        none = np.zeros(0, np.int64)
        dofs = [none if one is None else one.mass.dofs for one in self.pressures]
        prefix = self._ksp.getOptionsPrefix() or ""
        self._velocity = VelocityBlock(self._bodies, tangent, dofs, scales, self._hierarchy, prefix)
        pc.setPythonContext(self)

    def update(self) -> None:
        """Update for the tangent assembled for the present unknowns. Collective."""
        assert self._tangent is not None and self._velocity is not None
        of_bodies = zip(self.pressures, self._tangent.bodies, self._tangent.parts, strict=True)
        for pressure, (K, _), part in of_bodies:
            if pressure is None:
                continue
            pressure.mass.assemble()
            if not pressure.mass.has_sign:
                self._find_sign(pressure.mass, part.start)
            pressure.follow(K)
        self._velocity.update()

    @passing()
    def apply(self, pc: PETSc.PC, r: PETSc.Vec, x: PETSc.Vec) -> None:
        """Apply the preconditioner, as a callback of PETSc. Collective."""
        assert self._tangent is not None and self._velocity is not None
        right, out = r.array_r.copy(), x.array
        for pressure, part in zip(self.pressures, self._tangent.parts, strict=True):
            if pressure is not None:
                pressure.apply(right[part], out[part])
        self._velocity.apply(right, out)

    def _find_sign(self, mass: PressureMass, start: int) -> None:
        """Give a user's form the sign of C - B diag(A)⁻¹ Bᵀ. Collective."""
        assert self._tangent is not None
        matrix, body = self._tangent.matrix, mass.body
        places = start + np.setdiff1d(mass.dofs, body.owned_constrained)
        one, image = matrix.createVecs()
        diagonal = matrix.getDiagonal()
        one.array[places] = 1.0
        matrix.mult(one, image)
        stiffness = image.array_r[places].sum()
        safe = np.where(diagonal.array_r == 0, np.inf, diagonal.array_r)
        one.array[:] = image.array_r / safe
        one.array[places] = 0.0
        matrix.mult(one, image)
        local = stiffness - image.array_r[places].sum()
        own = mass.matrix.getDiagonal()
        total = self._comm.allreduce(np.array([local, own.array_r.sum()]))
        mass.sign = -1.0 if total[0] * total[1] < 0 else 1.0
        mass.has_sign = True
        mass.matrix.scale(mass.sign)
        for vec in (one, image, diagonal, own):
            vec.destroy()

    def forget(self) -> None:
        """Free everything created for the tangent, which is about to be freed. Collective."""
        for pressure in self.pressures:
            if pressure is not None:
                pressure.forget()
        if self._velocity is not None:
            self._velocity.destroy()
        self._velocity = self._tangent = None

    def free(self) -> None:
        """Free PETSc's objects. Collective."""
        self.forget()
        self._hierarchy.destroy()
        for pressure in self.pressures:
            if pressure is not None:
                pressure.destroy()


class Pressure:
    """The pressures of one body: a mass matrix, and Bᵀ.

    Args:
        body: A body with velocity and pressure.
        form: Form instead of the automatic mass matrix, or None.
        prefix: Prefix of the options.
    """

    def __init__(self, body: Body, form: ufl.Form | None, prefix: str) -> None:
        self.mass = PressureMass(body, form)
        self._ksp = PETSc.KSP().create(body.comm)
        self._ksp.setOptionsPrefix(prefix + PRESSURE)
        self._ksp.setOperators(self.mass.matrix)
        self._ksp.setFromOptions()
        self._r, self._x = self.mass.matrix.createVecs()
        self._others = np.setdiff1d(np.arange(body.num_owned), self.mass.dofs)
        self._Bt: PETSc.Mat | None = None
        self._w: PETSc.Vec | None = None

    def follow(self, K: PETSc.Mat) -> None:
        """Take Bᵀ from the body's matrix. Collective."""
        first = K.getOwnershipRange()[0]
        sets = [
            PETSc.IS().createGeneral((first + dofs).astype(np.int32), comm=K.comm)
            for dofs in (self._others, self.mass.dofs)
        ]
        self._Bt = K.createSubMatrix(*sets, submat=self._Bt)
        for one in sets:
            one.destroy()
        if self._w is None:
            self._w = self._Bt.createVecLeft()
        self._ksp.setOperators(self.mass.matrix)

    def apply(self, r: Array, out: Array) -> None:
        """Write the pressures to ``out``, and subtract their forces from other rows. Collective.

        Args:
            r: Right-hand side, owned values of the body's unknowns.
            out: Owned values of the body's unknowns.
        """
        assert self._Bt is not None and self._w is not None
        self._r.array[:] = r[self.mass.dofs]
        self._ksp.solve(self._r, self._x)
        out[self.mass.dofs] = self._x.array_r
        self._Bt.mult(self._x, self._w)
        r[self._others] -= self._w.array_r

    def forget(self) -> None:
        """Free everything created for the tangent. Collective."""
        for thing in (self._Bt, self._w):
            if thing is not None:
                thing.destroy()
        self._Bt = self._w = None

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""
        for thing in (self._ksp, self._r, self._x, self.mass.matrix):
            thing.destroy()
