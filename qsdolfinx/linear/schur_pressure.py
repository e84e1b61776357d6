"""Pressure matrix of the linear solver ``"schur"``, computed from a body's tangent."""

from __future__ import annotations

import typing

from petsc4py import PETSc

import numpy as np

import basix
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc

from qsdolfinx.base.collective import collective_errors
from qsdolfinx.compat import collapse, num_entity_dofs
from qsdolfinx.system.body import Body


def layout(V: fem.FunctionSpace) -> tuple[int | None, int | None]:
    """Indices of the sub-spaces of velocity and pressure; (None, None) for displacements alone.

    Raises:
        ValueError: If V is neither a vector field nor a vector field with a scalar field.
    """
    gdim = V.mesh.geometry.dim
    if V.num_sub_spaces == gdim and V.dofmap.index_map_bs == gdim:
        return None, None
    parts = [V.sub(i).num_sub_spaces for i in range(V.num_sub_spaces)]
    if sorted(parts) != [0, gdim]:
        raise ValueError('solver: "schur" is for bodies in velocity and pressure, or displacements')
    velocity = parts.index(gdim)
    sub = V.sub(velocity).collapse()[0]
    edges = num_entity_dofs(sub, 1)
    if sub.element.basix_element.family != basix.ElementFamily.P and edges > 0:
        raise ValueError('solver: "schur" is for velocities of Lagrange or MINI elements')
    return velocity, parts.index(0)


def _test_and_trial(form: ufl.Form) -> tuple[typing.Any, typing.Any]:
    test, trial = sorted(form.arguments(), key=lambda argument: int(argument.number()))
    return test, trial


class PressureMass:
    """Mass matrix of one body's pressure that approximates its Schur complement.

    Its weight is computed from the tangent J, cell by cell. With fields v = E x of constant strain
    rate E, without volume change and of norm 1, as trial and test function, J gives a = 2η, the
    mean of the tangent stress over such E. With a unit pressure as one of the functions, J gives b,
    the factor of p div v. With two unit pressures it gives c, the compressibility. The weight is c
    - b₁ b₂ / a. In ``materials.incompressible`` this is -1/(2η), with the viscosity η of the
    present iterate.

    Args:
        body: A body with velocity and pressure.
        given: Bilinear form on the body's space to use instead, such as p q / (2η) dx.
    """

    def __init__(self, body: Body, given: ufl.Form | None) -> None:
        self.body = body
        velocity, pressure = layout(body.V)
        assert velocity is not None and pressure is not None
        self._velocity_first = velocity < pressure
        self._gdim = body.V.mesh.geometry.dim
        #: Space of the pressure, and its unknowns in the body's numbering.
        self.Q, dofs = collapse(body.V.sub(pressure))
        owned = dofs[: self.Q.dofmap.index_map.size_local]
        #: Owned unknowns of the body that are pressures, ascending.
        self.dofs = np.sort(owned)
        with collective_errors(body.V.mesh.comm):
            if np.any(owned != self.dofs):
                raise NotImplementedError("pressures are not numbered as in the body's space")
        self._constrained = np.flatnonzero(np.isin(owned, body.owned_constrained))
        p, q = ufl.TrialFunction(self.Q), ufl.TestFunction(self.Q)
        self._weight = fem.Function(fem.functionspace(body.V.mesh, ("DG", 0, (5,))))
        self._probes: fem.Form | None = None
        if given is None:
            form = self._weight[0] * p * q * ufl.dx
            self._probes = self._create_probes()
        else:
            test, trial = _test_and_trial(given)
            form = ufl.replace(given, {test: self._pressure(q), trial: self._pressure(p)})
        self._form: typing.Any = body.compiling.form(form)
        #: Sign of the form; a user's form may have either sign.
        self.sign = 1.0
        self.has_sign = given is None
        self.matrix: PETSc.Mat = fem_petsc.create_matrix(self._form)

    def _join(self, v: typing.Any, p: typing.Any) -> typing.Any:
        """Combine velocity and pressure to a value of the body's space."""
        parts = [*(v[i] for i in range(self._gdim)), p]
        return ufl.as_vector(parts if self._velocity_first else [parts[-1], *parts[:-1]])

    def _pressure(self, p: typing.Any) -> typing.Any:
        return self._join(ufl.as_vector([0.0] * self._gdim), p)

    def _create_probes(self) -> fem.Form:
        """Linear form in five piecewise constants: a, b₁, b₂, c and the volume."""
        msh, gdim = self.body.V.mesh, self._gdim
        x = ufl.SpatialCoordinate(msh)
        z = ufl.TestFunction(self._weight.function_space)
        tangent = self.body.tangent_form
        cells = ufl.Form([i for i in tangent.integrals() if i.integral_type() == "cell"])
        test, trial = _test_and_trial(cells)

        def put(first: typing.Any, second: typing.Any, place: int) -> ufl.Form:
            return ufl.replace(cells, {test: z[place] * first, trial: second})

        velocities = self.body.geometry.volume_preserving(x, gdim)
        fields = [self._join(velocity, 0.0) for velocity in velocities]
        along = self._join(ufl.as_vector([0.0] * (gdim - 1) + [x[gdim - 1]]), 0.0)
        one = self._pressure(1.0)
        form = z[4] * ufl.dx(domain=msh)
        for field in fields:
            form += 1 / len(fields) * put(field, field, 0)
        return self.body.compiling.form(
            form + put(along, one, 1) + put(one, along, 2) + put(one, one, 3)
        )

    def assemble(self) -> None:
        """Assemble for the present unknowns. Collective."""
        with self.body.watch.stage("bulk assembly"):
            if self._probes is not None:
                values = fem.assemble_vector(self._probes).array.reshape(-1, 5)
                a, b1, b2, c, volume = values.T
                volume = np.where(volume == 0, 1.0, volume)  # ghost cells
                ratio = np.divide(b1 * b2, a, out=np.zeros_like(a), where=a != 0)
                self._weight.x.array[::5] = (c - ratio) / volume
            self.matrix.zeroEntries()
            fem_petsc.assemble_matrix(self.matrix, self._form)
            self.matrix.assemble()
            self.matrix.scale(self.sign)
            rows = self._constrained + self.matrix.getOwnershipRange()[0]
            self.matrix.zeroRowsColumns(rows.astype(np.int32), diag=1.0)
