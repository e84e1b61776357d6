"""A wedge is pushed up an incline: the force compared with the closed form.

NAFEMS contact benchmark CGS-4: on a slope tan α = 0.1 a wedge carries the load G and is pushed up
by the force F. At full slip F/G = (tan α + μ) / (1 − μ tan α), for any moduli: 0.412371 for μ =
0.3. The FrontISTR test `cgs4` compares its result 0.412168 with this value.

Our model: the demo `demos/sliding_wedge.py`, with its own dimensions, moduli and load; non-matching
quadrilaterals of degree 1 at the incline, augmented Lagrangian. The wedge is pushed until all nodes
slip, with the contact pairs of the initial geometry. It is also pushed over 0.5, two facets of the
coarse mesh, with the contact pairs updated in each step on the deformed surfaces; for these the
closed form is not quite exact.
"""

from sliding_wedge import Parameters, closed_form
from sliding_wedge import run as push
from verified_cases.row import Row

TITLE = "Sliding wedge (NAFEMS CGS-4)"
FAR = 0.002


def run(small, comm):
    """Push the wedge for several coefficients of friction."""
    n, rows = 1 if small else 4, []
    for mu, travel in ((0.0, 0.0), (0.1, 0.0), (0.2, 0.0), (0.3, 0.0), (0.3, 0.5)):
        p = Parameters(mu, enforcement="augmented-lagrangian", n=n, travel=travel)
        ratio = push(p, comm)[1][-1]["ratio"]
        name = f"F/G, μ = {mu:g}" + (f", over {travel:g}" if travel else "")
        rows.append(Row(name, closed_form(mu), ratio, 0.0, "closed form"))
    return rows
