"""A spring whose legs are pressed on each other: contact of a surface with itself.

Plane strain, neo-Hookean as in ring.py. The spring is a half ring about the origin with a leg at
each end, to the right of it; legs are bowed towards each other. The face at the end of the lower
leg is clamped. That of the upper one is clamped and moved, down by DOWN in equal steps and then to
the right by ALONG. The whole inner boundary, of both legs and the half ring, is one surface that
may touch itself, without friction or with Coulomb's. Meshes are quadrilaterals of degree 1, legs
have different numbers of cells, so that nodes do not meet.

    python3 bench/peers/spring.py --refine 1      # what the mesh is
"""

import argparse
import dataclasses
import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import ring

#: Inner radius of the half ring, thickness, length of the legs, what the bow narrows the gap by.
INNER, THICK, LENGTH, BOW = 0.5, 0.3, 2.0, 0.25

#: Young's modulus.
E, NU = 1e3, 0.3
#: Coefficient of friction, where there is any.
FRICTION = 0.2

#: What the end is moved by, and in how many steps.
DOWN, DOWN_STEPS = 0.9, 15
ALONG, ALONG_STEPS = 0.2, 5

#: Cells along the lower leg, the half ring and the upper leg, and across, before refinement.
CELLS, ACROSS = (80, 36, 70), 5

#: Share of the greatest force from which on a node counts as closed.
CLOSED = 0.01

HEADER = (
    "     x      y      down    along   contact    rubs     back x   lower y   upper x   upper y"
    " closed  balance   N"
)


@dataclasses.dataclass
class Spring(ring.Body):
    """The spring; held are the nodes of both ends.

    Attributes:
        moved: Nodes of the upper end.
    """

    moved: np.ndarray

    @property
    def fixed(self):
        """Nodes of the lower end."""
        return np.setdiff1d(self.held, self.moved)

    def half(self, sign):
        """Edges that may touch below (-1) or above (1)."""
        return self.touching[sign * self.x[self.touching].mean(axis=1)[:, 1] > 0]


def spring(refine=1):
    """The mesh; cells run from the lower end to the upper one, and from inside to outside."""
    of_lower, of_ring, of_upper = (refine * k for k in CELLS)
    number, cells = ring.lattice(of_lower + of_ring + of_upper, refine * ACROSS)
    lower = LENGTH * np.arange(of_lower, 0, -1) / of_lower
    upper = LENGTH * np.arange(1, of_upper + 1) / of_upper
    angle = -np.pi / 2 - np.pi * np.arange(of_ring + 1) / of_ring
    out = np.linspace(0, THICK, refine * ACROSS + 1)
    x = np.concatenate([leg(lower, out, -1), arc(angle, out), leg(upper, out, 1)]).reshape(-1, 2)
    inside = number[:, 0]
    middle = of_lower // 2, of_lower + of_ring // 2, of_lower + of_ring + of_upper // 2
    names = "lower", "back", "upper"
    return Spring(
        x=x,
        cells=cells,
        touching=np.stack([inside[:-1], inside[1:]], axis=1),
        held=np.concatenate([number[0], number[-1]]),
        tracked={n: int(inside[i]) for n, i in zip(names, middle, strict=True)},
        moved=number[-1],
    )


def leg(x, out, sign):
    """Nodes of the lower (-1) or the upper (1) leg, (n, m, 2)."""
    bow = BOW * (1 - np.cos(np.pi * x / LENGTH) ** 4)
    y = (INNER - bow)[:, None] + out
    return np.stack([np.broadcast_to(x[:, None], y.shape), sign * y], axis=-1)


def arc(angle, out):
    """Nodes of the half ring."""
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return direction[:, None] * (INNER + out)[:, None]


def moduli():
    """μ and λ."""
    return E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))


def path(along=True):
    """Displacements of the upper end, one a step."""
    down = [(0.0, -DOWN * (i + 1) / DOWN_STEPS) for i in range(DOWN_STEPS)]
    right = [(ALONG * (i + 1) / ALONG_STEPS, -DOWN) for i in range(ALONG_STEPS)]
    return down + right * along


def told(body, u, forces):
    """What is told of a state.

    Args:
        body: The spring.
        u: Displacements of its nodes, (n, 2).
        forces: Forces that the stress asks of its nodes.

    Returns:
        By name: ``down`` and ``along``, the force on the moved end; ``contact`` and ``rubs``, the
        same of the contact on the lower half; ``balance``, the greatest component of the forces'
        sum; ``inside``, the greatest force left at a node that nothing touches; the number of
        nodes whose force is more than CLOSED of the greatest; displacements of tracked nodes.
    """
    touching, lower = (np.unique(edges) for edges in (body.touching, body.half(-1)))
    size = np.hypot(*forces[np.setdiff1d(touching, body.held)].T)
    along, down = forces[body.moved].sum(axis=0)
    on_lower = forces[np.setdiff1d(lower, body.held)].sum(axis=0)
    free = np.delete(forces, np.union1d(touching, body.held), axis=0)
    return {
        "down": -down,
        "along": along,
        "contact": -on_lower[1],
        "rubs": on_lower[0],
        "balance": np.abs(forces[body.held].sum(axis=0)).max(),
        "inside": np.abs(free).max(),
        "closed": int((size > max(CLOSED * size.max(), 1e-6)).sum()),
        "tracked": {name: u[node].tolist() for name, node in body.tracked.items()},
    }


def line(ends, row):
    """A line of the table of HEADER."""
    at = row["tracked"]
    return (
        f"{ends[0]:6.2f}{ends[1]:7.2f}{row['down']:10.4f}{row['along']:9.4f}"
        f"{row['contact']:10.4f}{row['rubs']:8.4f}{at['back'][0]:11.5f}{at['lower'][1]:10.5f}"
        f"{at['upper'][0]:10.5f}{at['upper'][1]:10.5f}{row['closed']:7}{row['balance']:9.0e}"
        f"{row['newton']:4}"
    )


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--refine", type=int, default=1, help="all cells are cut by it")
    p = parser.parse_args()
    body = spring(p.refine)
    print(
        f"{len(body.x)} nodes, {len(body.cells)} cells, {len(body.touching)} edges that may "
        f"touch, {len(body.held)} clamped nodes"
    )
    for point, node in body.tracked.items():
        print(f"  {point}: node {node} at {body.x[node, 0]:.6g}, {body.x[node, 1]:.6g}")


if __name__ == "__main__":
    main()
