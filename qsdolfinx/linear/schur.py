"""Velocity–pressure bodies by a Schur complement: the linear solver ``"schur"``.

The velocities of all bodies, with contact and with the displacements of bodies that have nothing
else, are one block A; the pressures of all bodies are the other. PETSc's PCFIELDSPLIT eliminates
the first, and its Schur complement S = C - B A⁻¹ Bᵀ is replaced by a mass matrix of the pressures,
weighted by the inverse of the viscosity, which is of the same spectrum on any mesh.
"""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np

import ufl
from dolfinx import fem

from qsdolfinx.linear.schur_pressure import PressureMass, layout
from qsdolfinx.linear.schur_velocity import VelocityBlock
from qsdolfinx.system.body import Body

Forms = typing.Sequence[ufl.Form | None] | None

NAMES = "velocity", "pressure"


def has_schur(u: typing.Sequence[fem.Function]) -> bool:
    """Whether ``"schur"`` is for these bodies."""
    try:
        return any(pressure is not None for pressure in _pressures(u))
    except ValueError:
        return False


def check_schur(u: typing.Sequence[fem.Function], solver: str, kind: str, forms: Forms) -> None:
    """Refuse what ``"schur"`` is not for: bodies without a pressure, forms that do not fit."""
    if solver not in ("schur", "auto") and forms is not None:
        raise ValueError(f'pressure_preconditioner: is for solver="schur", not {solver!r}')
    if solver == "schur":
        if kind == "nest":
            raise ValueError('kind: solver="schur" needs the AIJ matrix')
        if all(pressure is None for pressure in _pressures(u)):
            raise ValueError(
                'solver: "schur" needs a body in velocity and pressure, see materials.mini_space; '
                'for displacements there is "amg"'
            )
    if forms is not None:
        _check_forms(u, forms)


def _pressures(u: typing.Sequence[fem.Function]) -> list[typing.Any]:
    """Of each body the pressure's part of the space, None for displacements."""
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
    """Splits, near-nullspaces and the pressure's matrix of a problem's preconditioner.

    Args:
        bodies: The bodies.
        forms: For each body a form instead of the automatic pressure mass matrix, or None.
    """

    def __init__(self, bodies: typing.Sequence[Body], forms: Forms = None) -> None:
        self._bodies = bodies
        self._comm = bodies[0].comm
        #: Pressure mass matrix of each body, None for displacements.
        self.masses = [
            None
            if layout(body.V)[1] is None
            else PressureMass(body, None if forms is None else forms[i])
            for i, body in enumerate(bodies)
        ]
        self._matrix: PETSc.Mat | None = None
        self._made = False

    def destroy(self) -> None:
        """Free PETSc's objects. Collective."""
        for mass in self.masses:
            if mass is not None:
                mass.matrix.destroy()
        if self._matrix is not None:
            self._matrix.destroy()
        self._matrix = None

    def split(self, pc: PETSc.PC, scales: typing.Sequence[float]) -> None:
        """Hand the splits to a new PCFIELDSPLIT. Collective.

        Args:
            pc: The preconditioner.
            scales: Displacement per unknown of each body.
        """
        self._made = False
        start = _first(self._comm, sum(body.num_owned for body in self._bodies))
        velocity, pressure, pressures = [], [], []
        for body, mass in zip(self._bodies, self.masses, strict=True):
            dofs = np.zeros(0, np.int64) if mass is None else mass.dofs
            pressures.append(dofs)
            pressure.append(start + dofs)
            velocity.append(start + np.setdiff1d(np.arange(body.num_owned), dofs))
            start += body.num_owned
        self._velocity = VelocityBlock(self._bodies, pressures, scales)
        for name, parts in zip(NAMES, (velocity, pressure), strict=True):
            index_set = PETSc.IS().createGeneral(
                np.concatenate(parts).astype(np.int32), comm=self._comm
            )
            pc.setFieldSplitIS((name, index_set))
            index_set.destroy()

    def update(self, ksp: PETSc.KSP, matrix: PETSc.Mat) -> None:
        """Compute the pressure's matrix for the present unknowns. Collective."""
        if ksp.getPC().getType() != PETSc.PC.Type.FIELDSPLIT:
            return  # the user's options say so
        masses = [mass for mass in self.masses if mass is not None]
        for body, mass in zip(self._bodies, self.masses, strict=True):
            if mass is not None:
                mass.assemble()
                if not mass.has_sign:
                    self._find_sign(body, mass, matrix)
        if len(masses) == 1:
            self._matrix = masses[0].matrix
        else:
            size = range(len(masses))
            nest = PETSc.Mat().createNest(
                [[masses[i].matrix if i == j else None for j in size] for i in size],
                comm=self._comm,
            )
            out = self._matrix or PETSc.Mat()
            self._matrix = nest.convert(PETSc.Mat.Type.AIJ, out)
            nest.destroy()
        if not self._made:
            self._set_up(ksp, matrix)
            self._made = True

    def _find_sign(self, body: Body, mass: PressureMass, matrix: PETSc.Mat) -> None:
        """Give a user's form the sign of C - B diag(A)⁻¹ Bᵀ. Collective."""
        before = sum(b.num_owned for b in self._bodies[: self._bodies.index(body)])
        places = before + np.setdiff1d(mass.dofs, body.owned_constrained)
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

    def _set_up(self, ksp: PETSc.KSP, matrix: PETSc.Mat) -> None:
        """Give the parts of a new preconditioner what options cannot. Collective."""
        pc = ksp.getPC()
        pc.setFieldSplitSchurPreType(PETSc.PC.FieldSplitSchurPreType.USER, self._matrix)
        ksp.setOperators(matrix, matrix)
        pc.setUp()
        inner = pc.getFieldSplitSchurGetSubKSP()[0].getPC()
        if inner.getType() == PETSc.PC.Type.PYTHON:
            inner.setPythonContext(self._velocity)


def _first(comm: typing.Any, count: int) -> int:
    """Global number of this rank's first of its unknowns."""
    return int(comm.exscan(count) or 0)
