"""Multipliers of nodes beyond the master's rim, with almost no mortar weight of their support."""

from mpi4py import MPI

import numpy as np
import pytest
from scenes import WORLD, box, clamp, elastic, gathered, largest, plane, slide, vector_space

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.pairing.pair import LEAST_COVER

AUGMENTED = {"enforcement": "augmented-lagrangian", "constraints": "nodes"}
DEPTH = 0.01


class Overhang:
    """Block on a narrower one, which ends within the block's facets next to its edge.

    Args:
        part: Covered part of a facet's length.
        cell: Cell type of both meshes.
        n: Cells along an edge of the lower block, the master, and of the upper one.
        stiff: Whether all of the upper block is moved as a rigid stamp.
        E: Young's moduli of the two blocks.
        partitions: Partitions of the two meshes.
        options: Options of the contact.
    """

    def __init__(
        self,
        part,
        cell="triangle",
        n=(3, 4),
        stiff=False,
        E=(1.0, 1.0),
        partitions=("scattered", "backward"),
        **options,
    ):
        gdim = 2 if cell in ("triangle", "quadrilateral") else 3
        axis = gdim - 1
        self.width = 1 - (1 - part) / n[1]
        low, high = [0.0] * axis + [-1.0], [self.width] + [1.0] * (axis - 1) + [0.0]
        under = box(WORLD, [n[0]] * gdim, cell, low, high, partitions[0])
        over = box(WORLD, [n[1]] * gdim, cell, [0.0] * gdim, [1.0] * gdim, partitions[1])
        V = [vector_space(under), vector_space(over)]
        self.u = [fem.Function(space) for space in V]
        F = [elastic(u, modulus, 0.0) for u, modulus in zip(self.u, E, strict=True)]
        down = np.append(np.zeros(axis), -DEPTH)
        held = [slide(V[0], axis, plane(under, axis, -1.0))]
        held += [slide(V[0], i, plane(under, i, 0.0)) for i in range(axis)]
        moved = clamp(V[1], plane(over, axis, 1.0), down)
        if stiff:
            every = fem.locate_dofs_geometrical(V[1], lambda x: np.full(x.shape[1], True))
            moved = fem.dirichletbc(down, every, V[1])
        self.master = qs.Surface(V[0], facets=plane(under, axis, 0.0))
        self.slave = qs.Surface(V[1], facets=plane(over, axis, 0.0))
        self.contact = qs.Contact(self.slave, self.master, **options)
        self.problem = qs.ContactProblem(F, self.u, [self.contact], [held, [moved]])

    def multipliers(self):
        """Return the normal multipliers of all slave nodes, on all ranks."""
        values = self.contact.multiplier()
        return gathered(WORLD, values if values.ndim == 1 else -values[:, -1])


@pytest.mark.parametrize("law", (qs.Unilateral, qs.Tied))
@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("part", (0.01, 0.1))
@pytest.mark.parametrize("cell, n", (("triangle", (3, 4)), ("tetrahedron", (2, 3))))
def test_multipliers_are_pressures(cell, n, part, quadrature, law):
    """Multipliers of hardly covered nodes are pressures; plain ones are up to 10⁵ times larger."""
    scene = Overhang(part, cell, n, law=law(), quadrature=quadrature, **AUGMENTED)
    scene.problem.solve()
    area = scene.width
    pressure = scene.contact.force("slave")[-1] / area
    assert 0 < pressure and np.abs(scene.multipliers()).max() < 5 * pressure
    assert len(scene.problem.newton.record.violations) <= 10
    scene.problem.destroy()


@pytest.mark.parametrize("part", (0.01, 0.1, 0.3, 0.7))
@pytest.mark.parametrize("cell, n", (("triangle", (3, 4)), ("hexahedron", (2, 3))))
def test_patch(cell, n, part):
    """Under an overhanging flat stamp a block has a uniform pressure."""
    scene = Overhang(part, cell, n, stiff=True, quadrature="overlay", **AUGMENTED)
    scene.problem.solve()
    traction = scene.master.node_values(scene.contact.traction("master"))
    assert largest(traction[:, -1] + DEPTH) < 1e-7 * DEPTH
    assert largest(traction[:, :-1]) < 1e-7 * DEPTH
    multipliers = scene.multipliers()
    at = multipliers != 0
    if part < 0.4:  # otherwise there may be more multipliers than nodes of the block
        np.testing.assert_allclose(multipliers[at], DEPTH, rtol=5e-3)
    scene.problem.destroy()


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
def test_which_nodes_have_none(quadrature):
    """Nodes covered by less than the least part have no multiplier; a penalty has no least part."""
    for part in (0.05, 0.4, 0.5, 0.9):
        for options in (AUGMENTED, {"enforcement": "penalty", "constraints": "nodes"}):
            scene = Overhang(part, quadrature=quadrature, **options)
            plain = Overhang(
                part, quadrature=quadrature, enforcement="penalty"
            ).contact.model.pairings[0]
            points = scene.contact.model.pairings[0]
            sums = np.zeros(0)
            functions = points.multiplier_values
            np.testing.assert_allclose(functions.sum(axis=1), 1.0, atol=1e-14)
            sums = cover(scene.slave, plain)
            with_row = np.zeros(len(sums), dtype=bool)
            with_row[scene.contact.model.gaps[0].operator.row_node] = True
            least = LEAST_COVER if options is AUGMENTED else 0.0
            np.testing.assert_array_equal(with_row, (sums >= least) & (sums > 0))
            same = np.array_equal(functions, plain.multiplier_values)
            assert WORLD.allreduce(int(same)) == WORLD.size or (options is AUGMENTED and part < 0.5)
            scene.problem.destroy()


def cover(slave, points):
    """Return the part of each node's area that points of any rank cover."""
    n = points.multiplier_values.shape[1]
    values = points.weight[:, None] * points.multiplier_values
    dofs, values = (
        gathered(WORLD, a[points.slave.owner[:, :n] >= 0])
        for a in (points.slave.dofs[:, :n, 0], values)
    )
    own = slave.node_dofs[:, 0]
    return np.array([values[dofs == dof].sum() for dof in own]) / slave.node_area


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
def test_forces_are_nearer_to_those_of_fine_meshes(quadrature):
    """A soft block on a stiff, narrower one has forces closer to those of fine meshes."""
    part, E = 0.2, (10.0, 1.0)
    options = {"quadrature": quadrature, "E": E} | AUGMENTED
    forces = []
    for refine in (1, 2, 16):
        width = 1 - (1 - part) / 4
        n = (3 * refine, 4 * refine)
        scene = Overhang(1 - (1 - width) * n[1], n=n, **options)
        scene.problem.solve()
        forces.append(scene.contact.force("slave")[-1])
        scene.problem.destroy()
    errors = np.abs(np.array(forces[:2]) / forces[2] - 1)
    assert errors[1] < errors[0] < 0.06


@pytest.mark.parametrize("partition", ("first", "last", "forward"))
def test_any_partition(partition):
    """Forces and multipliers do not depend on the partition of the facets."""
    found = []
    for partitions in (("backward", "backward"), (partition, "scattered")):
        scene = Overhang(0.1, "tetrahedron", (2, 3), partitions=partitions, **AUGMENTED)
        scene.problem.solve()
        force, multipliers = scene.contact.force("slave"), np.sort(scene.multipliers())
        found.append(np.append(force, multipliers))
        scene.problem.destroy()
    np.testing.assert_allclose(found[0], found[1], atol=1e-8 * np.abs(found[0]).max())


@pytest.mark.parallel
def test_what_ranks_cover_of_a_node_adds_up():
    """Covered parts below a tenth in two facets of a node add up, on one rank or two."""
    found = []
    for comm in (MPI.COMM_SELF, WORLD):
        partition = "forward" if comm is WORLD else None
        over = box(comm, (3, 1), "quadrilateral", [0.0, 0.0], [3.0, 1.0], partition)
        x = over.geometry.x[:, 0]
        x[:] = np.interp(x, range(4), (0.0, 1.0, 1.1, 2.1))
        under = box(comm, (4, 2), "quadrilateral", [0.0, -1.0], [1.15, 0.0])
        surfaces = [qs.Surface(vector_space(m), facets=plane(m, 1, 0.0)) for m in (over, under)]
        contact = qs.Contact(
            *surfaces, formulation="master-slave", quadrature="overlay", **AUGMENTED
        )
        points = contact.pairing
        shares = points.weight[:, None] * np.sort(points.multiplier_values, axis=1)
        found.append(comm.allreduce(shares.sum(axis=0)))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-12)
