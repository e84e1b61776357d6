"""Status, gap and tractions as Functions on both bodies, and in files."""

import pathlib

from mpi4py import MPI

import numpy as np
import pytest
from output.test_output import dataset, grids, stored
from scenes import (
    CELLS,
    FORMULATIONS,
    WORLD,
    Pair,
    curved_triangle,
    drag_top,
    largest,
    raises_everywhere,
    vector_space,
)

import ufl
from dolfinx import fem, io, mesh

import qsdolfinx as qs
from qsdolfinx.contact import terms

SIDES = ("slave", "master")


def at_nodes(surface, function):
    """Return values of a scalar function at the surface's nodes on this rank."""
    V, linear = function.function_space, surface.linear
    x = V.tabulate_dof_coordinates()[: V.dofmap.index_map.size_local]
    out = np.full(len(linear.node_x), np.nan)
    for i, node in enumerate(linear.node_x):
        out[i] = function.x.array[np.argmin(np.linalg.norm(x - node, axis=1))]
    return out


def rocked(cell, formulation, quadrature, n=(5, 4), **more):
    """Press and rotate the upper of two blocks, so that they touch in part."""
    options = {"contact_options": {"quadrature": quadrature} | more}
    pair = Pair(cell, formulation, penalty=50.0, n=n, wave=0.03, **options)
    top = fem.Function(pair.V[1])
    top.interpolate(lambda x: np.vstack([0 * x[: pair.gdim - 1], 0.25 * (x[0] - 0.4)]))
    dofs = pair.bcs[1][0].dof_indices()[0] // pair.gdim
    pair.bcs[1][:] = [fem.dirichletbc(top, np.unique(dofs).astype(np.int32))]
    pair.problem().solve()
    return pair


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("cell", CELLS)
def test_active_is_where_force_is(cell, quadrature, formulation):
    """Nodes with a multiplier are active with it, others with a force; unpaired have no gap.

    An inactive node with a multiplier can still have a force, from the points of its neighbours.
    """
    pair = rocked(cell, formulation, quadrature)
    contact, faults, seen = pair.contact, [], []
    for side, surface in zip(SIDES, (pair.slave, pair.master), strict=True):
        status = at_nodes(surface, contact.status(side))
        force = np.linalg.norm(surface.node_values(contact.traction(side)), axis=1)
        gap = at_nodes(surface, contact.gap_function(side))
        active = status == qs.Status.ACTIVE
        if side == "slave" or formulation == "double-pass":
            faults.append(np.count_nonzero(active != contact.active(side)))
            faults.append(np.count_nonzero(active & (force < 1e-12)))
        else:
            faults.append(np.count_nonzero(active != (force > 1e-12)))
        faults.append(np.count_nonzero((status == qs.Status.UNPAIRED) & (gap != 0)))
        faults.append(np.count_nonzero(np.isin(status, (0, 1, 2), invert=True)))
        seen.append([np.count_nonzero(status == s) for s in qs.Status])
        if side == "slave":
            mine = np.isfinite(contact.weighted_gap())
            faults.append(np.count_nonzero(mine != (status > 0)))
            faults.append(np.count_nonzero(gap[mine] != contact.weighted_gap()[mine]))
    faults, seen = WORLD.allreduce(np.array(faults)), WORLD.allreduce(np.array(seen))
    assert not faults.any(), faults
    assert np.all(seen[:, [qs.Status.OPEN, qs.Status.ACTIVE]] > 0), seen


@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
def test_gap_of_the_master(formulation):
    """A gap that is linear along the surface: its value at each master node away from the rim."""
    options = {"contact_options": {"quadrature": "overlay"}}
    pair = Pair("quadrilateral", formulation, n=(12, 9), **options)
    lifted = np.zeros((len(pair.slave.node_x), 2))
    lifted[:, 1] = 0.01 + 0.2 * pair.slave.node_x[:, 0]
    vecs = pair.slave.nodal_vec(lifted), pair.master.create_vec()
    terms.evaluate(pair.contact.model, *vecs)
    for surface, side in ((pair.slave, "slave"), (pair.master, "master")):
        gap, x = at_nodes(surface, pair.contact.gap_function(side)), surface.node_x[:, 0]
        inner = (x > 0.25) & (x < 0.75)
        assert WORLD.allreduce(np.count_nonzero(inner)) >= 4
        assert largest(gap[inner] + 0.01 + 0.2 * x[inner]) < 1e-12
    for vec in vecs:
        vec.destroy()


@pytest.mark.parametrize("formulation", ("quasi-symmetric", "double-pass"))
def test_stick_and_slip(formulation):
    """All nodes stick, then all slip, on both sides; the parts of the traction add up to it."""
    friction = {"friction": qs.Coulomb(0.2)}
    pair = Pair("triangle", formulation, n=(6, 4), contact_options=friction)
    contact, seen = pair.contact, []
    problem = pair.problem()
    for shift in (0.0, 0.3):
        drag_top(pair, shift)
        problem = pair.problem()
        problem.solve()
        surfaces = zip(SIDES, (pair.slave, pair.master), strict=True)
        seen.append([at_nodes(s, contact.status(side)) for side, s in surfaces])
    slipping = WORLD.allreduce(int(contact.slipping().sum()))
    total = WORLD.allreduce(len(pair.slave.node_x))
    assert slipping == total
    assert largest(seen[1][0] - qs.Status.SLIPPING) == 0
    assert largest(seen[1][1] - qs.Status.SLIPPING) == 0
    assert WORLD.allreduce(sum(int(np.sum(s == qs.Status.ACTIVE)) for s in seen[0])) > 0
    for side in SIDES:
        fields = contact.fields(side)
        has_slip = side == "slave" or formulation == "double-pass"
        expected = {"traction", "pressure", "gap", "status"}
        expected |= {"normal_traction", "tangential_traction"}
        assert set(fields) == expected | ({"slip"} if has_slip else set())
        parts = fields["normal_traction"].x.array + fields["tangential_traction"].x.array
        assert largest(parts - fields["traction"].x.array) < 1e-14
        assert largest(fields["tangential_traction"].x.array) > 1e-3


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("penalty", ("auto", 10.0))
def test_before_the_first_solve(penalty, formulation):
    """Before the first solve, paired nodes of surfaces with a gap are inactive, not unpaired."""
    pair = Pair("triangle", formulation, n=(5, 3), gap=0.01, penalty=penalty)
    for side, surface in zip(SIDES, (pair.slave, pair.master), strict=True):
        status = at_nodes(surface, pair.contact.status(side))
        assert largest(status - qs.Status.OPEN) == 0


def test_tied_and_degree_two():
    """The gap of a tie is the jump's size; displacements of degree 2 have fields of degree 1."""

    def quadratic(msh):
        return fem.functionspace(msh, ("Lagrange", 2, (msh.geometry.dim,)))

    options = {"contact_options": {"quadrature": "overlay"}, "space": quadratic}
    pair = Pair("triangle", law=qs.Tied(), n=(5, 3), **options)
    drag_top(pair, 0.1)
    pair.problem().solve()
    jump = largest(np.linalg.norm(pair.contact.weighted_gap(), axis=1))
    for side, surface in zip(SIDES, (pair.slave, pair.master), strict=True):
        fields = pair.contact.fields(side)
        gap, status = (at_nodes(surface, fields[name]) for name in ("gap", "status"))
        low = WORLD.allreduce(float(np.min(gap, initial=np.inf)), op=MPI.MIN)
        assert largest(status - qs.Status.ACTIVE) == 0
        assert 0 < low and largest(gap) <= jump * (1 + 1e-12)


def test_rigid_tool():
    pair = Pair("triangle")
    tool = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    contact = qs.Contact(pair.slave, tool, penalty=10.0)
    results = contact.status, contact.gap_function, contact.fields, contact.pressure
    for call in results:
        raises_everywhere(WORLD, ValueError, "side: ", lambda c=call: c("master"))
    raises_everywhere(WORLD, ValueError, "side: ", lambda: contact.status("both"))
    status = at_nodes(pair.slave, contact.status())
    assert largest(status - qs.Status.ACTIVE) == 0  # they touch


# --- Files


@pytest.fixture
def folder(tmp_path_factory):
    """Return a folder that all ranks know."""
    return pathlib.Path(WORLD.bcast(str(tmp_path_factory.mktemp("fields")), root=0))


def written(folder, suffix):
    """Solve two loads, write each for both bodies in one call, and return the fields' values."""
    pair = Pair("quadrilateral", n=(5, 3), contact_options={"friction": qs.Coulomb(0.3)})
    contact, values = pair.contact, {}
    problem = pair.problem()
    bodies = dict(zip(SIDES, pair.meshes[::-1], strict=True))
    writers = {
        side: qs.FieldWriter(folder / f"{side}{suffix}", msh, contact.field_sources(side))
        for side, msh in bodies.items()
    }
    for t, shift in ((0.5, 0.01), (1.0, 0.2)):
        drag_top(pair, shift)
        problem = pair.problem()
        problem.solve()
        for side, writer in writers.items():
            writer.write(t)
            for name, field in contact.fields(side).items():
                V = field.function_space
                owned = V.dofmap.index_map.size_local * V.dofmap.bs
                values[side, name, t] = WORLD.allgather(field.x.array[:owned].copy())
    for writer in writers.values():
        writer.close()
    WORLD.barrier()
    return {key: np.sort(np.concatenate(parts)) for key, parts in values.items()}


def test_xdmf_is_read_back(folder):
    values = written(folder, ".xdmf")
    for side in SIDES:
        names = {name for s, name, _ in values if s == side}
        found = grids(folder / f"{side}.xdmf")
        assert found == {name: [0.5, 1.0] for name in names | {"displacement"}}
    for (side, name, t), expected in values.items():
        place = f"/Function/{name}/{str(t).replace('.', '_').removesuffix('_0')}"
        found = dataset(folder / f"{side}.h5", place)
        if len(found) > len(expected):  # vectors have a third component, of zeros
            expected = np.sort(np.concatenate([expected, np.zeros(len(found) - len(expected))]))
        np.testing.assert_allclose(found, expected, atol=1e-15, err_msg=f"{side} {name} {t}")
    assert np.ptp(values["master", "status", 1.0]) == 3


@pytest.mark.skipif(not hasattr(io, "VTXWriter"), reason="DOLFINx without ADIOS2")
def test_vtx(folder):
    written(folder, ".bp")
    for side in SIDES:
        files = [f for f in (folder / f"{side}.bp").rglob("*") if f.is_file()]
        assert sum(f.stat().st_size for f in files) > 1000
        assert any(b"tangential_traction" in f.read_bytes() for f in files)


def test_vtkhdf(folder):
    """Files have values at points and in cells for each time; an older DOLFINx is refused."""
    msh = Pair("triangle").meshes[0]
    u = fem.Function(vector_space(msh))
    fields = {"u": u, "size": ufl.dot(u, u)}
    if qs.output.fields.vtkhdf.module is None:
        write = lambda: qs.FieldWriter(folder / "a.vtkhdf", msh, fields)  # noqa: E731
        raises_everywhere(WORLD, ValueError, "no VTK-HDF", write)
        return
    with qs.FieldWriter(folder / "a.vtkhdf", msh, fields) as writer:
        for t in (1.0, 2.0):
            u.interpolate(lambda x, t=t: t * np.stack([2 + x[0], x[1]]))
            writer.write(t)
    curved = curved_triangle()
    write = lambda: qs.FieldWriter(folder / "b.vtkhdf", curved, {})  # noqa: E731
    raises_everywhere(WORLD, ValueError, "curved", write)
    x = stored(folder / "a_u.vtkhdf", "/VTKHDF/Points").reshape(-1, 3)
    found = stored(folder / "a_u.vtkhdf", "/VTKHDF/PointData/u").reshape(2, -1, 3)
    for t, values in zip((1.0, 2.0), found, strict=True):
        expected = t * np.stack([2 + x[:, 0], x[:, 1], 0 * x[:, 0]], axis=1)
        np.testing.assert_allclose(values, expected, atol=1e-14)
    owned = msh.topology.index_map(2).size_local
    x = mesh.compute_midpoints(msh, 2, np.arange(owned, dtype=np.int32))
    squares = np.sort(np.concatenate(WORLD.allgather((2 + x[:, 0]) ** 2 + x[:, 1] ** 2)))
    found = stored(folder / "a_size.vtkhdf", "/VTKHDF/CellData/u").reshape(2, -1)
    for t, values in zip((1.0, 2.0), found, strict=True):
        np.testing.assert_allclose(np.sort(values), t**2 * squares, rtol=1e-14)
