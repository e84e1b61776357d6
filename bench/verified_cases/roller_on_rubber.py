"""A steel roller is pressed into a sheet of rubber and turned once.

This case follows benchmark 5 of A. Konter, *Advanced Finite Element Contact Benchmarks*, NAFEMS
R0094 (2006). The reference −175.4 is the displacement of a node of the roller along the sheet after
one turn in 90 steps, with a tolerance of 3 %. **The scene here is not exactly the benchmark**: the
report was not available, and no public description with all dimensions and the constants of the
rubber was found.

Our model is the demo `demos/rubber.py --scene roller`: a rigid roller, radius 30 mm, pressed 3 mm
into a sheet 20 mm thick that is clamped below, friction 0.3, in plane strain whereas the benchmark
is 3D, and neo-Hookean rubber with ν = 0.49; quadrilaterals of degree 1, with contact detection in
each step. The result shows by how much the way of a roller on rubber that it stretches is shorter
than its circumference, 188.5 mm.
"""

from rubber import Parameters
from rubber import run as roll
from verified_cases.row import Row

TITLE = "Roller on rubber (after NAFEMS R0094, 5)"
FAR = 0.05


def run(small, comm):
    """Press the roller and turn it once."""
    facet, steps = (8.0, 24) if small else (2.0, 90)
    result = roll(Parameters("roller", facet=facet, steps=steps), comm)[0]
    return [Row("u_x of a turn, mm", -175.4, result["u_x"], 0.03, "NAFEMS R0094, 5")]
