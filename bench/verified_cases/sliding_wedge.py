"""A wedge on an incline of slope tan α = 0.1 is loaded by G downwards and pushed up by F: the contact benchmark CGS-4
of NAFEMS' earlier series (2D). At full slip F/G = (tan α + μ) / (1 − μ tan α), whatever the moduli are; for μ = 0.3 that is
the 0.412371 which FrontISTR's test `cgs4` is compared with as well (its own value is 0.412168). Ours: the demo
`demos/sliding_wedge.py`, whose lengths, moduli and load are its own; quadrilaterals of degree 1 that do not match at the
incline, augmented Lagrangian. Pushed until all nodes slip, with the points that were paired at first; and over 0.5,
two facets, paired anew in each step on the deformed surfaces, of which the closed form says nothing.
"""

from sliding_wedge import Parameters, closed_form
from sliding_wedge import run as push

from verified_cases.row import Row

TITLE = "Sliding wedge (NAFEMS CGS-4)"
FAR = 0.002


def run(small, comm):
    """Push it for several coefficients of friction."""
    n, rows = 1 if small else 4, []
    for mu, travel in ((0.0, 0.0), (0.1, 0.0), (0.2, 0.0), (0.3, 0.0), (0.3, 0.5)):
        p = Parameters(mu, enforcement="augmented-lagrangian", n=n, travel=travel)
        ratio = push(p, comm)[1][-1]["ratio"]
        name = f"F/G, μ = {mu:g}" + (f", over {travel:g}" if travel else "")
        rows.append(Row(name, closed_form(mu), ratio, 0.0, "closed form"))
    return rows
