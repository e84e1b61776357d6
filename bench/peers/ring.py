"""A half ring pressed on a block and drawn along it: large sliding in two dimensions.

Plane strain, both bodies neo-Hookean with the energy

    W = μ/2 (tr C - 2 - 2 ln J) + λ/2 ln² J,   C = FᵀF in the plane, J = det F.

The ring is the lower half of an annulus whose lowest node touches the middle of the block's top, y
= 0. Its two ends are clamped and moved down by DOWN in equal steps, then to the right by ALONG. The
block's bottom is clamped, its sides are free. Contact is unilateral, without friction or with
Coulomb friction; the sides of the block are not part of the contact surface. Meshes are
quadrilaterals of degree 1.

    python3 bench/peers/ring.py --refine 1      # what the meshes are
"""

import argparse
import dataclasses

import numpy as np

#: Dimensions of the ring, about (0, OUTER), and of the block, below y = 0 and symmetric to x = 0.
INNER, OUTER = 0.8, 1.0
WIDTH, HEIGHT = 3.0, 0.6

#: Young's modulus of the ring and of the block.
E, NU = {"ring": 1e3, "block": 3e2}, 0.3
#: Coefficient of friction, if there is friction.
FRICTION = 0.2

#: Displacements of the ends, and numbers of steps.
DOWN, DOWN_STEPS = 0.4, 10
ALONG, ALONG_STEPS = 0.3, 6

#: Cells along and across the ring, and along and across the block, before refinement.
CELLS = {"ring": (64, 4), "block": (48, 10)}


@dataclasses.dataclass
class Body:
    """A body: node coordinates, and its sets of node numbers.

    Attributes:
        x: Coordinates of nodes, (n, 2).
        cells: Nodes of quadrilaterals, counterclockwise, (m, 4).
        touching: Nodes of the edges that may come into contact, in the direction with the body on
            its left.
        held: Nodes that are clamped.
        tracked: Nodes whose displacements are reported, by name.
    """

    x: np.ndarray
    cells: np.ndarray
    touching: np.ndarray
    held: np.ndarray
    tracked: dict


def lattice(n, m):
    """Return the numbers of the nodes of n times m cells, (n + 1, m + 1), and the cells."""
    number = np.arange((n + 1) * (m + 1)).reshape(n + 1, m + 1)
    corners = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    return number, np.stack([c.ravel() for c in corners], axis=1)


def ring(refine=1):
    """Make the half ring; cells run from its left to its right end, and from outside to inside."""
    n, m = (refine * k for k in CELLS["ring"])
    number, cells = lattice(n, m)
    angle = np.pi * (1 + np.arange(n + 1) / n)
    radius = np.linspace(OUTER, INNER, m + 1)
    # Both halves are exact mirror images, and the lowest node is on the block.
    cos = np.cos(angle)
    cos = (cos - cos[::-1]) / 2
    sin = np.sin(angle)
    sin = (sin + sin[::-1]) / 2
    sin[[0, -1]] = 0
    x = np.stack([np.outer(cos, radius), OUTER + np.outer(sin, radius)], axis=-1).reshape(-1, 2)
    outside = number[:, 0]
    return Body(
        x=x,
        cells=cells,
        touching=np.stack([outside[:-1], outside[1:]], axis=1),
        held=np.concatenate([number[0], number[-1]]),
        tracked={"ring_outside": int(number[n // 2, 0]), "ring_inside": int(number[n // 2, -1])},
    )


def block(refine=1):
    """Make the block; cells run from left to right, and from the bottom to the top."""
    n, m = (refine * k for k in CELLS["block"])
    number, cells = lattice(n, m)
    across, up = WIDTH * np.arange(-n, n + 1, 2) / (2 * n), HEIGHT * np.arange(-m, 1) / m
    x = np.stack(np.meshgrid(across, up, indexing="ij"), axis=-1).reshape(-1, 2)
    top = number[::-1, -1]
    return Body(
        x=x,
        cells=cells,
        touching=np.stack([top[:-1], top[1:]], axis=1),
        held=number[:, 0],
        tracked={
            "block_middle": int(number[n // 2, -1]),
            "block_left": int(number[n // 3, -1]),
            "block_right": int(number[n - n // 3, -1]),
            "block_inside": int(number[n // 2, m // 2]),
        },
    )


def bodies(refine=1):
    """Make both bodies, by name."""
    return {"ring": ring(refine), "block": block(refine)}


def moduli(name):
    """Return μ and λ of a body."""
    return E[name] / (2 * (1 + NU)), E[name] * NU / ((1 + NU) * (1 - 2 * NU))


def path(along=True):
    """Return the displacements of the ring's ends, one per step."""
    down = [(0.0, -DOWN * (i + 1) / DOWN_STEPS) for i in range(DOWN_STEPS)]
    right = [(ALONG * (i + 1) / ALONG_STEPS, -DOWN) for i in range(ALONG_STEPS)]
    return down + right * along


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--refine", type=int, default=1, help="refinement factor of all cells")
    p = parser.parse_args()
    for name, body in bodies(p.refine).items():
        print(
            f"{name}: {len(body.x)} nodes, {len(body.cells)} cells, "
            f"{len(body.touching)} edges that may touch, {len(body.held)} clamped nodes"
        )
        for point, node in body.tracked.items():
            print(f"  {point}: node {node} at {body.x[node, 0]:.6g}, {body.x[node, 1]:.6g}")


if __name__ == "__main__":
    main()
