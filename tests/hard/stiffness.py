"""Case 1: bodies and penalties that are stiff or soft, nearly incompressible, and other units."""

import numpy as np
from hard.scenes import Body, Check, Column, Wrong, largest, problem, solve

import qsdolfinx as qs

PRESSURE = 1e-3
RATIOS = (1.0, 1e4, 1e8, 1e-4, 1e-8)
FACTORS = (1e-2, 1.0, 1e2, 1e4, 1e6, 1e8)
#: Units: name, their number in a metre; E is 210 GPa in newtons per unit².
UNITS = {"mm": 1e3, "µm": 1e6}


def column(variant, **options):
    """Uniform pressure, and how far the upper end comes down, which the overlay has exactly."""
    if variant.augmented:  # what the gap's tolerance leaves is of no interest here
        options["gap_tolerance"] = 1e-11
    softer = min(1.0, options.get("ratio", 1.0))
    scene = Column(variant, **options)
    pressure = PRESSURE * softer
    scene.press(pressure)
    iterations = solve(scene.problem())
    errors = [scene.error(pressure)]
    if variant.quadrature == "overlay":
        down = largest(scene.upper.u.x.array)
        errors.append(abs(down / (pressure * scene.compliance()) - 1))
    return max(errors), iterations


class Punch:
    """A curved punch that is pressed into a block by a displacement of its upper end.

    Args:
        variant: What it is solved with.
        unit: Length of a metre.
        E: Of the block in newtons per metre²; the punch has twice as much.
        n: Cells along the block and the punch.
        options: For the contact.
    """

    def __init__(self, variant, unit=1.0, E=1.0, n=((32, 12), (12, 6)), depth=0.1, **options):
        L, E = unit, E / unit**2
        self.unit, self.E = unit, E
        self.block = Body(n[0], [-4 * L, -4 * L], [4 * L, 0.0], E)
        self.punch = Body(n[1], [-2 * L, 0.0], [2 * L, 2 * L], 2 * E)
        self.bodies = (self.block, self.punch)
        near, top = self.punch.facets(1, 0.0), self.punch.facets(1, 2 * L)
        self.block.clamp(self.block.facets(1, -4 * L))
        self.punch.slide(0, top)
        self.height = self.punch.slide(1, top, -depth * L)
        self.punch.move(lambda x, y: np.stack([0 * x, x**2 / (16 * L) * (1 - y / (2 * L))], axis=1))
        options = {"search_radius": L} | variant.options | options
        master = self.block.surface(1, 0.0)
        self.contact = qs.Contact(qs.Surface(self.punch.V, facets=near), master, **options)

    def problem(self, **options):
        self.made = problem(self.bodies, [self.contact], **options)
        return self.made

    def state(self):
        """Displacements over the unit, and forces over E and the unit. Collective."""
        forces = self.contact.force("slave") / (self.E * self.unit)
        return [b.u.x.array / self.unit for b in self.bodies] + [forces]


def in_units(variant, name):
    """The punch, in metres and in another unit."""
    found = []
    for unit in (1.0, UNITS[name]):
        scene = Punch(variant, unit, 210e9)
        found.append((scene, solve(scene.problem())))
    (metres, count), (other, iterations) = found
    if iterations != count:
        raise Wrong(f"{count} Newton iterations in metres, {iterations} in {name}")
    size = largest(*metres.state()[:2])
    first, second = metres.state(), other.state()
    error = largest(*(a - b for a, b in zip(first[:2], second[:2], strict=True))) / size
    return max(error, largest(first[2] - second[2]) / largest(first[2])), iterations


def checks(variant):
    what = "traction, shortening" if variant.quadrature == "overlay" else "force"
    for ratio in RATIOS:
        yield Check(
            "1 stiffness",
            f"E of the slave / master {ratio:.0e}",
            what,
            max(1e-8, 1e-14 * ratio),  # the condition number times the rounding unit
            lambda r=ratio: column(variant, ratio=r),
        )
    for factor in FACTORS:
        yield Check(
            "1 stiffness",
            f"penalty {factor:.0e} E/h",
            what,
            1e-7,
            lambda f=factor: column(variant, penalty=5 * f),
        )
    yield Check("1 stiffness", "nu = 0.4999", what, 1e-8, lambda: column(variant, nu=0.4999))
    for name in UNITS:
        yield Check(
            "1 stiffness",
            f"{name} against metres",
            "displacements, force",
            1e-8,
            lambda n=name: in_units(variant, n),
        )
