"""A block with a slot or a closed slit, whose two arms come into contact."""

import numpy as np
from following import Body, create, problem_of
from scenes import plane

import qsdolfinx as qs

#: Width of the root that joins the arms; length and height of each arm; depth in 3D.
ROOT, LENGTH, HEIGHT, DEPTH = 0.3, 1.2, 0.4, 0.5

#: Simplices of a square and of a cube along the diagonals; corners in tensor order.
TRIANGLES = [(0, 1, 3), (0, 2, 3)]
TETRAHEDRA = [
    (0, 1, 3, 7), (0, 1, 5, 7), (0, 2, 3, 7), (0, 2, 6, 7), (0, 4, 5, 7), (0, 4, 6, 7),
]  # fmt: skip


def slotted_mesh(cell, n=(5, 7), rows=2, gap=0.0, across=2):
    """Mesh two arms that do not match, of n cells each from ROOT to LENGTH; across cells in depth.

    The slot is from y = 0 to y = gap; gap = 0 makes a slit.
    """
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    root, numbers, x, cells = np.linspace(0, ROOT, 3), {}, [], []
    levels = {"lower": np.linspace(-HEIGHT, 0, rows + 1)}
    levels["upper"] = gap + HEIGHT + levels["lower"]
    depth = np.linspace(0, DEPTH, across + 1) if gdim == 3 else np.zeros(1)

    def number(p, arm):
        on_face = p[0] > ROOT + 1e-9 and 0 - 1e-9 < p[1] < gap + 1e-9
        key = (*np.round(p, 9), arm if on_face else "")
        if key not in numbers:
            numbers[key] = len(x)
            x.append(p[:gdim])
        return numbers[key]

    def fill(xs, ys, arm):
        for a in range(len(xs) - 1):
            for b in range(len(ys) - 1):
                for c in range(max(len(depth) - 1, 1)):
                    corners = [
                        number((xs[a + i], ys[b + j], depth[c + k]), arm)
                        for k in range(gdim - 1)
                        for j in (0, 1)
                        for i in (0, 1)
                    ]
                    cells.append(corners)

    for arm, count in zip(levels, n, strict=True):
        fill(root, levels[arm], arm)
        fill(np.linspace(ROOT, LENGTH, count + 1), levels[arm], arm)
    if gap > 0:
        fill(root, np.array([0.0, gap]), "")
    cells = np.array(cells)
    if cell in ("triangle", "tetrahedron"):
        cells = cells[:, TRIANGLES if gdim == 2 else TETRAHEDRA].reshape(-1, gdim + 1)
    return create(cell, np.array(x), cells)


class Slotted:
    """The block, clamped at its bottom; with a slot the top is clamped, too, and can be moved."""

    def __init__(self, cell="quadrilateral", gap=0.1, degree=1, **options):
        self.mesh = slotted_mesh(cell, gap=gap, **options)
        self.body = Body(self.mesh, degree)
        self.gap, self.gdim = gap, self.body.gdim
        self.bottom, self.top = (plane(self.mesh, 1, y) for y in (-HEIGHT, gap + HEIGHT))
        if gap > 0:
            self.body.clamp(self.bottom)
            self.moved = self.body.clamp(self.top)

    def face(self, y):
        """Return the facets of the slot at a height."""
        return self.body.boundary(
            lambda x: np.isclose(x[1], y) & (x[0] > ROOT - 1e-9) & (np.abs(x[1]) < HEIGHT / 2)
        )

    @property
    def every(self):
        """All facets of the boundary."""
        return self.body.boundary(lambda x: np.full(x.shape[1], True))

    def itself(self, facets=None, **options):
        """Make the self-contact of some facets, by default of both faces of the slot."""
        if facets is None:
            facets = np.union1d(self.face(0.0), self.face(self.gap))
        surface = self.body.surface(facets)
        return qs.Contact(surface, surface, **options)

    def of_two(self, **options):
        """Make the contact of the two faces as two surfaces; the lower one is the slave."""
        slave, master = (self.body.surface(self.face(y)) for y in (0.0, self.gap))
        return qs.Contact(slave, master, **options)

    def problem(self, contact, **options):
        return problem_of([self.body], [contact], **options)
