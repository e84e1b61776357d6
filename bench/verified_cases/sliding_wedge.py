"""A wedge that is pushed up an incline: the force against the closed form.

NAFEMS' contact benchmark CGS-4: on a slope tan α = 0.1 a wedge carries G and is pushed up by F. At
full slip F/G = (tan α + μ) / (1 − μ tan α), whatever the moduli are: 0.412371 for μ = 0.3, with
which FrontISTR's test `cgs4` compares its 0.412168.

Ours: the demo `demos/sliding_wedge.py`, whose dimensions, moduli and load are its own;
quadrilaterals of degree 1 that do not match at the incline, augmented Lagrangian. Pushed until all
nodes slip, with the points that were paired at first; and over 0.5, two facets of the coarse mesh,
paired anew in each step on the deformed surfaces, for which the closed form does not quite hold.
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
