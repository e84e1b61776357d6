"""Results of a contact before the first solve, and after changes since the last solve.

A block, E = 1000 and ν = 0, stands on y = 0 and is pressed by a plane: λ = E d / H.
"""

import numpy as np
import pytest
from scenes import WORLD, Pair, largest

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

E, DEPTH = 1e3, 0.01


class Press:
    """Block of 2 × 1 (× 1) and the plane above it."""

    def __init__(self, gdim=2, **options):
        ends = [[0.0] * gdim, [2.0] + [1.0] * (gdim - 1)]
        make = mesh.create_rectangle if gdim == 2 else mesh.create_box
        self.msh = make(WORLD, ends, [4, 3, 2][:gdim])
        V = fem.functionspace(self.msh, ("Lagrange", 1, (gdim,)))
        self.u, v, up = fem.Function(V), ufl.TestFunction(V), gdim - 1
        self.load = fem.Constant(self.msh, 0.0)
        stress = qs.materials.linear_elastic(self.u, E, 0.0)
        F = ufl.inner(stress, ufl.grad(v)) * ufl.dx - self.load * v[up] * ufl.dx
        at = lambda y: mesh.locate_entities_boundary(  # noqa: E731
            self.msh, gdim - 1, lambda x: np.isclose(x[up], y)
        )
        zero = np.zeros(gdim)
        bc = fem.dirichletbc(zero, fem.locate_dofs_topological(V, gdim - 1, at(0.0)), V)
        self.down = np.eye(gdim)[up] * -1.0
        self.tool = qs.RigidSurface.plane(WORLD, -self.down, self.down)
        self.contact = qs.Contact(qs.Surface(V, facets=at(1.0)), self.tool, **options)
        self.problem = qs.ContactProblem([F], [self.u], [self.contact], [[bc]])

    def press(self):
        self.tool.displacement = DEPTH * self.down
        self.problem.solve()


def readings(contact):
    """Return all results by name, as arrays."""
    c = contact
    calls = [c.force, c.moment, c.traction, c.pressure]
    out = {call.__name__: call("slave") for call in calls}
    out["force on the tool"] = c.force("master")
    at_nodes = [c.gap, c.weighted_gap, c.multiplier, c.active, c.slipping, c.status]
    totals = [c.penetration, c.weighted_penetration, c.patch]
    totals += [c.step_dissipation, c.dissipated_energy]
    if c.friction is not None:
        at_nodes += [c.tangential_multiplier, c.slip, c.dissipation]
    out |= {call.__name__: call() for call in at_nodes + totals}
    out |= {"energy": c.stored_energy(), "report": str(c.report())}
    out |= {f"field {name}": field for name, field in c.fields().items()}
    return {
        name: value.x.array.copy() if isinstance(value, fem.Function) else np.array(value)
        for name, value in out.items()
    }


def same(found, before):
    """Assert equality, except for rounding where forces are summed again."""
    faults = []
    for name, value in before.items():
        if value.dtype.kind == "U":
            equal = found[name] == value
        else:
            equal = np.allclose(found[name], value, rtol=1e-13, atol=1e-14, equal_nan=True)
        faults += [] if equal else [name]
    assert not any(WORLD.allgather(faults)), faults


@pytest.mark.parametrize("gdim", (2, 3))
def test_patch(gdim):
    """The radius of a patch is that of a disc of the same area, in 2D half of its length."""
    scene = Press(gdim)
    scene.press()
    area, radius = scene.contact.patch()
    np.testing.assert_allclose([area, np.pi * radius**2 if gdim == 3 else 2 * radius], 2.0)


OPTIONS = {
    "nodes": {"constraints": "nodes"},
    "points": {},
    "penalty": {"enforcement": "penalty", "penalty": 1e6},
    "nodal": {"quadrature": "nodal", "constraints": "nodes"},
    "friction": {"friction": qs.Coulomb(0.2)},
    "finite": {"sliding": "finite", "friction": qs.Coulomb(0.2)},
}


@pytest.mark.filterwarnings("ignore:enforcement")
@pytest.mark.parametrize("gdim", (2, 3))
@pytest.mark.parametrize("name", OPTIONS)
def test_stay_those_of_the_last_solve(name, gdim):
    """Results survive tool.advance() and update(), reset(), another penalty, moved tools and u."""
    scene = Press(gdim, **OPTIONS[name])
    contact, tool = scene.contact, scene.tool
    for step in (1, 2):
        scene.press()
        assert contact.force("slave")[-1] == pytest.approx(-2 * E * DEPTH * step, rel=2e-3)
        before = readings(contact)
        tool.advance()
        same(readings(contact), before)
        contact.update()
        same(readings(contact), before)
        contact.update()
        tool.displacement = DEPTH * scene.down
        same(readings(contact), before)
    u = scene.u.x.array.copy()
    scene.u.x.array[:] *= 2
    same(readings(contact), before)
    scene.u.x.array[:] = u
    contact.set_penalty(3e5)
    del before["report"]  # the report contains the penalty
    same(readings(contact), before)
    contact.reset()
    same(readings(contact), before)
    scene.press()
    assert contact.force("slave")[-1] == pytest.approx(-6 * E * DEPTH, rel=1e-2)


def test_of_bodies_whose_mesh_is_moved():
    """Areas and normals are also those of the solve; the report's sizes of sides are current."""
    scene = Press()
    scene.press()
    before = readings(scene.contact)
    del before["report"]
    scene.msh.geometry.x[:, 0] *= 2
    scene.contact.update()
    same(readings(scene.contact), before)


def test_fields_of_a_master_without_multipliers():
    """The gap of master nodes, too, is that of the solve where meshes have moved since."""
    pair = Pair("triangle", wave=0.004, contact_options={"quadrature": "nodal"})
    pair.problem().solve()
    read = lambda: {k: f.x.array.copy() for k, f in pair.contact.fields("master").items()}  # noqa: E731
    before = read()
    for msh in pair.meshes:
        msh.geometry.x[:, 0] += 0.3 * msh.geometry.x[:, 0] ** 2
    pair.contact.update()
    assert largest(before["gap"]) > 0
    same(read(), before)


def test_after_a_solve_that_fails():
    scene = Press(friction=qs.Coulomb(0.2))
    for _ in range(2):
        before = readings(scene.contact)
        del before["report"]  # the report contains the penalty
        scene.load.value = np.nan
        scene.tool.displacement = 0.5 * DEPTH * scene.down
        with pytest.raises(qs.ConvergenceError):
            scene.problem.solve()
        same(readings(scene.contact), before)
        scene.load.value = 0.0
        scene.press()
        assert scene.contact.force("slave")[1] == pytest.approx(-2 * E * DEPTH)


@pytest.mark.parametrize("name", ("points", "penalty", "friction", "finite"))
def test_before_the_first_solve(name):
    """Before the first solve forces are zero, with or without a penalty; gaps are geometric."""
    scene = Press(**OPTIONS[name])
    scene.tool.displacement = 0.3 * DEPTH * scene.down
    scene.tool.advance()
    scene.contact.update()
    found = readings(scene.contact)
    geometry = ("gap", "weighted_gap", "field gap", "penetration", "weighted_penetration", "report")
    touching = ("active", "patch") if name == "penalty" else ()
    for key in ("status", "field status"):
        paired = qs.Status.ACTIVE if name == "penalty" else qs.Status.OPEN
        assert largest(found.pop(key)) == paired, key
    for key, value in found.items():
        if key not in geometry and key not in touching:
            assert largest(value) == 0, key
    assert largest(found["gap"]) == pytest.approx(0.3 * DEPTH)
    assert found["penetration"] == pytest.approx(0.3 * DEPTH)
