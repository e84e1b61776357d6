"""Sharp corners in 2D on facets that are coarse for them: what they cost, and warnings."""

import re
import warnings

import numpy as np
import pytest
from following import Body, problem_of
from scenes import WORLD, box, plane

import ufl
from dolfinx import fem

import qsdolfinx as qs

RIGHT_ANGLE = [[-0.6, 0.6], [0.0, 0.0], [0.6, 0.6]]
#: A flat end that is 0.8 facets of the coarse mesh wide.
FLAT = [[-0.7, 0.6], [-0.1, 0.0], [0.1, 0.0], [0.7, 0.6]]


#: A flat end that is 4.8 facets of a mesh of 16 wide.
WIDE = [[-0.9, 0.6], [-0.3, 0.0], [0.3, 0.0], [0.9, 0.6]]


def wedge(angle):
    """A wedge with faces inclined by an angle (degrees)."""
    rise = 0.6 * np.tan(np.radians(angle))
    return [[-0.6, rise], [0.0, 0.0], [0.6, rise]]


def rounded(radius, turn=10.0):
    """The right angle with a rounding in segments that turn by some degrees at most."""
    angle = np.radians(np.linspace(-45.0, 45.0, int(np.ceil(90 / turn)) + 1))
    arc = radius * np.column_stack([np.sin(angle), 1 - np.cos(angle)])
    end = arc[-1] + 0.6
    return [[-end[0], end[1]], *arc, end]


class Pressed:
    """Linear elastic block, on top of which a tool is moved in time steps."""

    def __init__(self, corners, n=8, degree=1, middle=0.0, **options):
        self.size = 2 / n
        msh = box(WORLD, (n, n // 2), "quadrilateral", [-1.0, -1.0], [1.0, 0.0])
        V = fem.functionspace(msh, ("Lagrange", degree, (2,)))
        self.u = fem.Function(V)
        stress = qs.materials.linear_elastic(self.u, 1e3, 0.3)
        strain = ufl.sym(ufl.grad(self.u))
        self.energy = fem.form(0.5 * ufl.inner(stress, strain) * ufl.dx)
        F = ufl.inner(stress, ufl.grad(ufl.TestFunction(V))) * ufl.dx
        bottom = fem.locate_dofs_topological(V, 1, plane(msh, 1, -1.0))
        bc = fem.dirichletbc(np.zeros(2), bottom, V)
        ends = [[i, i + 1] for i in range(len(corners) - 1)]
        at = np.add(corners, [middle * self.size, 0.0])
        self.tool = qs.RigidSurface.triangulated(WORLD, at, ends)
        options = {"sliding": "finite"} | options
        self.contact = qs.Contact(qs.Surface(V, facets=plane(msh, 1, 0.0)), self.tool, **options)
        self.problem = qs.ContactProblem(F, self.u, self.contact, [bc])

    def move(self, *places):
        """Move the tool to these places, one for each step.

        Returns:
            Forces on the block, and the elastic energies, at these places.
        """
        way = np.vstack([np.zeros(2), *places])

        def drive(t, dt):
            now, before = (
                [np.interp(time, np.arange(len(way)), x) for x in way.T] for time in (t, t - dt)
            )
            self.tool.displacement = np.subtract(now, before)

        forces, energies = [], []
        for _ in qs.TimeStepper(self.problem, 1.0, drive, dt_max=1.0).run(len(way) - 1.0):
            forces.append(self.contact.force("slave"))
            energies.append(WORLD.allreduce(fem.assemble_scalar(self.energy)))
        return np.array(forces), np.array(energies)


def texts_of(scene, *places):
    """Forces at some places, and the warnings about corners of tools."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        forces = scene.move(*places)[0]
    texts = [str(one.message) for one in caught]
    return forces, [text for text in texts if "the tool" in text]


def cycle(corners, n=16, depth=0.8):
    """Press a corner on a node, drag it to the middle of a facet, and lift it.

    Returns:
        Largest difference between work and elastic energy, and range of the forces down in the
        drag over their mean; the warnings.
    """
    scene = Pressed(corners, n)
    down = [[0.0, -depth * part] for part in np.linspace(0.0, 1.0, 9)[1:]]
    along = [[part, -depth] for part in np.linspace(0.0, 0.5, 11)[1:]]
    up = [[0.5, -depth * part] for part in np.linspace(1.0, 0.0, 9)[1:]]
    places = scene.size * np.array(down + along + up)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        forces, energies = scene.move(*places)
    ways = np.diff(places, axis=0, prepend=0.0)
    means = forces - 0.5 * np.diff(forces, axis=0, prepend=0.0)
    lost = np.cumsum(np.sum(means * ways, axis=1)) - energies
    dragged = np.abs(forces[len(down) - 1 : -len(up), 1])
    texts = [str(one.message) for one in caught]
    return np.abs(lost).max() / energies.max(), np.ptp(dragged) / dragged.mean(), texts


@pytest.mark.parallel
def test_energy_of_a_cycle():
    """The work on a sharp corner is not the elastic energy; it is if the corner is rounded.

    The radius is that of the warning, and the warning is gone.
    """
    lost, swing, texts = cycle(RIGHT_ANGLE)
    assert lost > 0.1 and swing > 0.2
    (text,) = [text for text in texts if "sharp corners of the tool" in text]
    radius = float(re.search(r"radius of at least ([\d.]+)", text).group(1))
    assert abs(radius / (2 * 2 / 16) - 1) < 0.3  # two of the facets, as they are inclined
    lost, swing, texts = cycle(rounded(0.25))
    assert lost < 0.02 and swing < 0.04
    assert texts == []


@pytest.mark.parallel
@pytest.mark.parametrize("sliding", ("finite", "small"))
@pytest.mark.parametrize("degree", (1, 2))
def test_loaded_corner(degree, sliding):
    """One warning, with the place, as soon as the corner carries the force, however deep it is."""
    scene = Pressed(RIGHT_ANGLE, degree=degree, middle=0.4, sliding=sliding)
    _, texts = texts_of(scene, [0.0, -0.01], [0.0, -0.02])
    (text,) = texts
    assert "near (0.1, " in text and "carry 100% of the contact force" in text
    assert "(or 2 facets" in text


@pytest.mark.parametrize("middle", (0.0, 0.5))
def test_force_of_a_loaded_corner(middle):
    """Facets of 2.5 times the depth have a third more force, or more, than those of 0.6 times."""
    forces = [
        Pressed(RIGHT_ANGLE, n, middle=middle).move([0.0, -0.05], [0.0, -0.1])[0][-1, 1]
        for n in (8, 32)
    ]
    assert forces[0] / forces[1] > 1.3


@pytest.mark.parallel
@pytest.mark.parametrize("corners", (FLAT, wedge(10), wedge(15), wedge(19)))
def test_deep_corner(corners):
    """A warning where the force is much too small; with the facets of the warning it is right."""
    force, texts = texts_of(Pressed(corners, middle=0.5), [0.0, -0.025])
    (text,) = texts
    size = float(re.search(r"facets of at most ([\d.]+)", text).group(1))
    assert 1 / 17 < size < 1 / 15
    fine, texts = texts_of(Pressed(corners, n=32, middle=2.0), [0.0, -0.025])
    assert force[0, 1] / fine[0, 1] < 0.7
    finest = Pressed(corners, n=64, middle=4.0).move([0.0, -0.025])[0]
    assert abs(fine[0, 1] / finest[0, 1] - 1) < 0.08


@pytest.mark.parametrize(
    ("corners", "n", "depth"),
    ((WIDE, 16, 0.025), (wedge(10), 8, 0.1), (wedge(15), 16, 0.1), (rounded(0.5), 8, 0.1)),
)
def test_wide_contact(corners, n, depth):
    """No warning where contact is wide: the place between two nodes changes forces by 6 %."""
    forces = []
    for middle in (0.2, 0.5):
        force, texts = texts_of(Pressed(corners, n, middle=middle), [0.0, -depth])
        assert texts == []
        forces.append(force[-1, 1])
    assert abs(forces[1] / forces[0] - 1) < 0.06


def press_a_body(n, middle, modulus):
    """Press a body with a flat end, 0.8 facets of the coarse mesh wide, on one of modulus 1000.

    Args:
        n: Facets of the slave.
        middle: Place of the end's middle, in facets from a node.
        modulus: Young's modulus of the body with the corners, the master.

    Returns:
        Force on the slave, and the warnings about corners.
    """
    block = Body(box(WORLD, (n, n // 2), "quadrilateral", [-1.0, -1.0], [1.0, 0.0]), 1, 1e3)
    block.clamp(block.boundary(lambda x: np.isclose(x[1], -1.0)))
    msh = box(WORLD, (4, 4), "quadrilateral", [-0.1, 0.0], [0.1, 0.6])
    x = msh.geometry.x
    x[:, 0] = x[:, 0] * (1 + 10 * x[:, 1]) + middle * 2 / n  # sides at 45 degrees
    punch = Body(msh, 1, modulus)
    value = punch.clamp(punch.boundary(lambda x: np.isclose(x[1], 0.6)))
    below = punch.surface(punch.boundary(lambda x: x[1] < 0.59))
    contact = qs.Contact(block.side(1, 0.0), below, sliding="finite")
    problem = problem_of([block, punch], [contact])
    value.value[1] = -0.025
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        problem.solve()
    texts = [str(one.message) for one in caught]
    return contact.force("slave")[1], [text for text in texts if "corner" in text]


@pytest.mark.parallel
@pytest.mark.parametrize("modulus", (1e4, 1e6))
def test_deep_corner_of_a_body(modulus):
    """The same warning for a stiff body; with the facets of the warning the force is right."""
    coarse, (text,) = press_a_body(8, 0.5, modulus)
    assert "a corner of the master near" in text
    assert 1 / 17 < float(re.search(r"facets of at most ([\d.]+)", text).group(1)) < 1 / 15
    fine, texts = press_a_body(32, 2.0, modulus)
    assert texts == [] and coarse / fine < 0.7
    assert abs(fine / press_a_body(64, 4.0, modulus)[0] - 1) < 0.08
