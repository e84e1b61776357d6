"""Measure the influence of the finite size of the bodies of the job "hertz" on the pressure.

Bodies of several sizes, with the same meshes at the contact, are pressed until the force is that of
the same Hertz radius. Printed are the displacement of the top, the errors against Hertz's solution,
and the relative L2 difference of the pressure on the lower body from that of the largest bodies, in
the region of even cells.

    scripts/with-dolfinx python3 bench/peers/hertz_size.py --sizes 20,16 --sides 6 8 12 16
"""

import argparse
import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import hertz_error
import ours
import sphere

RADIUS, CLOSE = 1.0, 1e-5


def pressure(sizes, u):
    """Return pressure and areas of nodes on the lower body's top in the region of even cells."""
    body = sphere.bodies(sizes)[0]
    nodes = np.unique(body.high)
    nodes = nodes[body.x[nodes, :2].max(axis=1) < sphere.EVEN[0][0]]
    area = hertz_error.areas(body.x, body.high)[nodes]
    forces = hertz_error.internal_forces(body, u[: len(body.x)], sphere.E[0], sphere.NU)
    return -forces[nodes, 2] / area, area


def press(p, sizes):
    """Return displacements and errors for the force of the requested radius."""
    while True:
        u, _ = ours.solve(p, sphere, sizes)
        row = hertz_error.measure(sizes, u)
        if abs(row["radius"] / RADIUS - 1) < CLOSE:
            return u, row
        sphere.PRESS *= (RADIUS / row["radius"]) ** 2  # as between half spaces


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", default="20,16", help="cells along an edge, LOWER,UPPER")
    parser.add_argument("--sides", type=float, nargs="+", default=[6.0, 8.0, 12.0, 16.0])
    given = parser.parse_args()
    sizes = [int(n) for n in given.sizes.split(",")]
    p = ours.arguments().parse_args(["--sizes", given.sizes])
    found = []
    for side in sorted(given.sides):
        sphere.SIDE = side
        u, row = press(p, sizes)
        found.append((side, sphere.PRESS, row, *pressure(sizes, u)))
    largest, area = found[-1][3:]
    print(f"{'side':>8}{'u_z':>12}{'lower %':>9}{'upper %':>9}{'from largest %':>16}")
    for side, moved, row, values, _ in found:
        squares = [np.sum(area * f**2) for f in (values - largest, largest)]
        print(
            f"{side:8g}{moved:12.6f}{100 * row['l2_lower']:9.2f}{100 * row['l2_upper']:9.2f}"
            f"{100 * np.sqrt(squares[0] / squares[1]):16.3f}"
        )


if __name__ == "__main__":
    main()
