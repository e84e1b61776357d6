"""Forms that FFCx (seen with 0.9) makes wrong kernels of: one quadrature point beside several.

What has one value with the single point of one rule, a kernel uses for the points of the other rule
too, and rules of the same degree are taken for the same: residuals are off by percents, in silence.
"""

from __future__ import annotations

import typing

import numpy as np

import ufl
from ufl.algorithms import compute_form_data

#: Degree up to which a rule has one point.
_ONE_POINT = 1


def mixes_one_point(form: ufl.Form) -> bool:
    """Whether integrals over the same cells or facets have both rules of one point and others."""
    named = ("quadrature_degree", "quadrature_rule")
    if not any(name in each.metadata() for each in form.integrals() for name in named):
        return False  # one rule, which is estimated, for all of them
    # As FFCx does: it estimates what is not named, and brings together what belongs together.
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
    return len(rules) > 1 and (min(degrees) <= _ONE_POINT or len(set(degrees)) < len(degrees))


def _degree(metadata: dict[str, typing.Any]) -> int:
    """The one that is named, or as estimated."""
    return int(np.max(metadata.get("quadrature_degree", metadata["estimated_polynomial_degree"])))
