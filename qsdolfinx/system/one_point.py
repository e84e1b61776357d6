"""Detect forms for which FFCx (seen with 0.9) generates wrong kernels (one-point rules).

If integrals combine a one-point rule with other quadrature rules, the kernel uses values at the
single point also for the points of the other rule. Different rules of the same degree are treated
as equal. Residuals then have errors of some percent, without a warning.
"""

from __future__ import annotations

import typing

import numpy as np

import ufl
from ufl.algorithms import compute_form_data


def mixes_one_point(form: ufl.Form) -> bool:
    """Whether integrals over the same cells or facets combine one-point rules with others."""
    named = ("quadrature_degree", "quadrature_rule")
    if not any(name in each.metadata() for each in form.integrals() for name in named):
        return False  # one rule, with estimated degree, for all integrals
    # As in FFCx: it estimates missing degrees, and groups integrals by domain.
    data = compute_form_data(
        form,
        do_apply_function_pullbacks=True,
        do_apply_integral_scaling=True,
        do_apply_geometry_lowering=True,
        preserve_geometry_types=(ufl.classes.Jacobian,),
        do_apply_restrictions=True,
        do_append_everywhere_integrals=False,
        complex_mode=False,
    )
    return any(_mixes(group.integrals) for group in data.integral_data)


def _mixes(integrals: list[ufl.Integral]) -> bool:
    found = [each.metadata() for each in integrals]
    rules = {(_degree(m), str(m.get("quadrature_rule", "default"))) for m in found}
    degrees = [degree for degree, _ in rules]
    # Rules of degree 0 and 1 have one point.
    return len(rules) > 1 and (min(degrees) <= 1 or len(set(degrees)) < len(degrees))


def _degree(metadata: dict[str, typing.Any]) -> int:
    """Given quadrature degree, or else the estimated one."""
    return int(np.max(metadata.get("quadrature_degree", metadata["estimated_polynomial_degree"])))
