"""Forms that FFCx (seen with 0.9) makes wrong kernels of: one quadrature point beside several.

Gradients at the single point of one rule are constant in a cell, and kernels use them for the
points of the other rule too: residuals are off by percents, in silence.
"""

from __future__ import annotations

import typing

import ufl


def mixes_one_point(form: ufl.Form) -> bool:
    """Whether integrals over the same cells have both rules of one point and others.

    Forms of affine functions on simplices are right: their gradients are constant anyway.
    """
    if _constant_gradients(form):
        return False
    rules: dict[typing.Any, set[bool]] = {}
    for integral in form.integrals():
        if integral.integral_type() == "cell":
            degree = integral.metadata().get("quadrature_degree")
            one = isinstance(degree, int) and degree in (0, 1)
            for region in _regions(integral.subdomain_id()):
                rules.setdefault(region, set()).add(one)
    everywhere = rules.pop("everywhere", set())
    return any(len(everywhere | here) > 1 for here in (set(), *rules.values()))


def _regions(subdomain: typing.Any) -> tuple[typing.Any, ...]:
    return subdomain if isinstance(subdomain, tuple) else (subdomain,)


def _constant_gradients(form: ufl.Form) -> bool:
    domain = form.ufl_domain()
    elements = [each.ufl_element() for each in (*form.arguments(), *form.coefficients())]
    elements.append(domain.ufl_coordinate_element())
    simplex = domain.ufl_cell().cellname() in ("interval", "triangle", "tetrahedron")
    return simplex and all(element.embedded_superdegree <= 1 for element in elements)
