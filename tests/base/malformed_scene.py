"""Valid calls of the whole public interface, for ``test_malformed.py``."""

import dataclasses
import functools
import typing

from mpi4py import MPI

import numpy as np
from scenes import WORLD, Pair, box, create_mesh, plane, vector_space
from step_scenes import Upset

import basix.ufl
import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx import materials
from qsdolfinx.contact import multipliers


class Of(typing.NamedTuple):
    """A value that is computed from the scene."""

    make: typing.Callable[[typing.Any], object]


@dataclasses.dataclass
class Call:
    """A call with valid arguments."""

    call: typing.Callable[..., object]
    arguments: dict[str, typing.Any]


class Scene:
    """Two blocks, a time stepper, and objects of wrong kinds."""

    def __init__(self, folder):
        self.folder = folder
        self.writer = None
        self.pair = Pair("triangle", contact_options={"friction": qs.Coulomb(0.2)})
        self.case = Upset()
        self.m = fem.Constant(self.case.mesh, 0.5)
        self.facets = plane(self.case.mesh, 1, 0.0)
        self.V = vector_space(self.case.mesh)

    def close(self):
        if self.writer is not None:
            self.writer.close()
        self.case.problem.destroy()

    def state(self):
        """State that a refused call must not change."""
        arrays = self.case.state() + [u.x.array.copy() for u in self.pair.u]
        arrays += [m for m in multipliers.on_nodes(self.pair.contact.model.parts)]
        arrays += [self.case.tool.rotation.copy(), np.array([self.m.value])]
        contacts = [self.pair.contact, *self.case.contacts]
        numbers = [x for c in contacts for x in (c.penalty or 0, c.dt or 0, c.model.num_pairings)]
        return [*arrays, np.array(numbers, dtype=float)]

    def is_as(self, before):
        after = self.state()
        same = all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
        return WORLD.allreduce(int(not same)) == 0 and self.case.tool.driven is None

    # --- Objects of wrong kinds

    @functools.cached_property
    def numbers(self):
        return fem.functionspace(self.case.mesh, ("DG", 0))

    @functools.cached_property
    def constants(self):
        return fem.functionspace(self.case.mesh, ("DG", 0, (2,)))

    @functools.cached_property
    def tensors(self):
        return fem.functionspace(self.case.mesh, ("Lagrange", 1, (2, 2)))

    @functools.cached_property
    def on_membrane(self):
        """Function space on triangles in 3D."""
        domain = ufl.Mesh(basix.ufl.element("Lagrange", "triangle", 1, shape=(3,)))
        x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1]], dtype=float)
        mine = slice(None) if WORLD.rank == 0 else slice(0)
        msh = create_mesh(np.array([[0, 1, 2], [1, 2, 3]])[mine], x[mine], domain)
        return fem.functionspace(msh, ("Lagrange", 1, (3,)))

    @functools.cached_property
    def interior(self):
        return np.arange(self.case.mesh.topology.index_map(1).size_local, dtype=np.int32)

    @functools.cached_property
    def other_mesh(self):
        return box(WORLD, (7, 5), "triangle", [0.0, 0.0], [1.0, 1.0])

    @functools.cached_property
    def other_function(self):
        return fem.Function(vector_space(self.other_mesh))

    @functools.cached_property
    def on_other_mesh(self):
        return fem.Function(fem.functionspace(self.other_mesh, ("Lagrange", 1)))

    @functools.cached_property
    def quads(self):
        return box(WORLD, (3, 3), "quadrilateral", [0.0, 0.0], [1.0, 1.0])

    @functools.cached_property
    def mesh_3d(self):
        return box(WORLD, (2, 2, 2), "tetrahedron", [0.0] * 3, [1.0] * 3)

    @functools.cached_property
    def of_3d(self):
        return qs.Surface(vector_space(self.mesh_3d), facets=plane(self.mesh_3d, 2, 0.0))

    @functools.cached_property
    def tool_3d(self):
        return qs.RigidSurface.plane(WORLD, [0.0] * 3, [0.0, 0.0, 1.0])

    @functools.cached_property
    def foreign_function(self):
        msh = box(_other_comm(), (3, 3), "triangle", [0.0, 0.0], [1.0, 1.0])
        return fem.Function(vector_space(msh))

    @functools.cached_property
    def other_comm(self):
        """A surface on a communicator with another order of ranks; on one rank, a surface in 3D."""
        if WORLD.size == 1:
            return self.of_3d
        V = self.foreign_function.function_space
        return qs.Surface(V, facets=plane(V.mesh, 1, 0.0))

    @functools.cached_property
    def tags_of_cells(self):
        count = self.case.mesh.topology.index_map(2).size_local
        cells = np.arange(count, dtype=np.int32)
        return mesh.meshtags(self.case.mesh, 2, cells, np.ones(count, dtype=np.int32))

    def tags(self, msh):
        facets = np.sort(plane(msh, 1, 0.0)).astype(np.int32)
        return mesh.meshtags(msh, 1, facets, np.ones(len(facets), dtype=np.int32))

    @functools.cached_property
    def tags_of_other(self):
        return self.tags(self.other_mesh)

    @functools.cached_property
    def slave_again(self):
        return qs.Surface(self.pair.slave.V, facets=self.pair.slave.facets)

    @functools.cached_property
    def on_other(self):
        """A contact of the slave with another body."""
        other = self.other_function.function_space
        return qs.Contact(
            self.pair.slave, qs.Surface(other, facets=plane(self.other_mesh, 1, 1.0)), penalty=1.0
        )

    @property
    def vector(self):
        return fem.Constant(self.case.mesh, (1.0, 2.0))

    @property
    def pressure(self):
        return ufl.split(self.case.w)[1]

    @property
    def bilinear(self):
        V = self.pair.V[0]
        return ufl.inner(ufl.TrialFunction(V), ufl.TestFunction(V)) * ufl.dx

    @property
    def loads(self):
        return ufl.inner(ufl.as_vector([1.0, 0.0]), ufl.TestFunction(self.pair.V[0])) * ufl.dx


@functools.cache
def _other_comm():
    return WORLD.Split(0, -WORLD.rank) if WORLD.size > 1 else MPI.COMM_SELF


def contact(scene, **more):
    arguments = {
        "slave": scene.pair.slave,
        "master": scene.pair.master,
        "formulation": "quasi-symmetric",
        "law": qs.Unilateral(),
        "penalty": 30.0,
        "search_radius": 0.5,
        "quadrature": "nodal",
        "quadrature_degree": None,
        "normals": "facet",
        "enforcement": "penalty",
        "gap_tolerance": 1e-8,
        "unknown": "displacement",
        "dt": None,
        "friction": None,
        "friction_penalty": None,
    }
    return Call(qs.Contact, arguments | more)


def problem(scene):
    pair = scene.pair
    arguments = {"F": pair.F, "u": pair.u, "contacts": [pair.contact], "bcs": pair.bcs, "J": None}
    arguments |= {"kind": "mpi", "linear_solver": "direct", "petsc_options": None}
    return Call(
        qs.ContactProblem,
        arguments | {"petsc_options_prefix": None, "pressure_preconditioner": None},
    )


def stepper(scene):
    arguments = {"problem": scene.case.problem, "dt": 0.05, "drive": None, "solve": None}
    arguments |= {"theta": 0.5, "num_pairings": 1, "easy": 8, "dt_min": None, "dt_max": None}
    arguments |= {"growth": 1.5, "cutback": 0.5, "max_penetration": None, "min_quality": 0.1}
    arguments |= {"max_rotation": None, "max_slip": None}
    return Call(qs.TimeStepper, arguments)


def writer(scene):
    arguments = {"filename": scene.folder / "good.xdmf", "msh": scene.case.mesh}
    return Call(qs.FieldWriter, arguments | {"fields": {"u": fem.Function(scene.V)}})


def write(scene):
    if scene.writer is None:
        scene.writer = qs.FieldWriter(**writer(scene).arguments)
    return Call(scene.writer.write, {"t": 0.1})


def material(name, **arguments):
    def make(scene):
        u = fem.Function(scene.V)
        return Call(getattr(materials, name), {"u": u} | arguments)

    return make


def flow(name, **arguments):
    return lambda s: Call(getattr(materials, name), {"v": ufl.split(s.case.w)[0]} | arguments)


def setter(name, good):
    return lambda s: Call(lambda **a: setattr(s.case.tool, name, a[name]), {name: good})


def run(scene):
    return Call(lambda t_end: next(scene.case.stepper.run(t_end)), {"t_end": 0.1})


def load(scene):
    if not (scene.folder / "s").exists():
        qs.save_run(scene.case.stepper, scene.folder / "s")
    WORLD.barrier()
    return Call(
        qs.load_run,
        {"stepper": scene.case.stepper, "folder": scene.folder / "s", "functions": None},
    )


SEGMENTS = {
    "x": [[2.0, 0.0], [1.0, 0.0], [0.0, 0.0]],
    "triangles": [[0, 1], [1, 2]],
    "center": [0.0, 0.0],
}
SQUARE = {
    "x": [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]],
    "triangles": [[0, 1, 2], [1, 3, 2]],
    "center": None,
}

#: Valid calls by name: functions from a scene to a call.
GOOD = {
    "Surface": lambda s: Call(qs.Surface, {"V": s.V, "facets": s.facets, "axisymmetric": False}),
    "tagged": lambda s: Call(
        qs.Surface, {"V": s.V, "facet_tags": s.tags(s.case.mesh), "tag": 1, "facets": None}
    ),
    "Surface.function": lambda s: Call(
        s.pair.slave.function, {"values": np.zeros((len(s.pair.slave.node_x), 2))}
    ),
    "Surface.node_values": lambda s: Call(s.pair.slave.node_values, {"function": s.pair.u[1]}),
    "Contact": contact,
    "Contact by default": lambda s: contact(s, normals=None),
    "Contact in velocities": lambda s: contact(s, unknown="velocity", dt=0.1),
    "Contact with friction": lambda s: contact(s, friction=qs.Coulomb(0.1)),
    "Contact with Norton": lambda s: contact(s, friction=qs.Norton(0.1, 1.0, 0.2), dt=0.1),
    "Contact.set_penalty": lambda s: Call(s.pair.contact.set_penalty, {"penalty": 30.0}),
    "Contact.set_dt": lambda s: Call(s.case.contacts[0].set_dt, {"dt": 0.05}),
    "Contact.set_offset": lambda s: Call(
        s.pair.contact.set_offset, {"slave": None, "master": None}
    ),
    "Contact.traction": lambda s: Call(s.pair.contact.traction, {"side": "slave", "part": "whole"}),
    "Contact.force": lambda s: Call(s.pair.contact.force, {"side": "slave"}),
    "Contact.moment": lambda s: Call(s.pair.contact.moment, {"side": "slave", "about": [0.0, 0.0]}),
    "Contact.gap": lambda s: Call(s.pair.contact.gap, {"side": "slave"}),
    "Contact.weighted_gap": lambda s: Call(s.pair.contact.weighted_gap, {"side": "slave"}),
    "Contact.slip": lambda s: Call(s.pair.contact.slip, {"side": "slave"}),
    "ContactProblem": problem,
    "problem by default": lambda s: Call(
        qs.ContactProblem, problem(s).arguments | {"linear_solver": "auto"}
    ),
    "solve_with_continuation": lambda s: Call(
        qs.solve_with_continuation, {"problem": s.case.problem, "m": s.m, "target": 0.5}
    ),
    "solve_with_continuation in several": lambda s: Call(
        qs.solve_with_continuation, {"problem": s.case.problem, "m": [s.m], "target": [0.5]}
    ),
    "TimeStepper": stepper,
    "TimeStepper.step": lambda s: Call(s.case.stepper.step, {"t_end": 0.1}),
    "TimeStepper.run": run,
    "Coulomb": lambda s: Call(qs.Coulomb, {"mu": 0.1}),
    "Tresca": lambda s: Call(qs.Tresca, {"limit": 0.1}),
    "CoulombTresca": lambda s: Call(
        qs.CoulombTresca, {"mu": 0.1, "m_bar": 0.3, "flow_stress": 50.0}
    ),
    "Norton": lambda s: Call(qs.Norton, {"alpha": 0.1, "K": 1.0, "q": 0.2, "v0": None}),
    "RigidSurface.plane": lambda s: Call(
        qs.RigidSurface.plane, {"comm": WORLD, "point": [0.0, 0.0], "normal": [0.0, 1.0]}
    ),
    "RigidSurface.cylinder": lambda s: Call(
        qs.RigidSurface.cylinder,
        {"comm": WORLD, "point": [0.0] * 3, "axis": [0, 0, 1], "radius": 1.0, "inside": False},
    ),
    "RigidSurface.sphere": lambda s: Call(
        qs.RigidSurface.sphere, {"comm": WORLD, "center": [0.0, 0.0], "radius": 1.0}
    ),
    "RigidSurface.triangulated": lambda s: Call(
        qs.RigidSurface.triangulated, {"comm": WORLD} | SEGMENTS
    ),
    "triangulated in 3D": lambda s: Call(qs.RigidSurface.triangulated, {"comm": WORLD} | SQUARE),
    "RigidSurface.from_stl": lambda s: Call(
        qs.RigidSurface.from_stl, {"comm": WORLD, "filename": "good.stl"}
    ),
    "RigidSurface.from_mesh": lambda s: Call(qs.RigidSurface.from_mesh, {"msh": s.case.mesh}),
    "displacement": setter("displacement", [0.0, 0.0]),
    "rotation": setter("rotation", 0.0),
    "position": setter("position", np.eye(2, 3)),
    "RigidSurface.drive": lambda s: Call(
        s.case.tool.drive, {"force": 1.0, "direction": [0.0, 1.0]}
    ),
    "RigidSurface.distance": lambda s: Call(s.case.tool.distance, {"x": np.zeros((1, 3))}),
    "FieldWriter": writer,
    "FieldWriter.write": write,
    "History": lambda s: Call(qs.History, {"comm": WORLD, "filename": s.folder / "a.csv"}),
    "History.add": lambda s: Call(
        qs.History(WORLD, s.folder / "h.csv", verbose=False).add, {"row": {"t": 1.0}}
    ),
    "step_row": lambda s: Call(qs.step_row, {"stepper": s.case.stepper}),
    "save_run": lambda s: Call(
        qs.save_run,
        {"stepper": s.case.stepper, "folder": s.folder / "s", "functions": {}, "values": {}},
    ),
    "load_run": load,
    "strain": lambda s: Call(materials.strain, {"u": s.pair.u[0]}),
    "strain in 3D": lambda s: Call(
        materials.strain, {"u": fem.Function(s.of_3d.V), "axisymmetric": False}
    ),
    "linear_elastic": material("linear_elastic", E=1.0, nu=0.3),
    "neo_hookean": material("neo_hookean", mu=1.0, lmbda=1.0),
    "neo_hookean_energy": material("neo_hookean_energy", mu=1.0, lmbda=1.0),
    "newtonian": flow("newtonian", K=1.0),
    "norton_hoff": flow("norton_hoff", K=1.0, m=0.2, regularisation=1e-3),
    "mini_space": lambda s: Call(materials.mini_space, {"msh": s.case.mesh}),
    "incompressible": lambda s: Call(
        materials.incompressible, {"w": s.case.w, "stress": s.case.stress(), "dx": None}
    ),
    "axisymmetric_weight": lambda s: Call(materials.axisymmetric_weight, {"msh": s.case.mesh}),
}

#: Calls that are not collective: each rank raises its own error.
LOCAL = {
    "Coulomb",
    "Tresca",
    "CoulombTresca",
    "Norton",
    "RigidSurface.distance",
    "Contact.gap",
    "Contact.weighted_gap",
    "Contact.slip",
    "Surface.node_values",
    "strain",
    "strain in 3D",
    "linear_elastic",
    "neo_hookean",
    "neo_hookean_energy",
    "newtonian",
    "norton_hoff",
    "incompressible",
    "axisymmetric_weight",
    "mini_space",
}
