"""Case 7: bodies that only contact supports, one or two of them in a stack of three."""

import numpy as np
from hard.bodies import problem, rectangle, solve
from hard.cases import SHORT, Case, Variant

import qsdolfinx as qs

PRESSURE = 1e-3


class Stack:
    """A clamped base and two blocks on top of it, which only frictionless contact supports.

    Args:
        variant: Variant of contact.
        half: Half the width of the upper block.
        cells: Number of cells of the upper block along its width.
        gap: Gap between each two blocks.
    """

    def __init__(self, variant, half=0.75, cells=5, gap=0.0):
        self.bodies = base, middle, self.upper = (
            rectangle((14, 4), [-2.0, -1.0], [2.0, 0.0]),
            rectangle((6, 3), [-1.0, 0.0], [1.0, 1.0], 2.0),
            rectangle((cells, 3), [-half, 1.0], [half, 2.0], 0.5),
        )
        base.hold(base.facets(1, -1.0))
        faces = [(b.facets(1, b.low[1]), b.facets(1, b.high[1])) for b in self.bodies]
        self.top = faces[2][1]
        for i, body in enumerate(self.bodies):
            body.move(lambda x, y, d=i * gap: np.stack([0 * x, d + 0 * y], axis=1))
        pairs = [
            (qs.Surface(slave.V, facets=faces[i + 1][0]), qs.Surface(master.V, facets=faces[i][1]))
            for i, (master, slave) in enumerate(((base, middle), (middle, self.upper)))
        ]
        self.contacts = [qs.Contact(*pair, **variant.options) for pair in pairs]
        self.load = np.zeros(3)
        self.y = 2.0 + 2 * gap

    def press(self, first, last, traction=(0.0, -PRESSURE)):
        """Load the upper block's upper end between two values of x."""

        def where(x):
            return (x[0] > first - 1e-9) & (x[0] < last + 1e-9)

        self.upper.load(self.upper.facets(1, self.y, where), traction)
        force = np.array(traction) * (last - first)
        self.load = np.append(force, 0.5 * (first + last) * force[1] - self.y * force[0])

    def error(self):
        """Solve; return the imbalance of the forces and moments on the bodies. Collective."""
        solve(problem(self.bodies, self.contacts))
        lower, upper = (
            {
                side: np.append(contact.force(side), contact.moment(side, np.zeros(2)))
                for side in ("slave", "master")
            }
            for contact in self.contacts
        )
        rests = [upper["master"] + lower["slave"]]
        if np.any(self.load):  # otherwise it is held
            rests.append(upper["slave"] + self.load)
        return np.abs(rests).max() / np.abs([upper["slave"], self.load]).max()


def pushed(variant, gap):
    """One free body: the upper block's end comes down by more than both gaps."""
    scene = Stack(variant, gap=gap)
    scene.upper.hold(scene.top, axis=0)
    scene.upper.hold(scene.top, -2 * gap - 0.02, axis=1)
    return scene.error()


def pressed(variant, gap, first, last):
    """Two free bodies under a pressure on all or on a part of the end."""
    scene = Stack(variant, gap=gap)
    scene.press(first, last)
    return scene.error()


def unbalanced(variant, kind):
    """Loads that contact cannot balance."""
    if kind == "toppling":
        scene = Stack(variant, half=1.75, cells=7)
        scene.press(1.25, 1.75)
    else:
        scene = Stack(variant)
        scene.press(-0.75, 0.75, {"sideways": (1e-4, -1e-3), "upwards": (0.0, 1e-3)}[kind])
    return scene.error()


def cases(variant):
    name, what = "7 free bodies", "equilibrium"
    for gap in (0.0, 0.1):
        for label, run, *where in (
            ("one, pushed", pushed),
            ("two, pressed", pressed, -0.75, 0.75),
            ("two, off centre", pressed, 0.15, 0.75),
        ):
            yield Case(
                name,
                f"{label}, gaps of {gap:g}",
                what,
                1e-7,
                lambda run=run, given=(gap, *where): run(variant, *given),
                short=variant in SHORT,
            )
    for kind in ("sideways", "upwards", "toppling"):
        yield Case(
            name,
            f"load that nothing balances, {kind}",
            what,
            0.0,
            lambda k=kind: unbalanced(variant, k),
            short=variant == Variant(),
            refusal="did not converge",
        )
