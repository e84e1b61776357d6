"""A steel roller is pressed into a sheet of rubber and turned once.

After benchmark 5 of A. Konter, *Advanced Finite Element Contact Benchmarks*, NAFEMS R0094 (2006).
−175.4 is its displacement along the sheet of a node of the roller after one turn in 90 steps, to
be met to 3 %. **The scene here is not quite that one**: the report was not at hand, and no public
description with all dimensions and the rubber's constants was found.

Ours is the demo `demos/rubber.py --scene roller`: a rigid roller, radius 30 mm, pressed 3 mm into
a sheet 20 mm thick that is clamped below, friction 0.3, in plane strain where the benchmark is 3D,
and of neo-Hookean rubber with ν = 0.49; quadrilaterals of degree 1, paired step by step. It tells
how much less than its circumference, 188.5 mm, a roller comes on rubber that it stretches.
"""

from rubber import Parameters
from rubber import run as roll
from verified_cases.row import Row

TITLE = "Roller on rubber (after NAFEMS R0094, 5)"
FAR = 0.05


def run(small, comm):
    """Press and turn it once."""
    facet, steps = (8.0, 24) if small else (2.0, 90)
    result = roll(Parameters("roller", facet=facet, steps=steps), comm)[0]
    return [Row("u_x of a turn, mm", -175.4, result["u_x"], 0.03, "NAFEMS R0094, 5")]
