"""Draw the pressure on the lower die of a forging with three contact formulations.

python3 demos/forging_plot.py --die-refinement 4 forging.png
"""

import argparse
import pathlib
import sys

from mpi4py import MPI

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from common.command import picture_file, say
from common.film import Film, compare
from forging import Parameters, run
from forging_bodies import HEIGHT, SPEED

KINDS = (
    ("master-slave", "nodal"),
    ("quasi-symmetric", "nodal"),
    ("quasi-symmetric", "overlay"),
)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("filename", type=picture_file)
    parser.add_argument("--die-refinement", type=float, default=4.0)
    parser.add_argument("--reduction", type=float, default=0.3)
    parser.add_argument("--steps", type=int, default=Parameters.num_steps)
    a = parser.parse_args()
    states = {}
    for kind in KINDS:
        film, title = Film(HEIGHT, SPEED), ", ".join(kind)
        p = Parameters(a.die_refinement, *kind, reduction=a.reduction, num_steps=a.steps)
        result, _ = run(p, on_step=film)
        states[title] = film.states and film.states[-1]
        say(f"{title:26} roughness {result['die_traction_roughness']:.3g}")
    if MPI.COMM_WORLD.rank == 0:
        compare(a.filename, states)


if __name__ == "__main__":
    main()
