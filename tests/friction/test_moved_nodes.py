"""Friction at contact nodes with conditions along the surface that move them, not just hold."""

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic, elastic_form, largest, plane, slide, vector_space

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

MU, N = 0.2, 100.0
AUGMENTED = {"enforcement": "augmented-lagrangian"}
NODAL = {"enforcement": "penalty", "quadrature": "nodal"}
FINITE = {"sliding": "finite"}
DOUBLE = {"formulation": "double-pass", "enforcement": "penalty"}


class Pushed:
    """Block pressed by N on its support, moved along x by the conditions of its side x = 0.

    Args:
        gdim: 2 or 3.
        master: "plane", or "block": a block whose side x = 0 is held as well.
        held: Sides of the block that move along x: at x = 0, or all of the contact surface.
        degree: Degree of the displacements.
        unknown: Unknown of the block.
        options: Options of the contact.
    """

    def __init__(
        self, gdim=2, master="plane", held="side", degree=1, unknown="displacement", **options
    ):
        up, n = gdim - 1, 4 if gdim == 2 else 2
        cell = "quadrilateral" if gdim == 2 else "hexahedron"
        msh = box(WORLD, [n] * gdim, cell, [0.0] * gdim, [1.0] * gdim, "scattered")
        V = fem.functionspace(msh, ("Lagrange", degree, (gdim,)))
        self.u, self.up, v = [fem.Function(V)], up, ufl.TestFunction(V)
        E = 1e5 if unknown == "displacement" else 1e4
        top = np.sort(plane(msh, up, 1.0))
        ds = ufl.Measure("ds", msh, subdomain_data=mesh.meshtags(msh, up, top, np.ones_like(top)))
        self.F = [elastic_form(self.u[0], v, E, 0.0) + N * v[up] * ds(1)]
        self.way, moved = fem.Constant(msh, 0.0), plane(msh, 0, 0.0)
        if held == "face":
            moved = plane(msh, up, 0.0)
        dofs = fem.locate_dofs_topological(V.sub(0), up, moved)
        self.bcs = [[fem.dirichletbc(self.way, dofs, V.sub(0))]]
        if gdim == 3:
            self.bcs[0].append(slide(V, 1, plane(msh, 1, 0.0)))
        if master == "plane":
            self.master = qs.RigidSurface.plane(WORLD, np.zeros(gdim), np.eye(gdim)[up])
        else:
            low = [0.0] * up + [-1.0], [1.0] * up + [0.0]
            other = box(WORLD, [n + 1] * gdim, cell, *low, "forward")
            W = fem.functionspace(other, ("Lagrange", degree, (gdim,)))
            self.u.append(fem.Function(W))
            self.F.append(elastic_form(self.u[1], ufl.TestFunction(W), 10 * E, 0.0))
            self.under = fem.Constant(other, np.zeros(gdim))
            ends = [plane(other, 0, 0.0), plane(other, up, -1.0)]
            dofs = [fem.locate_dofs_topological(W, up, facets) for facets in ends]
            x = fem.locate_dofs_topological(W.sub(0), up, ends[0])
            self.beside = fem.Constant(other, 0.0)
            of_side = fem.dirichletbc(self.beside, x, W.sub(0))
            self.bcs.append([fem.dirichletbc(self.under, dofs[1], W), of_side])
            self.master = qs.Surface(W, facets=plane(other, up, 0.0))
        if unknown == "velocity":
            options |= {"unknown": "velocity", "dt": 1.0}
        surface = qs.Surface(V, facets=plane(msh, up, 0.0))
        self.contact = qs.Contact(surface, self.master, friction=qs.Coulomb(MU), **options)
        self.problem = qs.ContactProblem(self.F, self.u, [self.contact], self.bcs)
        self.flows = unknown == "velocity"

    def move(self, way, of_master=0.0):
        """Let conditions move the block and its support by the given amounts in the next step."""
        self.way.value = way if self.flows else self.way.value + way
        if isinstance(self.master, qs.Surface):
            self.under.value[0] += of_master
            self.beside.value += of_master
        elif of_master:
            before = 0.0 if self.flows else self.master.displacement
            self.master.displacement = before + of_master * np.eye(self.up + 1)[0]

    def friction(self):
        """Return the force along x on the block over N."""
        force = self.contact.force("slave")
        return force[0] / force[self.up]


SCENES = {
    "plane": {},
    "plane, nodal penalty": NODAL,
    "plane, augmented, degree 2": AUGMENTED | {"degree": 2},
    "plane, all that touches": {"held": "face"},
    "plane, finite": FINITE,
    "plane, 3D": {"gdim": 3},
    "plane, velocities": {"unknown": "velocity"},
    "block": {"master": "block"},
    "block, augmented, degree 2": AUGMENTED | {"master": "block", "degree": 2},
    "block, double pass": DOUBLE | {"master": "block"},
    "block, 3D": {"master": "block", "gdim": 3},
    "block, finite": FINITE | {"master": "block"},
}


@pytest.mark.parametrize("scene", SCENES)
def test_what_is_moved_slips_with_all_of_its_friction(scene):
    """|T| = μ N in both directions and at rest."""
    pushed = Pushed(**SCENES[scene])
    pushed.problem.solve()
    assert abs(pushed.friction()) < 1e-6
    for way, expected in ((0.02, -MU), (0.0, -MU), (-0.02, MU)):
        if way == 0.0 and pushed.flows:
            continue  # flow continues at rest
        pushed.move(way)
        pushed.problem.solve()
        assert abs(pushed.friction() - expected) < 1.5e-3 * MU
        if "all" in scene:  # the block slips as a whole
            taken = pushed.contact.step_dissipation()
            np.testing.assert_allclose(taken, MU * N * abs(way), rtol=1e-3, atol=1e-9)


@pytest.mark.parametrize("scene", SCENES)
def test_what_moves_together_does_not_rub(scene):
    """On a plane of symmetry in a moving frame nothing slips, and nothing has to stick."""
    pushed = Pushed(**SCENES[scene])
    for way in (0.0, 0.02, -0.03):
        pushed.move(way, way)
        pushed.problem.solve()
        assert abs(pushed.friction()) < 1e-6


@pytest.mark.parametrize("scene", ("plane", "block"))
def test_in_time_steps(scene):
    """The support moves; contact updates and a restart of the count keep the motion so far."""
    pushed = Pushed(**SCENES[scene])
    way = 0.01

    def drive(t, dt):
        if 1 < t < 4.5:
            of_master = -way * dt
            if isinstance(pushed.master, qs.Surface):
                pushed.move(0.0, of_master)
            else:
                pushed.master.displacement = [of_master, 0.0]

    stepper = qs.TimeStepper(pushed.problem, 1.0, drive)
    for t in stepper.run(5.0):
        expected = 0.0 if t < 1.5 else -MU
        assert abs(pushed.friction() - expected) < 1.5e-3 * MU


def test_a_driven_tool_leaves_planes_of_symmetry_alone():
    """A force-controlled tool gives no friction at nodes held on both sides across its force."""
    found = []
    for half in (False, True):
        n, low = ((4, 4), 0.0) if half else ((8, 4), -1.0)
        msh = box(WORLD, n, "quadrilateral", [low, -1.0], [1.0, 0.0])
        V = vector_space(msh)
        u = fem.Function(V)
        bcs = [clamp(V, plane(msh, 1, -1.0))] + ([slide(V, 0, plane(msh, 0, 0.0))] if half else [])
        tool = qs.RigidSurface.cylinder(WORLD, [0.0, 3.0], None, 3.0)
        tool.drive(0.05 if half else 0.1, [0.0, -1.0])
        surface = qs.Surface(V, facets=plane(msh, 1, 0.0))
        contact = qs.Contact(surface, tool, friction=qs.Coulomb(0.3), constraints="nodes")
        qs.ContactProblem([elastic(u)], [u], [contact], [bcs]).solve()
        found.append(tool.displacement[1])
        if half:
            on = np.abs(contact.slave.node_x[:, 0]) < 1e-9
            assert largest(contact.tangential_multiplier()[on]) == 0
            assert largest(contact.tangential_multiplier()) > 0
    np.testing.assert_allclose(found[1], found[0], rtol=1e-6)


def test_stick_without_a_limit_is_told_of():
    """Sticking without a limit warns, because no force can follow prescribed relative motion."""
    msh = box(WORLD, (4, 4), "quadrilateral", [0.0, 0.0], [1.0, 1.0])
    V = vector_space(msh)
    u, x = fem.Function(V), plane(msh, 0, 0.0)
    bcs = [slide(V, 1, plane(msh, 1, 1.0), -0.01), slide(V, 0, x, 0.05)]
    floor = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    surface = qs.Surface(V, facets=plane(msh, 1, 0.0))
    contact = qs.Contact(surface, floor, friction=qs.Sticking(), **AUGMENTED)
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [bcs])
    with pytest.warns(qs.ContactWarning, match="bcs: .*0.05 against each other.*Coulomb"):
        problem.solve()
