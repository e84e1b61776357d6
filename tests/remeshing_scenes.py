"""Bodies with remeshing, for the tests."""

import numpy as np
from forming_bodies import NortonHoff, quarter_cylinder
from scenes import WORLD

import basix.ufl
import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

R, H, K = 10.0, 15.0, 50.0


def tagged(msh, planes):
    """Make tags 1, 2, … of the boundary facets in planes x[axis] = value."""
    dim = msh.topology.dim - 1
    found = [
        mesh.locate_entities_boundary(msh, dim, lambda x, a=a, c=c: np.isclose(x[a], c))
        for a, c in planes
    ]
    facets = np.concatenate(found)
    values = np.repeat(np.arange(1, len(planes) + 1), [len(f) for f in found])
    facets, first = np.unique(facets, return_index=True)
    return mesh.meshtags(msh, dim, facets.astype(np.int32), values[first].astype(np.int32))


def integral(form, comm=WORLD):
    return comm.allreduce(fem.assemble_scalar(fem.form(form)))


def volume(msh):
    return integral(fem.Constant(msh, 1.0) * ufl.dx, msh.comm)


def area(made, tag):
    """Return the area of the facets of a new mesh with a tag."""
    ds = ufl.Measure("ds", domain=made.mesh, subdomain_data=made.facet_tags)
    return integral(fem.Constant(made.mesh, 1.0) * ds(tag), made.mesh.comm)


def nodes_on(made, tag):
    """Return the coordinates of this rank's nodes on the facets with a tag, shape (nodes, 3)."""
    msh, dim = made.mesh, made.mesh.topology.dim - 1
    facets = made.facet_tags.find(tag)
    if len(facets) == 0:
        return np.zeros((0, 3))
    nodes = mesh.entities_to_geometry(msh, dim, facets)
    return msh.geometry.x[np.unique(nodes)]


def all_nodes(msh):
    """Return the coordinates of all nodes by their input numbers, on every rank."""
    owned = msh.geometry.index_map().size_local
    number = msh.geometry.input_global_indices[:owned]
    parts = msh.comm.allgather((number, msh.geometry.x[:owned]))
    order = np.argsort(np.concatenate([part[0] for part in parts]))
    return np.concatenate([part[1] for part in parts])[order]


def num_cells(msh):
    return msh.topology.index_map(msh.topology.dim).size_global


def bump(msh, phase, height):
    """Deform a quarter of a body by waves; its planes x = 0, y = 0 and z = 0 stay planes."""
    x = msh.geometry.x
    r, angle = np.hypot(x[:, 0], x[:, 1]), np.arctan2(x[:, 1], x[:, 0])
    wave = 1 + 0.03 * np.cos(2 * angle) * np.sin(phase + x[:, 2])
    x[:, 2] += 0.2 * np.sin(phase + r) * np.cos(2 * angle) * x[:, 2] / height
    x[:, :2] *= wave[:, None]


def points_element(msh, degree=2, shape=()):
    return basix.ufl.quadrature_element(msh.basix_cell(), value_shape=shape, degree=degree)


class Upset:
    """A Norton-Hoff billet between rigid planes, axisymmetric or a quarter in 3D.

    Args:
        dim: Dimension, 2 or 3.
        size: Size of cells.
        friction: Function that makes the friction law of each contact; by default none.
        num_steps: Number of steps until the reduction.
        reduction: Reduction of the height.
        comm: Communicator.
        remesh: Options of qs.Remeshing; None for no remeshing.
        meshes: Initial mesh and tags, lists of one each; None for simple meshes.
        stepping: Arguments of the TimeStepper.
    """

    def __init__(
        self,
        dim,
        size,
        friction=None,
        num_steps=12,
        reduction=0.4,
        m=0.3,
        remesh=None,
        comm=WORLD,
        meshes=None,
        **stepping,
    ):
        self.comm = comm
        self.dim, self.m, self.friction = dim, m, friction
        self.up = np.eye(dim)[-1]
        self.t_end, self.dt = reduction, reduction / num_steps
        self.tools = [
            qs.RigidSurface.plane(self.comm, z * self.up, side * self.up)
            for z, side in ((0, 1), (H, -1))
        ]
        if meshes is not None:
            (msh,), (tags,) = meshes
        elif dim == 2:
            msh = mesh.create_rectangle(self.comm, [[0, 0], [R, H]], [int(R / size), int(H / size)])
        else:
            msh = quarter_cylinder(self.comm, R, 0, H, size)
        if meshes is None:
            tags = tagged(msh, [(axis, 0.0) for axis in range(dim)] + [(dim - 1, H)])
        self.num_built = 0
        built = self.build([msh], [tags])
        problem, staggered = built if isinstance(built, tuple) else (built, None)
        options = {"axisymmetric": dim == 2, "fields": lambda: {"strain": self.strain}}
        if remesh is not None:
            options |= {"energy": lambda: self.strain * ufl.dx}
            remesh = qs.Remeshing(self.build, size, [tags], **(options | remesh))
        self.stepper = qs.TimeStepper(
            problem,
            self.dt,
            self.drive,
            solve=self.solve,
            remesh=remesh,
            staggered=staggered,
            **stepping,
        )

    def build(self, meshes, tags):
        (msh,), (facet_tags,) = meshes, tags
        self.num_built += 1
        self.mesh = msh
        self.body = NortonHoff(msh, K, self.m, 1e-4)
        self.strain = fem.Function(fem.functionspace(msh, ("DG", 0)))
        V = self.body.W.sub(0)
        dofs = [
            fem.locate_dofs_topological(V.sub(axis), self.dim - 1, facet_tags.find(axis + 1))
            for axis in range(self.dim - 1)
        ]
        bcs = [fem.dirichletbc(0.0, d, V.sub(axis)) for axis, d in enumerate(dofs)]
        self.contacts = [
            qs.Contact(
                qs.Surface(V, facet_tags, self.dim + i, axisymmetric=self.dim == 2),
                tool,
                unknown="velocity",
                dt=self.dt,
                friction=self.friction() if self.friction else None,
            )
            for i, tool in enumerate(self.tools)
        ]
        return qs.ContactProblem([self.body.F], [self.body.w], self.contacts, [bcs])

    def drive(self, t, dt):
        self.tools[1].displacement = -H * dt * self.up

    def solve(self, step):
        qs.solve_with_continuation(self.stepper.problem, self.body.m, self.m)

    def add_strain(self):
        V = self.strain.function_space
        rate = fem.Function(V)
        rate.interpolate(fem.Expression(self.body.rate, qs.compat.interpolation_points(V)))
        self.strain.x.array[:] += self.stepper.last_dt * rate.x.array

    def run(self):
        """Run all steps; return the force on the upper tool after each step."""
        forces = []
        for _ in self.stepper.run(self.t_end):
            self.add_strain()
            forces.append(-self.contacts[1].force("slave")[-1])
        return np.array(forces)
