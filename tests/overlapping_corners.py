"""A block whose corner overlaps a corner of another; all faces near them are in contact."""

import numpy as np
from scenes import WORLD, box, clamp, elastic, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs

CELL = {2: "quadrilateral", 3: "hexahedron"}


def turned(x, angle):
    """Rotate points in the plane of the first and the last axis."""
    out, last = np.array(x), x.shape[1] - 1
    c, s = np.cos(angle), np.sin(angle)
    out[:, 0], out[:, last] = c * x[:, 0] - s * x[:, last], s * x[:, 0] + c * x[:, last]
    return out


class Corners:
    """A block from [-1, 0, -1] to [1, 1, 0], and a unit block on its top beyond its right side.

    Args:
        width: Overlap along the first axis (length).
        depth: Overlap along the last axis.
        gdim: Dimension of space.
        sides: Whether the faces beside the overlap belong to the surfaces, too.
        n: Numbers of cells along an edge of length 2 of the first block, and of length 1 of the
            second.
        partition: Partition of the cells.
        angle: Angle by which everything is rotated.
        options: Options of the contact.
    """

    def __init__(self, width, depth=0.0, gdim=2, sides=True, n=(6, 7), angle=0.0, **options):
        up, mid, cell = gdim - 1, [0.0] * (gdim - 2), CELL[gdim]
        one = [1.0] * (gdim - 2)
        counts = [[n[0], *[2] * (gdim - 2), n[0]], [n[1], *[3] * (gdim - 2), n[1]]]
        lower = box(WORLD, counts[0], cell, [-1.0, *mid, -1.0], [1.0, *one, 0.0], "scattered")
        low = [1.0 - width, *mid, -depth]
        high = [2.0 - width, *one, 1.0 - depth]
        upper = box(WORLD, counts[1], cell, low, high, "backward")
        self.faces = [
            np.unique(np.concatenate([plane(msh, axis, at) for axis, at in named]))
            for msh, named in (
                (lower, [(up, 0.0), (0, 1.0)][: 1 + sides]),
                (upper, [(up, -depth), (0, 1.0 - width)][: 1 + sides]),
            )
        ]
        held = plane(lower, up, -1.0), plane(upper, up, 1.0 - depth)
        self.axis = turned(np.eye(gdim)[[up]], angle)[0]
        for msh in (lower, upper):
            msh.geometry.x[:, :gdim] = turned(msh.geometry.x[:, :gdim], angle)
        V = [vector_space(msh) for msh in (lower, upper)]
        self.u = [fem.Function(v) for v in V]
        self.pressed = fem.Constant(upper, np.zeros(gdim))
        dofs = fem.locate_dofs_topological(V[1], up, held[1])
        bcs = [[clamp(V[0], held[0])], [fem.dirichletbc(self.pressed, dofs, V[1])]]
        surfaces = [qs.Surface(v, facets=f) for v, f in zip(V, self.faces, strict=True)]
        self.contact = qs.Contact(surfaces[1], surfaces[0], **options)
        self.bcs = bcs

    def problem(self):
        """Make both blocks elastic, with the same material."""
        return qs.ContactProblem([elastic(u) for u in self.u], self.u, [self.contact], self.bcs)

    def press(self, steps, step=0.004):
        """Return forces on the upper block across and along the axis, and depths, for each step."""
        problem, out = self.problem(), []

        def drive(t, dt):
            self.pressed.value[:] = -step * t * self.axis

        for _ in qs.TimeStepper(problem, 1.0, drive).run(float(steps)):
            force = self.contact.force("slave")
            along = force @ self.axis
            across = np.linalg.norm(force - along * self.axis)
            out.append((across, along, self.contact.penetration()))
        problem.destroy()
        return np.array(out)
