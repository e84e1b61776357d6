"""A spring whose legs are pressed on each other: self-contact of a surface.

Plane strain, neo-Hookean as in ring.py. The spring is a half ring about the origin with a leg at
each end, to the right of it; legs are bowed towards each other. The face at the end of the lower
leg is clamped. The face at the end of the upper leg is clamped and moved, down by DOWN in equal
steps and then to the right by ALONG. The whole inner boundary, of both legs and the half ring, is
one surface in self-contact, without friction or with Coulomb friction. Meshes are quadrilaterals of
degree 1; the legs have different numbers of cells, so that nodes do not coincide.

    python3 bench/peers/spring.py --refine 1      # what the mesh is
"""

import argparse
import dataclasses
import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import ring

#: Inner radius of the half ring, thickness, length of the legs, reduction of the gap by the bow.
INNER, THICK, LENGTH, BOW = 0.5, 0.3, 2.0, 0.25

#: Young's modulus.
E, NU = 1e3, 0.3
#: Coefficient of friction, if there is friction.
FRICTION = 0.2

#: Displacements of the end, and numbers of steps.
DOWN, DOWN_STEPS = 0.9, 15
ALONG, ALONG_STEPS = 0.2, 5

#: Cells along the lower leg, the half ring and the upper leg, and across, before refinement.
CELLS, ACROSS = (80, 36, 70), 5

#: Fraction of the largest force above which a node counts as active.
CLOSED = 0.01

HEADER = (
    "     x      y      down    along   contact    rubs     back x   lower y   upper x   upper y"
    " closed  balance   N"
)


@dataclasses.dataclass
class Spring(ring.Body):
    """The spring; the held nodes are those of both ends.

    Attributes:
        moved: Nodes of the upper end.
    """

    moved: np.ndarray

    @property
    def fixed(self):
        """Return the nodes of the lower end."""
        return np.setdiff1d(self.held, self.moved)

    def half(self, sign):
        """Return the edges of the contact surface below (-1) or above (1)."""
        return self.touching[sign * self.x[self.touching].mean(axis=1)[:, 1] > 0]


def spring(refine=1):
    """Make the mesh; cells run from the lower to the upper end, and from inside to outside."""
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
    """Return the nodes of the lower (-1) or the upper (1) leg, (n, m, 2)."""
    bow = BOW * (1 - np.cos(np.pi * x / LENGTH) ** 4)
    y = (INNER - bow)[:, None] + out
    return np.stack([np.broadcast_to(x[:, None], y.shape), sign * y], axis=-1)


def arc(angle, out):
    """Return the nodes of the half ring."""
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return direction[:, None] * (INNER + out)[:, None]


def moduli():
    """Return μ and λ."""
    return E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))


def path(along=True):
    """Return the displacements of the upper end, one per step."""
    down = [(0.0, -DOWN * (i + 1) / DOWN_STEPS) for i in range(DOWN_STEPS)]
    right = [(ALONG * (i + 1) / ALONG_STEPS, -DOWN) for i in range(ALONG_STEPS)]
    return down + right * along


def told(body, u, forces):
    """Return the results of a state.

    Args:
        body: The spring.
        u: Displacements of its nodes, (n, 2).
        forces: Nodal forces of the stress.

    Returns:
        By name: ``down`` and ``along``, the force on the moved end; ``contact`` and ``rubs``, the
        normal and tangential contact force on the lower half; ``balance``, the largest component of
        the forces' sum; ``inside``, the largest residual force at a node without contact and
        conditions; the number of nodes whose force is more than CLOSED of the largest;
        displacements of tracked nodes.
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
    """Format a line of the table of HEADER."""
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
    parser.add_argument("--refine", type=int, default=1, help="refinement factor of all cells")
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
