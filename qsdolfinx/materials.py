"""Materials as UFL: stresses of elastic and viscoplastic bodies, incompressible flow, and heat.

Use any consistent units (stress = force per area; rates per time).

In 2D the state is plane strain, and tensors are 2 × 2; the strains out of the plane are zero. With
``axisymmetric=True`` the mesh is the half-plane of coordinates (r, z), r ≥ 0, and tensors are 3 × 3
in the order r, z, θ; integrals are taken around the axis, see ``axisymmetric_weight``.
"""

from __future__ import annotations

import math
import typing

import numpy as np

import basix.ufl
import ufl
from dolfinx import fem, mesh

from qsdolfinx.base.checks import (
    FINITE,
    FRACTION,
    FUNCTION,
    MESH,
    POSITIVE,
    Kind,
    check,
    either,
    instance,
    number,
    require,
)

__all__ = [
    "axisymmetric_weight",
    "equivalent_strain_rate",
    "gradient",
    "heat",
    "incompressible",
    "linear_elastic",
    "mini_space",
    "neo_hookean",
    "neo_hookean_energy",
    "newtonian",
    "norton_hoff",
    "plastic_heat",
    "strain",
]

#: A number, a fem.Constant, a fem.Function or any other scalar UFL expression.
Scalar = typing.Any
#: A scalar, vector or tensor UFL expression.
Expression = typing.Any

POISSON = number("above -1 and below 0.5", lambda nu: -1 < nu < 0.5)
SENSITIVITY = number("at most 1", lambda m: m <= 1)

CAPACITY = number("at least 0, and finite", lambda c: c >= 0)

_SIMPLICES = (mesh.CellType.triangle, mesh.CellType.tetrahedron)


def gradient(u: Expression, axisymmetric: bool = False) -> Expression:
    """Gradient ∂u_i/∂x_j of a vector field; axisymmetric with the hoop term u_r/r.

    Args:
        u: Displacement or velocity, or a test function.
        axisymmetric: Whether the coordinates are (r, z).

    Returns:
        Square tensor with one row for each component of u; 3 × 3 in the order r, z, θ if
        axisymmetric.
    """
    shape = getattr(u, "ufl_shape", None)
    require(shape in ((2,), (3,)), "u: must be a vector field of UFL with 2 or 3 components")
    fits = not axisymmetric or shape == (2,)
    require(fits, "axisymmetric: needs a 2D mesh with coordinates (r, z)")
    grad = ufl.grad(u)
    if not axisymmetric:
        return grad
    hoop = u[0] / ufl.SpatialCoordinate(ufl.domain.extract_unique_domain(u))[0]
    return ufl.as_tensor([[grad[0, 0], grad[0, 1], 0], [grad[1, 0], grad[1, 1], 0], [0, 0, hoop]])


def strain(u: Expression, axisymmetric: bool = False) -> Expression:
    """Linear strain (strain rate for a velocity) ε = ½ (∇u + ∇uᵀ); ε_θθ = u_r/r.

    Args:
        u: Displacement or velocity, or a test function.
        axisymmetric: Whether the coordinates are (r, z).
    """
    return ufl.sym(gradient(u, axisymmetric))


def axisymmetric_weight(msh: mesh.Mesh) -> Expression:
    """Circumference 2πr at a point: the weight of all integrands, including those of loads.

    Forces then refer to the whole ring.
    """
    fits = msh.geometry.dim == 2
    require(fits, "msh: axisymmetric bodies need a 2D mesh with coordinates (r, z)")
    return 2 * math.pi * ufl.SpatialCoordinate(msh)[0]


def linear_elastic(
    u: Expression,
    E: Scalar,
    nu: Scalar,
    axisymmetric: bool = False,
    thermal_strain: Scalar = 0.0,
) -> Expression:
    """Cauchy stress of Hooke's law, σ = 2μ ε + λ tr(ε) I − (3λ + 2μ) ε_T I, 2D in plane strain.

    μ = E / (2 (1 + ν)), λ = E ν / ((1 + ν) (1 − 2ν)).

    Args:
        u: Displacement.
        E: Young's modulus, a stress.
        nu: Poisson's ratio, −1 < ν < ½.
        axisymmetric: Whether the coordinates are (r, z).
        thermal_strain: Thermal strain ε_T = α (T − T₀), with T a number or a field: the strain of a
            body that can expand freely, equal in all directions (in plane strain also out of the
            plane).
    """
    _check(POSITIVE, E=E)
    _check(POISSON, nu=nu)
    _check(FINITE, thermal_strain=thermal_strain)
    eps = strain(u, axisymmetric)
    mu, lmbda = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    free = (3 * lmbda + 2 * mu) * thermal_strain
    return 2 * mu * eps + (lmbda * ufl.tr(eps) - free) * ufl.Identity(eps.ufl_shape[0])


def neo_hookean_energy(
    u: Expression, mu: Scalar, lmbda: Scalar, axisymmetric: bool = False
) -> Expression:
    """Energy per reference volume, W = μ/2 (tr(FᵀF) − 3 − 2 ln J) + λ/2 (ln J)².

    Here F = I + ∇u and J = det F. This is the compressible neo-Hookean material of Bonet & Wood,
    *Nonlinear Continuum Mechanics for Finite Element Analysis* (2008), section 6.4.3.

    Args:
        u: Displacement.
        mu: Shear modulus at small strains, a stress.
        lmbda: Lamé's first parameter at small strains, a stress.
        axisymmetric: Whether the coordinates are (r, z).
    """
    _check(POSITIVE, mu=mu)
    _check(FINITE, lmbda=lmbda)
    F = _deformation_gradient(u, axisymmetric)
    log_J = ufl.ln(ufl.det(F))
    # Sum of the squared stretches; the stretch normal to the plane is 1.
    stretches = ufl.inner(F, F) + (3 - F.ufl_shape[0])
    return mu / 2 * (stretches - 3 - 2 * log_J) + lmbda / 2 * log_J**2


def neo_hookean(u: Expression, mu: Scalar, lmbda: Scalar, axisymmetric: bool = False) -> Expression:
    """First Piola-Kirchhoff stress P = ∂W/∂F = μ (F − F⁻ᵀ) + λ ln J F⁻ᵀ, unsymmetric.

    The virtual work per reference volume is ``inner(P, gradient(v, axisymmetric))``, v being the
    test function; W is ``neo_hookean_energy``.

    Args:
        u: Displacement.
        mu: Shear modulus at small strains, a stress.
        lmbda: Lamé's first parameter at small strains, a stress.
        axisymmetric: Whether the coordinates are (r, z).
    """
    _check(POSITIVE, mu=mu)
    _check(FINITE, lmbda=lmbda)
    F = _deformation_gradient(u, axisymmetric)
    inverse = ufl.inv(F).T
    return mu * (F - inverse) + lmbda * ufl.ln(ufl.det(F)) * inverse


def newtonian(v: Expression, K: Scalar, axisymmetric: bool = False) -> Expression:
    """Deviatoric stress of a Newtonian fluid, s = 2K ε̇.

    Args:
        v: Velocity, incompressible.
        K: Viscosity, stress × time.
        axisymmetric: Whether the coordinates are (r, z).
    """
    _check(POSITIVE, K=K)
    return 2 * K * strain(v, axisymmetric)


def equivalent_strain_rate(v: Expression, axisymmetric: bool = False) -> Expression:
    """Equivalent strain rate ε̇_eq = √(2/3 ε̇:ε̇), per time; in upsetting it is velocity / height.

    Args:
        v: Velocity, incompressible.
        axisymmetric: Whether the coordinates are (r, z).
    """
    rate = strain(v, axisymmetric)
    return ufl.sqrt(2 / 3 * ufl.inner(rate, rate))


def norton_hoff(
    v: Expression, K: Scalar, m: Scalar, regularisation: Scalar, axisymmetric: bool = False
) -> Expression:
    """Deviatoric stress of a Norton-Hoff body, s = 2K (√3 ε̇)^{m−1} ε̇, with ε̇² = ε̇_eq² + ε̇₀².

    This is the law of Fourment & Popa (2005) with ε̇₀ added; without ε̇₀ the viscosity of a body at
    rest would be infinite. With ε̇₀, stresses are multiplied by (1 + (ε̇₀/ε̇_eq)²)^{(m−1)/2}: for
    ε̇₀ = ε̇_eq / 1000 they are too low by less than 1e-6. The yield stress in tension is
    K √3^{m+1} ε̇_eq^m.

    Both K and m may be UFL expressions, for example functions of the temperature.

    Args:
        v: Velocity, incompressible.
        K: Consistency, stress × time^m.
        m: Rate sensitivity, 0 < m ≤ 1. m = 1 is a Newtonian body; m = 0 would be a rigid-plastic
            body with the von Mises yield stress √3 K. For small m see ``solve_with_continuation``.
        regularisation: ε̇₀, per time, such as a thousandth of velocity / height.
        axisymmetric: Whether the coordinates are (r, z).
    """
    _check(POSITIVE, K=K, m=m, regularisation=regularisation)
    _check(SENSITIVITY, m=m)
    rate = strain(v, axisymmetric)
    squared = 2 * ufl.inner(rate, rate) + 3 * regularisation**2  # (√3 ε̇)²
    return 2 * K * squared ** ((m - 1) / 2) * rate


def mini_space(msh: mesh.Mesh) -> fem.FunctionSpace:
    """Mixed space of the MINI element: velocity P1 with a cell bubble, ``sub(0)``, and P1 pressure.

    It satisfies the inf-sup condition (Arnold, Brezzi & Fortin 1984). On facets the velocity is P1,
    so ``qs.Surface(W.sub(0), ...)`` can be used for contact.

    Args:
        msh: Mesh of triangles or tetrahedra.
    """
    check(MESH, msh=msh)
    gdim, cell_type = msh.geometry.dim, msh.topology.cell_type
    text = "msh: the MINI element needs triangles in 2D or tetrahedra in 3D, not "
    fits = cell_type in _SIMPLICES and msh.topology.dim == gdim
    require(fits, f"{text}{cell_type.name} cells in {gdim}D")
    cell = msh.basix_cell()
    linear = basix.ufl.element("Lagrange", cell, 1)
    bubble = basix.ufl.element("Bubble", cell, gdim + 1)
    velocity = basix.ufl.blocked_element(
        basix.ufl.enriched_element([linear, bubble]), shape=(gdim,)
    )
    return fem.functionspace(msh, basix.ufl.mixed_element([velocity, linear]))


def incompressible(w: fem.Function, stress: Expression, dx: ufl.Measure | None = None) -> ufl.Form:
    """Residual of slow incompressible flow, ∫ s:ε̇(v*) − p div v* − q div v, with w = (v, p).

    Its derivative is symmetric if s derives from a potential. The residual is axisymmetric, with
    the weight 2πr and the term v_r/r in div v, if the stress is axisymmetric. Subtract the virtual
    power of loads, with the test functions v*, q = ``ufl.TestFunctions(w.function_space)``. The
    Cauchy stress is s − p I. If Dirichlet conditions prescribe the normal velocity on the whole
    boundary, prescribe p at a point.

    Args:
        w: Velocity and pressure, such as a function of ``mini_space``.
        stress: Deviatoric stress s for the velocity ``ufl.split(w)[0]``.
        dx: Measure; by default over the mesh, with a rule that is exact for the MINI element with
            constant viscosity, except in axisymmetric flow.
    """
    check(FUNCTION, w=w)
    check(either(instance(ufl.Measure, "a measure of UFL"), None), dx=dx)
    msh = w.function_space.mesh
    gdim = msh.geometry.dim
    subs = [w.function_space.sub(i) for i in range(w.function_space.num_sub_spaces)]
    mixed = [sub.num_sub_spaces for sub in subs] == [gdim, 0]
    require(mixed, "w: must be in a mixed space of velocity and pressure, see mini_space")
    shape = getattr(stress, "ufl_shape", None)
    axisymmetric = gdim == 2 and shape == (3, 3)
    fits = shape == (gdim, gdim) or axisymmetric
    require(fits, f"stress: must be a tensor of UFL for velocities in {gdim}D")
    if dx is None:
        # UFL would estimate a far higher degree for a power.
        degree = 2 * gdim + axisymmetric
        dx = ufl.Measure("dx", domain=msh, metadata={"quadrature_degree": degree})
    (v, p), (dv, q) = ufl.split(w), ufl.TestFunctions(w.function_space)
    rate, test = strain(v, axisymmetric), strain(dv, axisymmetric)
    integrand = ufl.inner(stress, test) - p * ufl.tr(test) - q * ufl.tr(rate)
    return (axisymmetric_weight(msh) * integrand if axisymmetric else integrand) * dx


def heat(
    T: fem.Function,
    conductivity: Scalar,
    capacity: Scalar = 0.0,
    before: fem.Function | None = None,
    dt: Scalar | None = None,
    source: Scalar = 0.0,
    axisymmetric: bool = False,
    dx: ufl.Measure | None = None,
) -> ufl.Form:
    """Residual of heat conduction, ∫ c (T − T₀)/Δt T* + k ∇T·∇T* − s T*, by backward Euler.

    Subtract the heat flux h through the boundary into the body, per area and time, as
    ``h * T* * ds``, with T* = ``ufl.TestFunction(T.function_space)``; if axisymmetric, multiply it
    by ``axisymmetric_weight``. The method is of first order in Δt. It conserves energy: with T* = 1
    the heat stored in a body without Dirichlet conditions is that of its sources, up to rounding.

    Args:
        T: Temperature, in a scalar space.
        conductivity: Conductivity k, power per length and temperature.
        capacity: Heat capacity c, heat per volume and temperature (density times specific heat); 0
            for steady state.
        before: Temperature T₀ at the start of the step; not needed for steady state.
        dt: Length Δt of the step, a time.
        source: Heat source s, power per volume, such as ``plastic_heat``.
        axisymmetric: Whether the coordinates are (r, z); integrals then have the weight 2πr.
        dx: Measure; by default over the mesh.
    """
    check(FUNCTION, T=T)
    check(either(FUNCTION, None), before=before)
    check(either(instance(ufl.Measure, "a measure of UFL"), None), dx=dx)
    require(T.ufl_shape == (), "T: must be a scalar field")
    _check(POSITIVE, conductivity=conductivity)
    _check(CAPACITY, capacity=capacity)
    _check(FINITE, source=source)
    steady = _value(capacity) == 0
    known = before is not None and dt is not None
    require(steady or known, "before, dt: must be given with a capacity (old T, length of step)")
    if dt is not None:
        _check(POSITIVE, dt=dt)
    msh = T.function_space.mesh
    weight = axisymmetric_weight(msh) if axisymmetric else 1.0
    test = ufl.TestFunction(T.function_space)
    integrand = conductivity * ufl.inner(ufl.grad(T), ufl.grad(test)) - source * test
    if not steady:
        integrand += capacity * (T - before) / dt * test
    return weight * integrand * (ufl.dx(msh) if dx is None else dx)


def plastic_heat(
    stress: Expression, v: Expression, share: Scalar = 0.9, axisymmetric: bool = False
) -> Expression:
    """Plastic heat source per volume, β s:ε̇, for ``source`` of ``heat``.

    Args:
        stress: Deviatoric stress s, such as ``norton_hoff``.
        v: Velocity of this stress, incompressible.
        share: Taylor-Quinney coefficient β (Taylor & Quinney 1934), from 0 to 1; the rest of the
            plastic power is stored in the material.
        axisymmetric: Whether the coordinates are (r, z).
    """
    _check(FRACTION, share=share)
    return share * ufl.inner(stress, strain(v, axisymmetric))


def _deformation_gradient(u: Expression, axisymmetric: bool) -> Expression:
    grad = gradient(u, axisymmetric)
    return ufl.Identity(grad.ufl_shape[0]) + grad


def _value(given: Scalar) -> float | None:
    """Value of a number or a Constant."""
    if isinstance(given, fem.Constant):
        given = given.value.item() if given.value.size == 1 else math.nan
    return float(given) if isinstance(given, (int, float, np.number)) else None


def _check(kind: Kind, **parameters: Scalar) -> None:
    """Raise an error unless each is a scalar UFL expression, or a number or Constant of a kind."""
    for name, given in parameters.items():
        value = _value(given)
        if value is not None:
            check(kind, **{name: value})
        elif getattr(given, "ufl_shape", None) != ():
            raise TypeError(f"{name}: must be a number, a Constant, a Function or a scalar of UFL")
