"""The job that every program gets: two unit cubes of hexahedra, one pressed on the other.

The lower cube is [0, 1]³, the upper [0, 1]² × [1, 2]; their meshes do not match. The bottom face is
clamped, and so is the top face, at u_z = PRESS. Contact is unilateral, without friction. Numbers of
nodes, cells and faces start at 0.
"""

import dataclasses
import json

import numpy as np

E = 3e4, 1.3e4  # of the lower and the upper cube
NU = 0.3
PRESS = -0.02


@dataclasses.dataclass
class Cube:
    """Mesh of n³ hexahedra.

    Attributes:
        x: Coordinates of the nodes, shape (nodes, 3).
        cells: Nodes of each cell: those of its lower face anti-clockwise, then those above them.
        low: Nodes of each quadrilateral of the lowest face, anti-clockwise seen from outside.
        high: The same of the highest face.
        low_cells: Cells behind those faces.
        high_cells: The same.
    """

    x: np.ndarray
    cells: np.ndarray
    low: np.ndarray
    high: np.ndarray
    low_cells: np.ndarray
    high_cells: np.ndarray


def cube(n, bottom):
    """The unit cube that stands on the height `bottom`."""
    s = np.linspace(0, 1, n + 1)
    z, y, x = np.meshgrid(s + bottom, s, s, indexing="ij")
    k, j, i = (a.ravel() for a in np.meshgrid(*[np.arange(n)] * 3, indexing="ij"))
    first = (k * (n + 1) + j) * (n + 1) + i
    face = np.array([0, 1, n + 2, n + 1])
    cells = first[:, None] + np.concatenate([face, face + (n + 1) ** 2])
    per_layer = n * n
    return Cube(
        np.column_stack([x.ravel(), y.ravel(), z.ravel()]),
        cells,
        cells[:per_layer, 3::-1],
        cells[-per_layer:, 4:],
        np.arange(per_layer),
        np.arange(len(cells) - per_layer, len(cells)),
    )


def unknowns(sizes):
    """Displacements of both cubes, held ones included."""
    return sum(3 * (n + 1) ** 3 for n in sizes)


def penalty(sizes, factor):
    """Penalty, stress per length: `factor` times E of the stiffer cube over h of the upper one."""
    return factor * max(E) * sizes[1]


def report(**row):
    """Print what the bench reads."""
    print("RESULT " + json.dumps(row), flush=True)
