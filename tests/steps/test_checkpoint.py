"""Checkpoints on other partitions and numbers of ranks, and runs that continue from them."""

import pathlib

from mpi4py import MPI

import numpy as np
import pytest
from scenes import PARTITIONS, WORLD, box, largest, mini_space, raises_everywhere
from step_scenes import Upset

import basix.ufl
import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.compat import interpolation_points
from qsdolfinx.steps.checkpoint import Checkpoint

SELF = MPI.COMM_SELF
CELLS = {"triangle": (4, 3), "quadrilateral": (4, 3), "tetrahedron": (2, 3, 2)}
CELLS["hexahedron"] = CELLS["tetrahedron"]


@pytest.fixture
def folder(tmp_path_factory):
    """A folder that all ranks know."""
    return pathlib.Path(WORLD.bcast(str(tmp_path_factory.mktemp("run")), root=0)) / "state"


def field(x):
    """Scalar test field with a different value at every point."""
    return np.sin(3 * x[0] + 5 * x[1] + 7 * x[2]) + 2 * x[0]


def vector_field(gdim):
    return lambda x: np.array([field(x + i) for i in range(gdim)])


class State:
    """Functions of all kinds, and coordinates, filled or zero."""

    def __init__(self, comm, cell, partition=None, filled=True, n=None):
        n = CELLS[cell] if n is None else n
        gdim = len(n)
        self.mesh = msh = box(comm, n, cell, [0.0] * gdim, [1.0] * gdim, partition)
        spaces = {
            "p1": ("Lagrange", 1, (gdim,)),
            "p2": ("Lagrange", 2, (gdim,)),
            "scalar": ("Lagrange", 2),
            "constant": ("DG", 0, (2,)),
        }
        for k, shape in (("points", ()), ("tensors", (gdim,))):
            spaces[k] = basix.ufl.quadrature_element(msh.basix_cell(), value_shape=shape, degree=4)
        self.functions = {k: fem.Function(fem.functionspace(msh, v)) for k, v in spaces.items()}
        if cell in ("triangle", "tetrahedron"):
            self.functions["mini"] = fem.Function(qs.materials.mini_space(msh))
            self.functions["blocked"] = fem.Function(mini_space(msh))
        self.x = np.zeros_like(msh.geometry.x)
        if filled:
            self.x[:] = 2 * msh.geometry.x + 1
            for name, u in self.functions.items():
                u.x.array[:] = values_at(u, name)

    @property
    def meshes(self):
        return {"x": (self.mesh, self.x)}

    def is_filled(self):
        error = np.abs(self.x - 2 * self.mesh.geometry.x - 1).max(initial=0.0)
        for name, u in self.functions.items():
            error = max(error, np.abs(u.x.array - values_at(u, name)).max(initial=0.0))
        return self.mesh.comm.allreduce(error, op=MPI.MAX) < 1e-12


def values_at(u, name):
    """Expected values of a function: by interpolation, where the position of a node is known."""
    V = u.function_space
    out = fem.Function(V)
    gdim = V.mesh.geometry.dim
    if name == "mini":
        out.sub(0).interpolate(vector_field(gdim))
        out.sub(1).interpolate(field)
    elif name in ("scalar",):
        out.interpolate(field)
    else:
        out.interpolate(vector_field(V.dofmap.index_map_bs))
    out.x.scatter_forward()
    return out.x.array


@pytest.mark.parallel
@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("partition", [None, *PARTITIONS])
def test_functions(folder, cell, partition):
    """Functions are the same after a transfer to one rank and back, and between partitions."""
    first = State(WORLD, cell, partition)
    assert first.is_filled()
    saved = Checkpoint(WORLD, folder)
    saved.save(first.functions, first.meshes, {"t": 0.1, "names": ["a"]})
    assert saved.values() == {"t": 0.1, "names": ["a"]}
    alone = State(SELF, cell, filled=False)
    assert not alone.is_filled()
    Checkpoint(SELF, folder).load(alone.functions, alone.meshes)
    assert alone.is_filled()
    WORLD.barrier()
    other = folder.with_name("alone")
    if WORLD.rank == 0:
        Checkpoint(SELF, other).save(alone.functions, alone.meshes, {})
    WORLD.barrier()
    for how in ("backward", "scattered"):
        again = State(WORLD, cell, how, filled=False)
        Checkpoint(WORLD, other).load(again.functions, again.meshes)
        assert again.is_filled()


def test_refusals(folder):
    state = State(WORLD, "triangle")
    checkpoint = Checkpoint(WORLD, folder)
    u, msh = state.functions["p1"], state.mesh

    def refuse(error, match, functions, meshes=None):
        before = {name: f.x.array.copy() for name, f in functions.items()}
        raises_everywhere(WORLD, error, match, lambda: checkpoint.load(functions, meshes or {}))
        for name, f in functions.items():
            assert np.array_equal(before[name], f.x.array)

    refuse(OSError, "no checkpoint in", {"p1": u})
    raises_everywhere(WORLD, OSError, "no checkpoint in", checkpoint.values)
    several = ("DG", 1), ("Lagrange", 3), ("N1curl", 1), ("RT", 1)
    for element in several:
        function = fem.Function(fem.functionspace(msh, element))
        call = {"q": function}
        raises_everywhere(WORLD, ValueError, "q: ", lambda c=call: checkpoint.save(c, {}, {}))
    raises_everywhere(
        WORLD, TypeError, "JSON", lambda: checkpoint.save({"p1": u}, {}, {"f": object()})
    )
    assert not folder.exists()
    checkpoint.save(state.functions, state.meshes, {})
    refuse(ValueError, "other: is not in", {"other": u})
    for n in ((3, 3), (3, 4), (5, 4)):  # fewer, as many and more vertices
        other = State(WORLD, "triangle", filled=False, n=n)
        refuse(ValueError, "p1: ", {"p1": other.functions["p1"]})
        refuse(ValueError, "x: ", {}, other.meshes)
    refuse(ValueError, "p1: ", {"p1": state.functions["p2"]})
    refuse(ValueError, "p2: ", {"p2": u})


@pytest.mark.parametrize("rank", [0, WORLD.size - 1])
def test_failed_write(folder, monkeypatch, rank):
    """A failed write keeps the previous checkpoint."""
    state = State(WORLD, "triangle")
    checkpoint = Checkpoint(WORLD, folder)
    checkpoint.save(state.functions, state.meshes, {"step": 1})

    def savez(*args, **kwargs):
        raise OSError("no space left on device")

    with monkeypatch.context() as patch:
        if WORLD.rank == rank:
            patch.setattr(np, "savez", savez)
        for f in state.functions.values():
            f.x.array[:] += 1
        raises_everywhere(
            WORLD, OSError, "no space", lambda: checkpoint.save(state.functions, state.meshes, {})
        )
    again = State(WORLD, "triangle", filled=False)
    checkpoint.load(again.functions, again.meshes)
    assert again.is_filled() and checkpoint.values() == {"step": 1}
    checkpoint.save(state.functions, state.meshes, {"step": 2})
    assert checkpoint.values() == {"step": 2}
    WORLD.barrier()
    assert [path.name for path in folder.parent.iterdir()] == ["state"]


def test_stopped_between_renames(folder):
    state = State(WORLD, "triangle")
    Checkpoint(WORLD, folder).save(state.functions, state.meshes, {"step": 1})
    WORLD.barrier()
    if WORLD.rank == 0:
        folder.rename(folder.with_name("state.old"))
    WORLD.barrier()
    again = State(WORLD, "triangle", filled=False)
    Checkpoint(WORLD, folder).load(again.functions, again.meshes)
    assert again.is_filled()


# --- Runs


class Run(Upset):
    """A viscous block on an elastic die with a rotating plane; its strain is accumulated."""

    def __init__(self, comm=WORLD, **options):
        super().__init__(comm, die=True, dt=0.02, dt_max=0.04, easy=100, **options)
        Q = fem.functionspace(self.mesh, ("DG", 0))
        self.strain = fem.Function(Q)
        rate = qs.materials.equivalent_strain_rate(ufl.split(self.w)[0])
        self._rate = fem.Expression(rate, interpolation_points(Q))
        self.stepper.on_solved = self.add

    def move(self, t, dt):
        self.tool.displacement = [0.0, -dt]
        self.tool.rotation = 0.2 * dt

    def add(self):
        increment = fem.Function(self.strain.function_space)
        increment.interpolate(self._rate)
        self.strain.x.array[:] += self.contacts[0].dt * increment.x.array

    def results(self):
        """Numbers that do not depend on the partition."""
        comm = self.mesh.comm
        found = [self.stepper.t, self.stepper.dt, *self.forces(), *self.size()]
        found += [self.stepper.motions[0].volume(), *self.tool.position.ravel()]
        for f in (*self.u, self.strain):
            V = f.function_space
            owned = V.dofmap.index_map.size_local * V.dofmap.index_map_bs
            found.append(np.sqrt(comm.allreduce(np.sum(f.x.array[:owned] ** 2))))
        return np.array(found)


def test_restart(folder):
    whole = Run()
    for _ in range(2):
        whole.stepper.step()
    qs.save_run(whole.stepper, folder, {"strain": whole.strain})
    for _ in range(2):
        whole.stepper.step()

    again = Run()
    qs.load_run(again.stepper, folder, {"strain": again.strain})
    assert again.stepper.num_steps == 2
    for _ in range(2):
        again.stepper.step()
    for f, g in zip((*whole.u, whole.strain), (*again.u, again.strain), strict=True):
        scale = largest(f.x.array)
        assert scale > 0 and largest(f.x.array - g.x.array) < 1e-12 * scale
    for f, g in zip(whole.u, again.u, strict=True):
        x, y = (h.function_space.mesh.geometry.x for h in (f, g))
        assert largest(x - y) < 1e-12
    np.testing.assert_allclose(again.results(), whole.results(), rtol=1e-12, atol=1e-12)

    alone = Run(SELF)
    qs.load_run(alone.stepper, folder, {"strain": alone.strain})
    other = Run(partition="backward")
    qs.load_run(other.stepper, folder, {"strain": other.strain})
    for run in (alone, other):
        for _ in range(2):
            run.stepper.step()
        np.testing.assert_allclose(run.results(), whole.results(), rtol=1e-8, atol=1e-8)


def test_restart_of_another_run(folder):
    case = Upset()
    case.stepper.step()
    qs.save_run(case.stepper, folder)
    for other, match in ((Run(), "tools"), (Upset(n=4), "another mesh")):
        before = other.state()
        raises_everywhere(WORLD, ValueError, match, lambda o=other: qs.load_run(o.stepper, folder))
        assert all(np.array_equal(a, b) for a, b in zip(before, other.state(), strict=True))
    strain = {"strain": fem.Function(fem.functionspace(case.mesh, ("DG", 0)))}
    raises_everywhere(
        WORLD, ValueError, "user_strain", lambda: qs.load_run(case.stepper, folder, strain)
    )
