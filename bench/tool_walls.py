"""Print the forces of a frustum of facets that is pressed into a block, without friction.

For each number of cells, with small sliding: the force down with the walls of the tool and with its
bottom alone, and the force sideways over the force down with walls, in %.

    python3 bench/tool_walls.py [--cells 4,8,12,16]
"""

import argparse
import pathlib
import sys
import warnings

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "tests"))

from scenes import WORLD, box, clamp, elastic, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs

MIDDLE = np.array([0.513, 0.531])  # no edge of the tool is on a line of the mesh
DEPTH = 0.03


def frustum(closed):
    """Make the tool, with walls inclined by 69° to its bottom, or its bottom alone."""
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    x = [[*(MIDDLE + half * s), z] for half, z in ((0.2, 0.0), (0.35, 0.4)) for s in signs]
    sides = [(0, 3, 2, 1), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 6, 7)]
    halves = [(a, *b) for a, *two in sides[: 6 if closed else 1] for b in (two[:2], two[1:])]
    return qs.RigidSurface.triangulated(WORLD, np.array(x), halves)


def force(n, closed):
    """Press the tool into a block of n × n cells; returns the force on the tool."""
    msh = box(WORLD, (n, n, n // 2), "hexahedron", (0.0, 0.0, -0.5), (1.0, 1.0, 0.0))
    V = vector_space(msh)
    u, tool = fem.Function(V), frustum(closed)
    contact = qs.Contact(qs.Surface(V, facets=plane(msh, 2, 0.0)), tool, sliding="small")
    bcs = [clamp(V, plane(msh, 2, -0.5))]
    tool.displacement[2] = -DEPTH
    qs.ContactProblem(elastic(u, E=1e3), u, contact, bcs, linear_solver="direct").solve()
    return contact.force("master")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", default="4,8,12,16", help="cells along a side of the block")
    warnings.simplefilter("ignore")
    lines = ["cells  with walls  bottom alone  sideways %"]
    for n in map(int, parser.parse_args().cells.split(",")):
        whole, bottom = (force(n, closed) for closed in (True, False))
        part = 100 * np.linalg.norm(whole[:2]) / whole[2]
        lines.append(f"{n:5} {whole[2]:11.4g} {bottom[2]:13.4g} {part:11.2g}")
    if WORLD.rank == 0:
        print("\n".join(lines))


if __name__ == "__main__":
    main()
