"""Elasto-plastic bodies at finite strains: von Mises plasticity with linear hardening.

Units are the user's, as long as they are consistent (stress = force per area). Tensors are 3 × 3,
in 2D in plane strain or, with ``axisymmetric=True``, in the order r, z, θ.
"""

from __future__ import annotations

import functools
import math
import typing

from mpi4py import MPI

import basix
import basix.ufl
import ufl
from dolfinx import fem

from qsdolfinx.base.checks import COUNT, FLAG, FUNCTION, POSITIVE, check, number, require
from qsdolfinx.base.messages import ContactWarning, warn
from qsdolfinx.compat import interpolation_points
from qsdolfinx.materials import axisymmetric_weight, gradient

#: A scalar or tensor UFL expression.
Expression = typing.Any

POISSON = number("above -1 and below 0.5", lambda nu: -1 < nu < 0.5)
HARDENING = number("at least 0, and finite", lambda H: H >= 0)

SIMPLICES = basix.CellType.triangle, basix.CellType.tetrahedron

REDUCED = (
    "degree: with a rule of degree 2 or 3, quadrilaterals and hexahedra of degree 2 have "
    "zero-energy modes, so that solves may fail: take degree=4, or triangles or tetrahedra"
)

#: Indices in a 3 × 3 tensor of the components of fields, for bodies in 2D and 3D.
_PLACES = {2: ((0, 0), (1, 1), (2, 2), (0, 1)),
           3: ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))}  # fmt: skip


class J2Plasticity:
    """Elasto-plastic body: Hencky elasticity, von Mises yield stress σ_Y + H α, associated flow.

    The deformation gradient is F = F_e F_p. With the logarithmic elastic strain e = ½ ln F_e F_eᵀ
    the Kirchhoff stress is τ = K tr(e) I + 2G dev(e), and the body yields at
    √(3/2) |dev τ| = σ_Y + H α, where α is the accumulated plastic strain. The flow rule is
    integrated over a step by the exponential map (Weber & Anand 1990; Simo 1992, Computer Methods
    in Applied Mechanics and Engineering 99, 61-112): plastic flow keeps the volume, and the return
    mapping is the closed form of small strains. UFL derives the consistent tangent of the step,
    which is symmetric.

    A step leads from the state at the last :meth:`update` to the unknown w. Call :meth:`update`
    after each step, not within a step::

        for t in stepper.run(t_end):
            body.update()

    The logarithm of the stretch of a step is a series. Its relative error is less than 1e-10 for
    stretches of the step from 0.9 to 1.1, 1e-6 from 0.75 to 1.33, and 1e-3 from 0.5 to 2.

    Args:
        w: Displacement relative to the mesh, or displacement and pressure together, such as a
            function of ``materials.mini_space``. Since plastic flow keeps the volume, displacements
            alone lock: those of degree 1 always, those of degree 2 unless ``degree`` is 2.
        E: Young's modulus, a stress.
        nu: Poisson's ratio, −1 < ν < ½.
        yield_stress: σ_Y, the initial yield stress in tension.
        hardening: H, a stress.
        axisymmetric: Whether the coordinates are (r, z): see ``materials.axisymmetric_weight``.
        degree: Degree of the quadrature rule; the history variables are at its points.

    Raises:
        TypeError: If w is not a function.
        ValueError: If a number is out of range, or w is in another space.

    Attributes:
        elastic_strain: e at the last update, its components rr, zz, θθ, rz (plane strain: xx, yy,
            zz, xy; 3D: xx, yy, zz, xy, xz, yz).
        plastic_strain: α at the last update.
        volume: Volume, without elastic strain, of a unit volume of the mesh.
        dx: Measure of the body's integrals.
        mesh: The mesh of w.
        gdim: Geometric dimension of the mesh.
        mixed: Whether w has a pressure.
        shear: Shear modulus, a stress.
        bulk: Bulk modulus, a stress.
    """

    def __init__(
        self,
        w: fem.Function,
        E: float,
        nu: float,
        yield_stress: float,
        hardening: float,
        *,
        axisymmetric: bool = False,
        degree: int = 4,
    ) -> None:
        check(FUNCTION, w=w)
        check(POSITIVE, E=E, yield_stress=yield_stress)
        check(POISSON, nu=nu)
        check(HARDENING, hardening=hardening)
        check(FLAG, axisymmetric=axisymmetric)
        check(COUNT, degree=degree)
        V = w.function_space
        self.mesh, self.gdim = V.mesh, V.mesh.geometry.dim
        subs = [V.sub(i).num_sub_spaces for i in range(V.num_sub_spaces)]
        self.mixed = subs == [self.gdim, 0]
        fits = self.gdim in _PLACES and (self.mixed or w.ufl_shape == (self.gdim,))
        require(fits, "w: must be a displacement in 2D or 3D, or a displacement and a pressure")
        fits = not axisymmetric or self.gdim == 2
        require(fits, "axisymmetric: needs a 2D mesh with coordinates (r, z)")
        whole = self.mesh.basix_cell() in SIMPLICES or self.mixed or degree > 3
        if not whole and V.ufl_element().embedded_superdegree > 1:
            warn(REDUCED, ContactWarning)
        self.w, self.axisymmetric = w, bool(axisymmetric)
        self.shear, self.bulk = E / 2 / (1 + nu), E / 3 / (1 - 2 * nu)
        self.yield_stress, self.hardening = yield_stress, hardening

        cell = self.mesh.basix_cell()
        shapes = {"elastic_strain": (len(_PLACES[self.gdim]),), "plastic_strain": (), "volume": ()}
        spaces = {
            name: fem.functionspace(
                self.mesh,
                basix.ufl.quadrature_element(cell, value_shape=shape, degree=int(degree)),
            )
            for name, shape in shapes.items()
        }
        self.elastic_strain, self.plastic_strain, self.volume = (
            fem.Function(space, name=name) for name, space in spaces.items()
        )
        self.volume.x.array[:] = 1.0
        self._start = fem.Function(V)
        self._start.x.array[:] = w.x.array
        metadata = {"quadrature_degree": int(degree), "quadrature_scheme": "default"}
        self.dx = ufl.Measure("dx", domain=self.mesh, metadata=metadata)

        self._F = self._deformation(w)
        self._solve_step()
        new = {
            self.elastic_strain: self._packed(self._strain),
            self.plastic_strain: self.plastic_strain + self._flow,
        }
        points = interpolation_points(self.plastic_strain.function_space)
        self._new = {f: fem.Expression(expression, points) for f, expression in new.items()}
        self._compiled: dict[ufl.Form, fem.Form] = {}
        ratio = ufl.det(self._F) * ufl.exp(-ufl.tr(self._old_strain))
        self._ratio = fem.Expression(ratio, points)

    @property
    def fields(self) -> dict[str, fem.Function]:
        """History variables to be transferred to another mesh, by name; see :meth:`restart`."""
        return {"elastic_strain": self.elastic_strain, "plastic_strain": self.plastic_strain}

    @property
    def state(self) -> dict[str, fem.Function]:
        """History variables to be saved with w, to resume on the same mesh; see :meth:`resume`.

        For example in a checkpoint: ``qs.save_run(stepper, folder, body.state)``.
        """
        return self.fields | {"volume": self.volume}

    @property
    def residual(self) -> ufl.Form:
        """Residual: virtual work ∫ τ : ∇v F⁻¹ at w, and with a pressure also ∫ (tr e − p/K) q.

        Subtract the virtual work of loads. The residual is the derivative of an energy.
        """
        test = ufl.TestFunction(self.w.function_space)
        v = ufl.split(test)[0] if self.mixed else test
        work = ufl.inner(self.kirchhoff_stress, self._gradient(v) * ufl.inv(self._F))
        if self.mixed:
            pressure, q = ufl.split(self.w)[1], ufl.split(test)[1]
            work -= (self._dilation + pressure / self.bulk) * q
        return self._weight * work * self.dx

    @property
    def kirchhoff_stress(self) -> Expression:
        """Kirchhoff stress τ at w: the Cauchy stress times the elastic change of volume.

        With a pressure p, tr τ = −3p. It is a UFL tensor, 3 × 3, for the measure ``dx``.
        """
        mean = -ufl.split(self.w)[1] if self.mixed else self.bulk * self._dilation
        return mean * ufl.Identity(3) + 2 * self.shear * ufl.dev(self._strain)

    def stored_energy(self) -> float:
        """Elastic energy and hardening energy at w, over all ranks. Collective."""
        return self._total(self.stored_energy_form)

    def dissipated_energy(self) -> float:
        """Energy dissipated by yielding up to w, over all ranks. Collective."""
        return self._total(self.dissipated_energy_form)

    def _total(self, form: ufl.Form) -> float:
        if form not in self._compiled:
            self._compiled[form] = fem.form(form)
        local = fem.assemble_scalar(self._compiled[form])
        return float(self.mesh.comm.allreduce(local, op=MPI.SUM))

    @functools.cached_property
    def stored_energy_form(self) -> ufl.Form:
        """Elastic and hardening energy at w, ∫ K/2 tr(e)² + G |dev e|² + H/2 α²."""
        shape, alpha = ufl.dev(self._strain), self.plastic_strain + self._flow
        energy = self.shear * ufl.inner(shape, shape) + self.hardening / 2 * alpha**2
        return self._weight * (energy + self.bulk / 2 * ufl.tr(self._strain) ** 2) * self.dx

    @functools.cached_property
    def dissipated_energy_form(self) -> ufl.Form:
        """Energy dissipated by yielding up to w, ∫ σ_Y α."""
        alpha = self.plastic_strain + self._flow
        return self._weight * self.yield_stress * alpha * self.dx

    def update(self) -> None:
        """Accept w as the end of a step: the next step starts from it. Collective.

        Use :meth:`resume` instead after w and the state were set, for example from a checkpoint.
        """
        values = []
        for field, expression in self._new.items():
            new = fem.Function(field.function_space)
            new.interpolate(expression)
            values.append(new.x.array)
        for field, value in zip(self._new, values, strict=True):
            field.x.array[:] = value
        self._start.x.array[:] = self.w.x.array

    def restart(self) -> None:
        """Take w and the present values of ``fields`` as the state of the body. Collective.

        Call this after the fields were transferred to a new mesh, on which w is zero. ``volume`` is
        computed from them; on the same mesh use :meth:`resume`, which does not change ``volume``.
        """
        self._start.x.array[:] = self.w.x.array
        self.volume.interpolate(self._ratio)

    def resume(self) -> None:
        """Take w and the present values of ``state`` as the state of the body. Collective.

        Call this after ``qs.load_run(stepper, folder, body.state)``.
        """
        self._start.x.array[:] = self.w.x.array

    # --- The step in UFL

    def _solve_step(self) -> None:
        """Elastic strain, plastic strain and dilation of the step to w."""
        relative = self._F * ufl.inv(self._deformation(self._start))
        b = relative * _exponential(2 * self._old_strain) * relative.T
        trial = ufl.dev(_logarithm(b)) / 2
        # The square root has no derivative at zero, where there is no plastic flow.
        squared = 6 * self.shear**2 * ufl.inner(trial, trial)
        limit = self.yield_stress + self.hardening * self.plastic_strain
        yields = ufl.gt(squared, limit**2)
        mises = ufl.sqrt(ufl.conditional(yields, squared, limit**2))
        #: Plastic strain of the step.
        self._flow = (mises - limit) / (3 * self.shear + self.hardening)
        shape = (1 - 3 * self.shear * self._flow / mises) * trial
        #: Change of volume, tr e.
        self._dilation = ufl.tr(self._old_strain) + ufl.ln(ufl.det(relative))
        # The dilation of the pressure has the same mean with each test function of the pressure,
        # and does not oscillate.
        dilation = -ufl.split(self.w)[1] / self.bulk if self.mixed else self._dilation
        self._strain = shape + dilation / 3 * ufl.Identity(3)

    @property
    def _weight(self) -> Expression:
        around = axisymmetric_weight(self.mesh) if self.axisymmetric else 1.0
        return around * self.volume

    @property
    def _old_strain(self) -> Expression:
        """Elastic strain at the last update, a tensor."""
        out = [[0.0] * 3 for _ in range(3)]
        for k, (i, j) in enumerate(_PLACES[self.gdim]):
            out[i][j] = out[j][i] = self.elastic_strain[k]
        return ufl.as_tensor(out)

    def _packed(self, tensor: Expression) -> Expression:
        return ufl.as_vector([tensor[i, j] for i, j in _PLACES[self.gdim]])

    def _gradient(self, u: Expression) -> Expression:
        """∇u, 3 × 3."""
        grad = gradient(u, self.axisymmetric)
        if grad.ufl_shape == (3, 3):
            return grad
        rows = [[grad[i, 0], grad[i, 1], 0] for i in range(2)]
        return ufl.as_tensor([*rows, [0, 0, 0]])

    def _deformation(self, w: fem.Function) -> Expression:
        """F = I + ∇u."""
        return ufl.Identity(3) + self._gradient(ufl.split(w)[0] if self.mixed else w)


def _logarithm(b: Expression) -> Expression:
    """Logarithm, ln b = 2 artanh(X) with X = (b − I) (b + I)⁻¹, up to X⁹."""
    one = ufl.Identity(3)
    X = (b - one) * ufl.inv(b + one)
    square = X * X
    series = one / 9
    for k in (7, 5, 3, 1):
        series = one / k + square * series
    return 2 * X * series


def _exponential(a: Expression) -> Expression:
    """Exponential, exp a = (exp a/2)², up to (a/2)⁶."""
    one = ufl.Identity(3)
    series = one / math.factorial(6)
    for k in range(5, -1, -1):
        series = one / math.factorial(k) + a / 2 * series
    return series * series
