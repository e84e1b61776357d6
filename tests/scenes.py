"""Meshes, bodies and contacts from which the tests are built."""

import contextlib

from mpi4py import MPI

import numpy as np

import basix
import basix.ufl
import ufl
from dolfinx import fem, graph, mesh

import qsdolfinx as qs

FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric")
CELLS = ("tetrahedron", "hexahedron", "triangle", "quadrilateral")
LAWS = (qs.Tied, qs.Unilateral)
WORLD = MPI.COMM_WORLD


def allowed(formulations, options):
    """Return pairs of a formulation and a key of the options, in which each of both occurs."""
    formulations, out = list(formulations), []
    for key, chosen in options.items():
        with_multipliers = "enforcement" in chosen
        formulation = next(f for f in formulations if f != "double-pass" or not with_multipliers)
        formulations.remove(formulation)
        formulations.append(formulation)
        out.append((formulation, key))
    return out


def dealt(ranks_of):
    """Make a partitioner that puts all cells on rank ``ranks_of(number of cells, size)``."""

    def partition(comm, size, types, cells):
        count = len(cells[0]) // len(basix.topology(basix.CellType[types[0].name])[0])
        first, total = comm.exscan(count) or 0, comm.allreduce(count)
        dest = np.asarray(ranks_of(total, size)[first : first + count], dtype=np.int32)
        lists = graph.adjacencylist(dest, np.arange(count + 1, dtype=np.int32))
        return getattr(lists, "_cpp_object", lists)

    return partition


def spread(rank_of):
    """Make a partitioner that puts a cell at position p in [0, 1) on ``rank_of(p, size)``."""
    return dealt(lambda total, size: [rank_of(i / total, size) for i in range(total)])


#: Partitions of cells over ranks: in order, backwards, one by one, and all on one rank.
PARTITIONS = {
    "forward": spread(lambda p, size: int(p * size)),
    "backward": spread(lambda p, size: size - 1 - int(p * size)),
    "scattered": spread(lambda p, size: int(p * 1e6) % size),
    "first": spread(lambda p, size: 0),
    "last": spread(lambda p, size: size - 1),
}


def box(comm, n, cell, low, high, partition=None):
    """Make a structured mesh; n is the number of cells along each axis."""
    create = mesh.create_rectangle if len(n) == 2 else mesh.create_box
    options = {} if partition is None else {"partitioner": PARTITIONS[partition]}
    return create(comm, [low, high], list(n), mesh.CellType[cell], **options)


def create_mesh(cells, x, domain, comm=WORLD, **options):
    """Call dolfinx.mesh.create_mesh, whose order of arguments differs between versions."""
    return mesh.create_mesh(comm, cells=cells.astype(np.int64), x=x, e=domain, **options)


def blocks(*boxes):
    """Mesh separate cubes as one mesh; boxes are pairs of corners."""
    gdim = len(boxes[0][0])
    corners = np.array([[(i >> k) & 1 for k in range(gdim)] for i in range(2**gdim)])
    x = [np.where(corners, high, low) for low, high in boxes]
    cells = np.arange(2**gdim * len(boxes)).reshape(len(boxes), -1)
    cell = "quadrilateral" if gdim == 2 else "hexahedron"
    domain = ufl.Mesh(basix.ufl.element("Lagrange", cell, 1, shape=(gdim,)))
    mine = np.arange(len(boxes)) % WORLD.size == WORLD.rank
    points = np.array_split(np.concatenate(x), WORLD.size)[WORLD.rank]
    return create_mesh(cells[mine], points, domain)


def curved_triangle():
    """Make a triangle whose sides are of degree 2, on rank 0."""
    points = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0.5], [0, 0.5], [0.5, 0.0]])
    domain = ufl.Mesh(basix.ufl.element("Lagrange", "triangle", 2, shape=(2,)))
    mine = slice(None) if WORLD.rank == 0 else slice(0)
    return create_mesh(np.arange(6).reshape(1, 6)[mine], points[mine], domain)


def elevated(msh, degree=2):
    """Make the same cells with a geometry of another degree, on the ranks that own them."""
    gdim, comm = msh.geometry.dim, msh.comm
    V = fem.functionspace(msh, ("Lagrange", degree, (gdim,)))
    owned = V.dofmap.index_map.size_local
    count = msh.topology.index_map(msh.topology.dim).size_local
    nodes = V.dofmap.list[:count]
    numbers = V.dofmap.index_map.local_to_global(nodes.ravel().astype(np.int32))
    x = V.tabulate_dof_coordinates()[:owned, :gdim]
    cell = msh.topology.cell_type.name
    domain = ufl.Mesh(basix.ufl.element("Lagrange", cell, degree, shape=(gdim,)))

    def here(comm, size, types, cells):
        ranks = np.full(count, comm.rank, dtype=np.int32)
        lists = graph.adjacencylist(ranks, np.arange(count + 1, dtype=np.int32))
        return getattr(lists, "_cpp_object", lists)

    return create_mesh(numbers.reshape(nodes.shape), x, domain, comm, partitioner=here)


def plane(msh, axis, value):
    """Return the boundary facets in a plane normal to an axis."""
    fdim = msh.topology.dim - 1
    return mesh.locate_entities_boundary(msh, fdim, lambda x: np.isclose(x[axis], value))


def clamp(V, facets, value=None):
    """Make a Dirichlet condition on all components."""
    value = np.zeros(V.mesh.geometry.dim) if value is None else np.asarray(value, dtype=np.float64)
    return fem.dirichletbc(
        value, fem.locate_dofs_topological(V, V.mesh.topology.dim - 1, facets), V
    )


def slide(V, axis, facets, value=0.0):
    """Make a Dirichlet condition on one component."""
    component = V.sub(axis)
    dofs = fem.locate_dofs_topological(component, V.mesh.topology.dim - 1, facets)
    return fem.dirichletbc(fem.Constant(V.mesh, float(value)), dofs, component)


def vector_space(msh):
    """Make a space of P1 or Q1 displacements."""
    return fem.functionspace(msh, ("Lagrange", 1, (msh.geometry.dim,)))


def mini_space(msh):
    """Make a space of P1 displacements with a cell bubble."""
    cell, gdim = msh.basix_cell(), msh.geometry.dim
    p1 = basix.ufl.element("Lagrange", cell, 1)
    bubble = basix.ufl.element("Bubble", cell, gdim + 1)
    element = basix.ufl.enriched_element([p1, bubble])
    return fem.functionspace(msh, basix.ufl.blocked_element(element, shape=(gdim,)))


def elastic(u, E=1.0, nu=0.3, force=None):
    """Return the residual of linear elasticity (plane strain in 2D)."""
    v = ufl.TestFunction(u.function_space)
    return elastic_form(u, v, E, nu, force)


def elastic_form(u, v, E=1.0, nu=0.3, force=None):
    mu, lmbda = E / 2 / (1 + nu), E * nu / (1 + nu) / (1 - 2 * nu)

    def strain(w):
        return ufl.sym(ufl.grad(w))

    F = 2 * mu * ufl.inner(strain(u), strain(v)) + lmbda * ufl.div(u) * ufl.div(v)
    if force is not None:
        F -= ufl.inner(force, v)
    return F * ufl.dx


def random_values(msh, amplitude, seed, dim):
    """Return displacements at lattice positions, the same on every partition: a sum of waves."""
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(8, 3)) * 6
    phases = rng.random((8, dim)) * 2 * np.pi
    x = msh.geometry.x
    return amplitude * np.sin((x @ waves.T)[:, :, None] + phases[None]).mean(axis=1)


class Pair:
    """Two stacked elastic blocks, the lower one the master, with wavy contact surfaces."""

    def __init__(
        self,
        cell,
        formulation="quasi-symmetric",
        law=None,
        penalty=30.0,
        n=(4, 3),
        comm=WORLD,
        gap=0.0,
        wave=0.0,
        partitions=("forward", "backward"),
        load=-0.1,
        space=vector_space,
        contact_options=None,
    ):
        self.gdim = gdim = 2 if cell in ("triangle", "quadrilateral") else 3
        self.meshes, self.V, self.u, self.F, self.bcs, surfaces = [], [], [], [], [], []
        axis = gdim - 1
        for i, (count, low) in enumerate(zip(n, (-1.0, 0.0), strict=True)):
            corner = [0.0] * axis + [low]
            msh = box(comm, [count] * axis + [2], cell, corner, np.add(corner, 1.0), partitions[i])
            contact, far = plane(msh, axis, 0.0), plane(msh, axis, -1.0 if i == 0 else 1.0)
            x = msh.geometry.x
            shape = 1 - np.abs(x[:, axis])
            x[:, axis] += shape * random_values(msh, wave, 3, 1)[:, 0] + (gap if i == 1 else 0.0)
            V = space(msh)
            u = fem.Function(V)
            self.meshes.append(msh)
            self.V.append(V)
            self.u.append(u)
            self.F.append(elastic(u, E=1.0 + i))
            value = np.zeros(gdim)
            value[axis] = 0.0 if i == 0 else load
            self.bcs.append([clamp(V, far, value)])
            surfaces.append(qs.Surface(V, facets=contact))
        self.master, self.slave = surfaces
        law = qs.Unilateral() if law is None else law
        options = contact_options or {}
        self.contact = qs.Contact(
            self.slave, self.master, formulation=formulation, law=law, penalty=penalty, **options
        )

    def problem(self, **options):
        return qs.ContactProblem(self.F, self.u, [self.contact], self.bcs, **options)


def drag_top(pair, shift, press=-0.1):
    """Set the displacement of the upper block's top, along x and upwards."""
    top = plane(pair.meshes[1], pair.gdim - 1, 1.0)
    value = np.zeros(pair.gdim)
    value[0], value[-1] = shift, press
    pair.bcs[1][:] = [clamp(pair.V[1], top, value)]


def all_facets(surface):
    """Return the facet vertices of all ranks, shape (facets, vertices, 3). Collective."""
    msh, fdim = surface.mesh, surface.mesh.topology.dim - 1
    msh.topology.create_connectivity(fdim, fdim + 1)
    vertices = np.zeros((0, surface.num_facet_vertices), dtype=np.int32)
    if len(surface.facets):  # DOLFINx divides by the number of cells
        vertices = mesh.entities_to_geometry(msh, fdim, surface.facets)
    return gathered(surface.comm, msh.geometry.x[vertices])


def gathered(comm, values):
    """Gather the values of all ranks on every rank."""
    return np.concatenate(comm.allgather(values))


def raises_everywhere(comm, error, match, call):
    """Assert that every rank raises this error, and return it."""
    try:
        call()
        found = None
    except Exception as e:
        found = e
    assert isinstance(found, error), f"expected {error.__name__}, got {found!r}"
    assert match in str(found), f"{match!r} is not in {found}"
    texts = set(comm.allgather(str(found)))
    assert len(texts) == 1, texts
    return found


def largest(*arrays):
    """Return the largest absolute value on all ranks."""
    local = max(float(np.abs(a).max(initial=0.0)) for a in arrays)
    return WORLD.allreduce(local, op=MPI.MAX)


@contextlib.contextmanager
def spread_cells(monkeypatch, partition):
    """Set the partitioner of DOLFINx's boxes and rectangles inside the block."""

    def spread(function):
        return lambda *args: function(*args, partitioner=PARTITIONS[partition])

    with monkeypatch.context() as patch:
        for name in ("create_box", "create_rectangle"):
            patch.setattr(mesh, name, spread(getattr(mesh, name)))
        yield
