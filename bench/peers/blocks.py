"""Make blocks of hexahedra for the bodies of the jobs. Nodes, cells and faces count from 0."""

import dataclasses

import numpy as np


@dataclasses.dataclass
class Block:
    """Mesh of hexahedra in rows, columns and layers.

    Attributes:
        x: Coordinates of the nodes, shape (nodes, 3).
        cells: Nodes of each cell: those of its lower face anti-clockwise, then those above them.
        low: Nodes of each quadrilateral of the lowest face, anti-clockwise seen from outside.
        high: Nodes of each quadrilateral of the highest face, in the same way.
        low_cells: Cells behind the lowest face.
        high_cells: Cells behind the highest face.
        planes: Nodes of the quadrilaterals of symmetry planes, by the axis normal to the plane.
    """

    x: np.ndarray
    cells: np.ndarray
    low: np.ndarray
    high: np.ndarray
    low_cells: np.ndarray
    high_cells: np.ndarray
    planes: dict[int, np.ndarray] = dataclasses.field(default_factory=dict)


def block(across, up, symmetric=False):
    """Make a block with the given coordinates.

    Args:
        across: Coordinates of the nodes along x, and along y.
        up: Coordinates along z.
        symmetric: Whether the first planes across x and y are symmetry planes.
    """
    n, layers = len(across) - 1, len(up) - 1
    z, y, x = np.meshgrid(up, across, across, indexing="ij")
    k, j, i = (
        a.ravel() for a in np.meshgrid(np.arange(layers), *[np.arange(n)] * 2, indexing="ij")
    )
    first = (k * (n + 1) + j) * (n + 1) + i
    face = np.array([0, 1, n + 2, n + 1])
    cells = first[:, None] + np.concatenate([face, face + (n + 1) ** 2])
    per_layer = n * n
    return Block(
        np.column_stack([x.ravel(), y.ravel(), z.ravel()]),
        cells,
        cells[:per_layer, 3::-1],
        cells[-per_layer:, 4:],
        np.arange(per_layer),
        np.arange(len(cells) - per_layer, len(cells)),
        {0: cells[i == 0][:, [0, 4, 7, 3]], 1: cells[j == 0][:, [0, 1, 5, 4]]} if symmetric else {},
    )
