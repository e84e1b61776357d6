"""Run the billet of bench/upsetting_j2.py through CalculiX: write input, run ccx, read output.

CAX8R, finite strains (NLGEOM with PLASTIC). The face sticks to the die. The side folds onto a ring
of the die, which is fixed, with surface-to-surface penalty contact and friction. CalculiX makes
wedges of 2 degrees from axisymmetric elements, and prints their forces. Not every penalty reaches
the end of the run: several are tried, the largest ones first.

    python3 bench/peers/upsetting_calculix.py --ccx ccx --cells 8
"""

import argparse
import contextlib
import pathlib
import re
import subprocess
import tempfile

import numpy as np

RADIUS, HEIGHT, STROKE = 10.0, 15.0, 9.0
WEDGES = 180
#: Penalties (stress per length) and longest increments that are tried.
TRIALS = [(penalty, longest) for penalty in (2e5, 1e5, 5e4) for longest in (0.02, 0.01)]
#: Penalty of friction (stress per length).
STICK = 1e5

CARDS = """*SURFACE INTERACTION, NAME=I
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR
{penalty}
*FRICTION
1., {stick}
*CONTACT PAIR, INTERACTION=I, TYPE=SURFACE TO SURFACE
SIDE, UNDER
*MATERIAL, NAME=STIFF
*ELASTIC
2.E6, 0.3
*SOLID SECTION, ELSET=RING, MATERIAL=STIFF
*MATERIAL, NAME=BILLET
*ELASTIC
200000., 0.3
*PLASTIC
700., 0.
3700., 10.
*SOLID SECTION, ELSET=BILLET, MATERIAL=BILLET
*BOUNDARY
AXIS, 1, 1
MIDDLE, 2, 2
TOP, 1, 1
DIE, 1, 1
*STEP, NLGEOM, INC=2000
*STATIC
0.005, 1., 1E-6, {longest}
*BOUNDARY
TOP, 2, 2, -{stroke}
DIE, 2, 2, -{stroke}
*NODE PRINT, NSET=MIDDLE, TOTALS=ONLY
RF
*NODE PRINT, NSET=BULGE
U
*END STEP
"""


def deck(cells, penalty=TRIALS[0][0], longest=TRIALS[0][1]):
    """Write the input file for a number of squares along the radius."""
    n, m = cells, round(cells * HEIGHT / RADIUS)
    places = [(i, j) for j in range(2 * m + 1) for i in range(2 * n + 1) if not i % 2 * (j % 2)]
    number = {place: k for k, place in enumerate(places, 1)}
    text = ["*NODE"]
    text += [f"{k}, {RADIUS * i / 2 / n}, {HEIGHT * j / 2 / m}, 0." for (i, j), k in number.items()]
    text.append("*ELEMENT, TYPE=CAX8R, ELSET=BILLET")
    around = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))
    for k in range(n * m):
        i, j = 2 * (k % n), 2 * (k // n)
        text.append(", ".join(map(str, (k + 1, *(number[i + a, j + b] for a, b in around)))))
    sets = {
        "TOP": lambda i, j: j == 2 * m,
        "MIDDLE": lambda i, j: j == 0,
        "AXIS": lambda i, j: i == 0,
        "BULGE": lambda i, j: (i, j) == (2 * n, 0),
    }
    for name, where in sets.items():
        text.append(f"*NSET, NSET={name}")
        text += [f"{k}," for place, k in number.items() if where(*place)]
    text += _ring(len(number), n * m)
    text.append("*SURFACE, NAME=SIDE, TYPE=ELEMENT")
    text += [f"{n * (j + 1)}, S2" for j in range(m)]
    cards = CARDS.format(penalty=penalty, stick=STICK, longest=longest, stroke=STROKE)
    return "\n".join(text) + "\n" + cards


def _ring(nodes, cells, count=8):
    """Add the die beyond the edge, in elements numbered after the existing nodes and cells."""
    text = ["*NODE, NSET=DIE"]
    for k in range(2 * (count + 1)):
        r = RADIUS - 0.01 + 12 * (k // 2) / count
        text.append(f"{nodes + k + 1}, {r}, {HEIGHT + 2 * (k % 2)}, 0.")
    text.append("*ELEMENT, TYPE=CAX4, ELSET=RING")
    for k in range(count):
        corners = (nodes + 2 * k + place for place in (1, 3, 4, 2))
        text.append(", ".join(map(str, (cells + k + 1, *corners))))
    text.append("*SURFACE, NAME=UNDER, TYPE=ELEMENT")
    return text + [f"{cells + k + 1}, S1" for k in range(count)]


def run(command, cells):
    """Return reductions, forces (N), radii at half height (mm), as far as it came, and penalty."""
    best = None
    for penalty, longest in TRIALS:
        found = _run(command, deck(cells, penalty, longest)) | {"penalty": penalty}
        if best is None or found["reduction"][-1] > best["reduction"][-1]:
            best = found
        if np.isclose(best["reduction"][-1], STROKE / HEIGHT):
            break
    return best


def _run(command, text, seconds=120):
    """Run one input file."""
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        (folder / "job.inp").write_text(text)
        call = [command, "-i", "job"]
        with contextlib.suppress(subprocess.TimeoutExpired):
            subprocess.run(call, cwd=folder, capture_output=True, timeout=seconds, check=False)
        text = (folder / "job.dat").read_text()
    number = r" +(\S+)"
    forces = re.findall(rf"total force.*?time{number}\n\n{number * 3}", text)
    moved = re.findall(rf"displacements.*?time{number}\n\n +\d+{number * 3}", text)
    t, force = (np.array([float(row[k]) for row in forces]) for k in (0, 2))
    radius = RADIUS + np.array([float(row[1]) for row in moved])
    start = np.zeros(1)
    return {
        "reduction": np.concatenate([start, t * STROKE / HEIGHT]),
        "force": np.concatenate([start, force * WEDGES]),
        "radius": np.concatenate([start + RADIUS, radius[: len(t)]]),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ccx", default="ccx")
    parser.add_argument("--cells", type=int, default=8)
    p = parser.parse_args()
    found = run(p.ccx, p.cells)
    print("penalty", found.pop("penalty"))
    for row in zip(*found.values(), strict=True):
        print("{:.4f} {:12.1f} {:8.4f}".format(*row))


if __name__ == "__main__":
    main()
