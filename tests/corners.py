"""A block in the inner corner of a body with several walls."""

import numpy as np
import scenes

from dolfinx import fem, mesh

import qsdolfinx as qs

#: Distance by which the block is pressed against each wall.
PRESS = 0.02

#: Default options of the contacts.
AT_NODES = {"quadrature": "nodal", "enforcement": "penalty", "penalty": 50.0}


def boundary(msh, where):
    return mesh.locate_entities_boundary(msh, msh.topology.dim - 1, where)


def on_wall(axis, value=0.0):
    return lambda x: np.isclose(x[axis], value)


def corner_mesh(cell, n, walls, partition, comm=scenes.WORLD):
    """Mesh [-1, 1]^d without the part in which the first ``walls`` coordinates are positive."""
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    whole = scenes.box(comm, [2 * n] * gdim, cell, [-1.0] * gdim, [1.0] * gdim, partition)
    whole.topology.create_connectivity(gdim, 0)
    local = whole.topology.index_map(gdim).size_local
    middle = mesh.compute_midpoints(whole, gdim, np.arange(local, dtype=np.int32))
    kept = np.flatnonzero(np.any(middle[:, :walls] < 0, axis=1)).astype(np.int32)
    return mesh.create_submesh(whole, gdim, kept)[0]


def turned(x, angle):
    """Rotate points or vectors in the plane of the first two axes."""
    out, (c, s) = np.array(x, dtype=np.float64), (np.cos(angle), np.sin(angle))
    out[..., 0], out[..., 1] = c * x[..., 0] - s * x[..., 1], s * x[..., 0] + c * x[..., 1]
    return out


class InCorner:
    """A block in a corner of two or three walls, pressed against each by ``PRESS``.

    Args:
        cell: Cell type of both meshes.
        walls: Number of walls; in 3D two walls form an edge.
        n: Numbers of cells along the edges of the corner's walls and of the block.
        master: ``"elastic"``, or ``"rigid"`` for a tool made of the facets of the walls.
        named: Whether each wall and the opposite face form a separate contact.
        block_first: Whether the block is the slave.
        press: Distance by which the block is pressed, for each wall.
        gap: Gap between the block and each wall.
        angle: Angle by which both bodies are rotated; their far faces are then held in all
            components.
        options: Options of the contacts; by default they have penalties at nodes.
    """

    def __init__(
        self,
        cell="quadrilateral",
        walls=2,
        n=(3, 4),
        master="elastic",
        named=False,
        block_first=True,
        press=PRESS,
        angle=0.0,
        gap=0.0,
        partitions=("scattered", "backward"),
        formulation="master-slave",
        **options,
    ):
        comm = scenes.WORLD
        gdim = 2 if cell in ("triangle", "quadrilateral") else 3
        corner = corner_mesh(cell, n[0], walls, partitions[0])
        gap = np.broadcast_to(gap, walls)
        low = [gap[i] if i < walls else -0.8 for i in range(gdim)]
        high = [0.8] * gdim
        self.block = block = scenes.box(comm, [n[1]] * gdim, cell, low, high, partitions[1])
        self.gdim, self.walls, self.block_first = gdim, walls, block_first
        press = np.broadcast_to(press, walls)

        def inner(i):
            return lambda x: np.isclose(x[i], 0) & np.all(x[:walls] > -1e-9, axis=0)

        on_corner = [boundary(corner, inner(i)) for i in range(walls)]
        on_block = [boundary(block, on_wall(i, gap[i])) for i in range(walls)]
        far = [boundary(corner, on_wall(i, -1.0)) for i in range(walls)]
        pushed = [boundary(block, on_wall(i, 0.8)) for i in range(walls)]
        ends = [
            (boundary(corner, on_wall(i, -1.0)), boundary(block, on_wall(i, -0.8)))
            for i in range(walls, gdim)
        ]
        for msh in (corner, block):
            msh.geometry.x[:] = turned(msh.geometry.x, angle)
        self.V = [scenes.vector_space(msh) for msh in (corner, block)]
        self.u = [fem.Function(V) for V in self.V]
        self.F = [scenes.elastic(u, E) for u, E in zip(self.u, (2.0, 1.0), strict=True)]
        if angle == 0.0:
            self.bcs = [
                [scenes.slide(self.V[0], i, far[i]) for i in range(walls)],
                [scenes.slide(self.V[1], i, pushed[i], -press[i]) for i in range(walls)],
            ]
            for i, pair in enumerate(ends, walls):
                for V, bcs, facets in zip(self.V, self.bcs, pair, strict=True):
                    bcs.append(scenes.slide(V, i, facets))
        else:
            way = turned(-np.pad(press, (0, 3 - walls)), angle)[:gdim]
            self.bcs = [
                [scenes.clamp(self.V[0], np.unique(np.concatenate(far)))],
                [scenes.clamp(self.V[1], np.unique(np.concatenate(pushed)), way)],
            ]
        inside = turned(-0.5 * np.ones(gdim), angle)
        groups = [[i] for i in range(walls)] if named else [range(walls)]
        self.contacts = []
        for group in groups:
            walls_of, faces = (
                np.unique(np.concatenate([facets[i] for i in group]))
                for facets in (on_corner, on_block)
            )
            two = qs.Surface(self.V[1], facets=faces)
            if master == "rigid":
                part = mesh.create_submesh(corner, gdim - 1, walls_of)[0]
                one = qs.RigidSurface.from_mesh(part, inside)
            else:
                one = qs.Surface(self.V[0], facets=walls_of)
            slave, other = (two, one) if block_first else (one, two)
            self.contacts.append(
                qs.Contact(slave, other, formulation=formulation, **(AT_NODES | options))
            )
        if master == "rigid":
            self.V, self.u, self.F, self.bcs = ([x[1]] for x in (self.V, self.u, self.F, self.bcs))

    def solve(self, **options):
        problem = qs.ContactProblem(self.F, self.u, self.contacts, self.bcs, **options)
        problem.solve()
        return problem

    def forces(self):
        """Return the total force on the block."""
        side = "slave" if self.block_first else "master"
        return sum(contact.force(side) for contact in self.contacts)

    def num_corners(self):
        """Return the nodes of this rank in corners."""
        return sum(gap.points.num_corners for c in self.contacts for gap in c.model.gaps)
