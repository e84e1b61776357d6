"""Reference area of tractions: uniform pressure = force / area, of a stretched block."""

import pathlib

from mpi4py import MPI

import numpy as np
import pytest
from output.test_output import dataset
from scenes import WORLD, largest

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

E, WIDE, DEEP = 100.0, 0.5, 0.02


class Stretched:
    """Block with ν = 0 and sides 1, stretched along x and pressed onto the plane y = 0.

    If axisymmetric, it is a cylinder that is stretched along r.
    """

    def __init__(self, cell, degree, kind="plane", both=False, **options):
        gdim = 3 if cell in ("tetrahedron", "hexahedron") else 2
        msh = self.mesh([0.0] * gdim, [1.0] * gdim, cell)
        around = kind == "axisymmetric"
        self.u = fem.Function(fem.functionspace(msh, ("Lagrange", degree, (gdim,))))
        self.side, self.top = fem.Constant(msh, 0.0), fem.Constant(msh, 0.0)
        up, far = gdim - 1, (0, 1.0, self.side)
        held = [(0, 0.0, fem.Constant(msh, 0.0)), far, (up, 1.0, self.top)]
        held += [(1, 0.0, fem.Constant(msh, 0.0))] if gdim == 3 else []
        body = self.body(msh, self.u, held, around)
        slave = qs.Surface(self.u.function_space, facets=self.at(msh, up, 0.0), axisymmetric=around)
        bodies, master = [body], qs.RigidSurface.plane(WORLD, [0.0] * gdim, np.eye(gdim)[up])
        if both:  # the floor is a body of degree 1 that is stretched with the block
            below = self.mesh([0.0] * (gdim - 1) + [-1.0], [1.0] * (gdim - 1) + [0.0], cell, 3)
            w = fem.Function(fem.functionspace(below, ("Lagrange", 1, (gdim,))))
            self.floor = fem.Constant(below, 0.0)
            zero = fem.Constant(below, 0.0)
            held = [(0, 0.0, zero), (0, 1.0, self.floor), (up, -1.0, zero)]
            bodies.append(self.body(below, w, held, around))
            facets = self.at(below, up, 0.0)
            master = qs.Surface(w.function_space, facets=facets, axisymmetric=around)
        self.both = both
        self.contact = qs.Contact(slave, master, **options)
        F, u, bcs = zip(*bodies, strict=True)
        self.problem = qs.ContactProblem(list(F), list(u), [self.contact], list(bcs))

    @staticmethod
    def mesh(low, high, cell, n=2):
        make = mesh.create_rectangle if len(low) == 2 else mesh.create_box
        return make(WORLD, [low, high], [n] * len(low), getattr(mesh.CellType, cell))

    @staticmethod
    def at(msh, i, value):
        close = lambda x: np.isclose(x[i], value)  # noqa: E731
        return mesh.locate_entities_boundary(msh, msh.topology.dim - 1, close)

    def body(self, msh, u, held, around):
        V = u.function_space
        v = ufl.TestFunction(V)
        weight = 2 * np.pi * ufl.SpatialCoordinate(msh)[0] if around else 1.0
        work = ufl.inner(E * ufl.sym(ufl.grad(u)), ufl.grad(v))
        if around:
            r = ufl.SpatialCoordinate(msh)[0]
            work += E * u[0] * v[0] / r**2
        F = weight * work * ufl.dx
        bcs = [
            fem.dirichletbc(
                value,
                fem.locate_dofs_topological(V.sub(i), msh.topology.dim - 1, self.at(msh, i, x)),
                V.sub(i),
            )
            for i, x, value in held
        ]
        return F, u, bcs

    def drive(self, t, dt=0.0):
        self.side.value, self.top.value = WIDE * t, -DEEP * t
        if self.both:
            self.floor.value = WIDE * t

    def errors(self, area):
        """Return the largest relative error of pressure and traction at the nodes of all bodies."""
        contact, out = self.contact, []
        up = contact.slave.gdim - 1
        mean = abs(contact.force("slave")[up]) / area
        for side in ("slave", "master")[: 1 + self.both]:
            surface = getattr(contact, side)
            p = surface.node_values(contact.pressure(side))
            t = surface.node_values(contact.traction(side))[:, up]
            assert p.shape == (len(surface.node_x),)
            out += [p / mean - 1, np.abs(t) / mean - 1]
        return largest(*out)


SCENES = {
    "triangle, 1": ("triangle", 1),
    "triangle, 2": ("triangle", 2),
    "quadrilateral, 2": ("quadrilateral", 2),
    "tetrahedron, 2": ("tetrahedron", 2),
    "hexahedron, 2": ("hexahedron", 2),
    "axisymmetric, 1": ("triangle", 1, "axisymmetric"),
    "axisymmetric, 2": ("triangle", 2, "axisymmetric"),
    "two bodies": ("triangle", 2, "plane", True),
}


@pytest.mark.parametrize("name", SCENES)
def test_in_time_steps(name):
    """In time steps, the area is the one at the end of the step: 1.5, of a cylinder π 1.5²."""
    scene = Stretched(*SCENES[name])
    stepper = qs.TimeStepper(scene.problem, 0.5, scene.drive)
    for t in stepper.run(1.0):
        wide = 1 + WIDE * t
        area = np.pi * wide**2 if name.startswith("axi") else wide
        assert scene.errors(area) < 1e-7
        assert scene.contact.patch()[0] == pytest.approx(area)
    # The mesh of a displacement-based body stays; its ring is complete, as forces are.
    whole = np.pi if name.startswith("axi") else 1.0
    assert qs.step_row(stepper)["volume_0"] == pytest.approx(whole)
    scene.contact.update()
    assert scene.errors(area) < 1e-7


@pytest.mark.parametrize("options", ({}, {"constraints": "nodes"}))
@pytest.mark.parametrize("both", (False, True))
def test_area_in_contact(both, options):
    """In time steps, the area is that of the body at their end, in ``step_row``, too."""
    scene = Stretched("triangle", 1, both=both, **options)
    stepper = qs.TimeStepper(scene.problem, 0.5, scene.drive)
    for t in stepper.run(1.0):
        assert qs.step_row(stepper)["area_0"] == pytest.approx(1 + WIDE * t)


@pytest.mark.parametrize("degree", (1, 2))
@pytest.mark.parametrize("sliding", ("small", "finite"))
def test_in_solves(sliding, degree):
    """In a solve, it is the area of the mesh; with finite sliding, the deformed area."""
    scene = Stretched("triangle", degree, sliding=sliding)
    for t in (0.5, 1.0):
        scene.drive(t)
        scene.problem.solve()
        area = 1.0 if sliding == "small" else 1 + WIDE * t
        assert scene.errors(area) < 1e-7
        assert scene.contact.patch()[0] == pytest.approx(area)


@pytest.mark.parametrize("sliding", ("small", "finite"))
def test_of_a_tie(sliding):
    """The same rule for a tie: area of the mesh, with finite sliding of the deformed bodies."""
    scene = Stretched("triangle", 2, "plane", True, sliding=sliding, law=qs.Tied())
    scene.drive(1.0)
    scene.problem.solve()
    assert scene.errors(1.0 if sliding == "small" else 1 + WIDE) < 1e-7


@pytest.mark.parametrize("num_pairings", (1, 2))
@pytest.mark.parametrize("theta", (0.0, 0.5, 1.0))
@pytest.mark.parametrize("sliding", ("small", "finite"))
def test_of_a_body_in_velocities(sliding, theta, num_pairings):
    """Velocity-based bodies: area of the mesh of the last solve, after θ of the step."""
    options = {"unknown": "velocity", "dt": 1.0, "sliding": sliding}
    scene = Stretched("triangle", 2, **options)
    scene.side.value, scene.top.value = WIDE, -DEEP
    pairs_again = {"theta": theta, "num_pairings": num_pairings}
    stepper, widths = qs.TimeStepper(scene.problem, 0.5, **pairs_again), []
    x = scene.u.function_space.mesh.geometry.x
    stepper.on_solved = lambda: widths.append(WORLD.allreduce(x[:, 0].max(initial=0), op=MPI.MAX))
    for _ in stepper.run(1.0):
        assert scene.errors(widths[-1]) < 1e-7
        assert scene.contact.patch()[0] == pytest.approx(widths[-1])
    assert np.allclose(widths, [1 + WIDE * (i + theta) / 2 for i in (0, 1)], rtol=1e-2)


@pytest.mark.parametrize("cell", ("triangle", "tetrahedron"))
def test_fields_of_mini_bodies(cell, tmp_path_factory):
    """Traction, pressure, gap and status are at vertices, in the functions and in the file."""
    gdim = 2 if cell == "triangle" else 3
    msh = Stretched.mesh([0.0] * gdim, [1.0] * gdim, cell)
    W = qs.materials.mini_space(msh)
    w, (v, q) = fem.Function(W), ufl.TestFunctions(W)
    u, p = ufl.split(w)
    F = (E * ufl.inner(ufl.sym(ufl.grad(u)), ufl.grad(v)) + p * q) * ufl.dx
    V, up = W.sub(0), gdim - 1
    top = Stretched.at(msh, up, 1.0)
    bcs = [
        fem.dirichletbc(value, fem.locate_dofs_topological(V.sub(i), gdim - 1, at), V.sub(i))
        for i, at, value in [(i, top, 0.0) for i in range(up)] + [(up, top, -DEEP)]
    ]
    floor = qs.RigidSurface.plane(WORLD, [0.0] * gdim, np.eye(gdim)[up])
    contact = qs.Contact(qs.Surface(V, facets=Stretched.at(msh, up, 0.0)), floor)
    qs.ContactProblem([F], [w], [contact], [bcs]).solve()
    surface, expected = contact.slave, E * DEEP
    fields = contact.fields()
    values = {name: surface.node_values(field) for name, field in fields.items()}
    assert largest(values["traction"][:, up] - expected) < 1e-7 * expected
    assert largest(values["pressure"] - expected) < 1e-7 * expected
    assert largest(values["status"] - qs.Status.ACTIVE) == 0
    # Linear in the cells, without bubbles.
    ones = {name: f.x.array.reshape(-1, f.function_space.dofmap.bs) for name, f in fields.items()}
    assert all(len(f) == len(ones["status"]) for f in ones.values())
    folder = pathlib.Path(WORLD.bcast(str(tmp_path_factory.mktemp("mini")), root=0))
    with qs.FieldWriter(folder / "f.xdmf", msh, contact.field_sources()) as writer:
        writer.write(0.0)
    WORLD.barrier()
    on_file = {name: dataset(folder / "f.h5", f"/Function/{name}/0") for name in fields}
    nodes = WORLD.allreduce(len(surface.node_x))
    assert np.count_nonzero(on_file["status"] == qs.Status.ACTIVE) == nodes
    for name in ("traction", "pressure"):
        found = on_file[name][on_file[name] > 0.9 * expected]
        assert len(found) == nodes and np.allclose(found, expected, rtol=1e-7)
