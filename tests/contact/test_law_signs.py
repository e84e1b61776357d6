"""Signs, slopes and reach of laws of the user's: warnings, and what is legal."""

import warnings

import numpy as np
import pytest
from contact.bond import Bond
from contact.test_memory import OPENING, STRENGTH
from rigid_scenes import Pressed, flat
from scenes import WORLD, box, elastic, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs


class Plain(qs.Law):
    """A law without history, from functions of the gap and of ε."""

    jump, linear = False, False

    def __init__(self, multiplier, slope):
        self.of_gap, self.of_slope = multiplier, slope

    def multiplier(self, gap, penalty):
        return self.of_gap(gap, penalty[:, None])

    def slope(self, gap, penalty, touching):
        return self.of_slope(gap[:, 0], penalty)

    def energy(self, gap, penalty):
        return 0.5 * self.multiplier(gap, penalty)[:, 0] * gap[:, 0]


class Along(Plain):
    """The same for the whole relative displacement."""

    jump = True

    def slope(self, gap, penalty, touching):
        return self.of_slope(gap, penalty)


closed = lambda g, e: np.where(g >= 0, e, 0.0)  # noqa: E731
both = lambda g, e: e + 0.0 * g  # noqa: E731
ever = lambda g, e: e  # noqa: E731

WRONG = {
    "pulls when closed": (Plain(lambda g, e: -e * np.maximum(g, 0), closed), "pulls where surf"),
    "other convention": (
        Plain(lambda g, e: e * np.maximum(-g, 0), lambda g, e: np.where(g < 0, e, 0.0)),
        "presses where surfaces are apart",
    ),
    "adhesion that presses": (
        Plain(lambda g, e: e * np.abs(g), both),
        "grows as surfaces part",
    ),
    "negative slope": (Plain(lambda g, e: e * g, lambda g, e: -e + 0 * g), "slope is negative"),
    "slope ten times": (Plain(lambda g, e: e * g, lambda g, e: 10 * e + 0 * g), "slope is 1e+04"),
    "slope of the penalty": (
        Plain(lambda g, e: e * np.maximum(g, 0) ** 2, closed),
        "the multiplier changes by",
    ),
    "a tie that drives apart": (Along(lambda g, e: -e * g, ever), "drive each other apart"),
}

LEGAL = {
    "penalty": Plain(lambda g, e: e * np.maximum(g, 0), closed),
    "bond that holds": Plain(lambda g, e: e * g, both),
    "bond without pressure": Plain(
        lambda g, e: e * np.minimum(g, 0), lambda g, e: np.where(g < 0, e, 0.0)
    ),
    "pressure at a distance": Plain(
        lambda g, e: 1e-3 * e * np.exp(g / 0.05), lambda g, e: 0.02 * e * np.exp(g / 0.05)
    ),
    "adhesion that softens": Plain(
        lambda g, e: e * g * np.where(g < 0, np.exp(20 * g), 1.0),
        lambda g, e: e * np.where(g < 0, np.exp(20 * g), 1.0),
    ),
    "power law": Plain(
        lambda g, e: e * np.maximum(g, 0) ** 1.5, lambda g, e: 1.5 * e * np.maximum(g, 0) ** 0.5
    ),
    "glue": Along(lambda g, e: e * g, ever),
    "bond that breaks": Bond(STRENGTH, OPENING),
}


def texts_of(law, **options):
    """Texts of warnings of a first solve."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = Pressed("triangle", flat, law=law, **options)
        scene.tool.displacement[-1] = -0.01
        try:
            scene.problem.solve()
            scene.problem.solve()
        except (qs.ConvergenceError, ValueError):  # where the law is wrong
            pass
    return [str(w.message) for w in caught if issubclass(w.category, qs.ContactWarning)]


@pytest.mark.parametrize("case", WRONG)
def test_wrong_law(case):
    """A wrong sign, or a slope that does not belong to the multiplier, is warned of once."""
    law, text = WRONG[case]
    found = [t for t in texts_of(law, name="joint") if "law: " in t]
    assert len(found) == 1 and text in found[0] and found[0].startswith("contact 'joint': law: ")
    assert type(law).__name__ in found[0] and "at gap = " in found[0]


@pytest.mark.parametrize("case", LEGAL)
def test_legal_law(case):
    """Adhesion, and pressures at a distance, are legal, also where they soften."""
    assert texts_of(LEGAL[case]) == []


class Strip:
    """A strip that is peeled off a rigid plate to which it is bonded."""

    def __init__(self, opening, **options):
        msh = box(WORLD, (16, 2), "quadrilateral", [0.0, 0.0], [4.0, 0.1])
        V = vector_space(msh)
        self.u, self.end = fem.Function(V), fem.Constant(msh, np.zeros(2))
        dofs = fem.locate_dofs_topological(V, 1, plane(msh, 0, 4.0))
        plate = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
        surface = qs.Surface(V, facets=plane(msh, 1, 0.0))
        law = Bond(2.0, opening)
        self.contact = qs.Contact(surface, plate, law=law, penalty=200.0, **options)
        bcs = [fem.dirichletbc(self.end, dofs, V)]
        problem = qs.ContactProblem([elastic(self.u, 1e3, 0.0)], [self.u], [self.contact], [bcs])
        drive = lambda t, dt: self.end.value.__setitem__(1, t)  # noqa: E731
        self.stepper = qs.TimeStepper(problem, 0.05, drive, max_penetration=None)

    def work(self):
        """Return the work of the lifted end, and the texts of warnings."""
        work = force = lift = 0.0
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            for _ in self.stepper.run(1.0):
                now, there = -self.contact.force("slave")[1], self.end.value[1]
                work, force, lift = work + (force + now) * (there - lift) / 2, now, there
        return work, [str(w.message) for w in caught if "search_radius" in str(w.message)]


@pytest.mark.parallel
def test_peeling():
    """The search distance follows the law: nothing is lost; a shorter one is warned of once."""
    opening = 0.4  # the default search distance would be a facet, 0.25
    by_default, right, short = (
        Strip(opening),
        Strip(opening, search_radius=2.0),
        Strip(opening, search_radius=0.25),
    )
    assert opening <= by_default.contact.model.settings.reach <= 1.3 * opening
    (work, texts), (expected, none), (lost, once) = (
        strip.work() for strip in (by_default, right, short)
    )
    assert not texts and not none and abs(work / expected - 1) < 1e-9
    assert lost < 0.97 * expected
    assert len(once) == 1 and "give one of at least 0.4" in once[0]
