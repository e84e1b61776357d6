"""Nodes at the rim of the overlay, whose facets the master covers in part."""

import numpy as np
import pytest
from scenes import CELLS, WORLD, box, elastic, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.contact import terms

#: Cells whose facets are products of segments, so that integrals are those along x.
PRODUCTS = ("triangle", "quadrilateral", "hexahedron")
#: Cells of the slave along x, and the end of the master: within a cell.
N, END = 4, 0.7


class Rim:
    """Unit block, the slave, above a block that ends at x = END, its face at z = z(x) < 1."""

    def __init__(self, cell, z, law=None, **options):
        self.gdim = gdim = 2 if cell in ("triangle", "quadrilateral") else 3
        axis = gdim - 1
        n = [N] + [2] * (axis - 1) + [1]
        upper = box(WORLD, n, cell, [0.0] * gdim, [1.0] * gdim, "forward")
        low, high = [-0.4] + [0.0] * axis, [END] + [1.0] * axis
        low[axis], high[axis] = -1.0, 0.0
        lower = box(WORLD, [7] + [3] * (axis - 1) + [1], cell, low, high, "backward")
        self.V = [vector_space(msh) for msh in (upper, lower)]
        facets = [plane(msh, axis, 0.0) for msh in (upper, lower)]
        x = lower.geometry.x
        x[:, axis] += z(x[:, 0]) * (1 + x[:, axis])
        self.slave, self.master = (
            qs.Surface(V, facets=f) for V, f in zip(self.V, facets, strict=True)
        )
        options = {"quadrature": "overlay", "normals": "facet", "search_radius": 0.5} | options
        self.contact = qs.Contact(self.slave, self.master, law=law, **options)

    def integrals(self, f):
        """Return ∫ N f over the covered part.

        N are the functions of the vertices along x, at x = 0, 1/N, …
        """
        s, w = np.polynomial.legendre.leggauss(4)
        out = np.zeros(N + 1)
        for i in range(N):
            a, b = i / N, min((i + 1) / N, END)
            if a < b:
                x, weight = (a + b) / 2 + (b - a) / 2 * s, (b - a) / 2 * w
                out[i] += weight @ (f(x) * (i + 1 - N * x))
                out[i + 1] += weight @ (f(x) * (N * x - i))
        return out

    @property
    def column(self):
        """Return the index of the vertex along x for each node of this rank."""
        return np.rint(N * self.slave.node_x[:, 0]).astype(int)


@pytest.mark.parametrize("height", (0.1, -0.1))
@pytest.mark.filterwarnings("ignore::qsdolfinx.ContactWarning")  # the surfaces penetrate deeply
@pytest.mark.parametrize("cell", PRODUCTS)
def test_mean_gap_of_what_is_covered(cell, height):
    """The mean gap is (∫ N g) / (∫ N) over the covered part; none where nothing is opposite."""

    def gap(x):
        return height + 0.3 * (x - 0.2)

    rim = Rim(cell, lambda x: -gap(x), formulation="master-slave", penalty=1.0)
    covered = rim.integrals(np.ones_like)
    expected = -np.divide(rim.integrals(gap), covered, where=covered > 0, out=covered * np.nan)
    np.testing.assert_allclose(rim.contact.weighted_gap(), expected[rim.column], atol=1e-13)
    assert np.isfinite(expected).sum() == N and covered[N - 1] < 0.1 < 1 / N


@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
@pytest.mark.parametrize("cell", CELLS)
def test_penalty_of_augmented_multipliers(cell, formulation):
    """λ is ε / cover times the gap, larger for a smaller cover: each node carries ε S_k ḡ_k."""
    h, eps = 0.01, 3.0
    found, gaps = {}, []
    for enforcement in ("penalty", "augmented-lagrangian"):
        options = {"enforcement": enforcement, "penalty": eps, "formulation": formulation}
        options["constraints"] = "nodes"
        rim = Rim(cell, lambda x: h + 0 * x, **options)
        contact, column = rim.contact, rim.column
        terms.evaluate(
            contact.model, *(surface.create_vec() for surface in (rim.slave, rim.master))
        )
        gap = contact.weighted_gap()[column < N]
        cover = rim.integrals(np.ones_like) / np.array([0.5, *[1] * (N - 1), 0.5]) * N
        found[enforcement] = contact.multiplier()
        force, energy = contact.force("slave")[-1], contact.stored_energy()
        if enforcement == "penalty":
            borne = END
        else:
            borne = WORLD.allreduce(rim.slave.node_area[column < N].sum())
        gaps.append(gap)
        np.testing.assert_allclose(force, eps * h * borne, rtol=1e-10)
        np.testing.assert_allclose(energy, eps * h**2 / 2 * borne, rtol=1e-10)
    np.testing.assert_allclose(np.concatenate(gaps), h, rtol=1e-10)
    if cell not in PRODUCTS:
        return
    facing = column < N
    np.testing.assert_allclose(found["penalty"], np.where(facing, eps * h, 0), rtol=1e-10)
    expected = np.where(facing, eps * h / np.where(facing, cover[column], 1), 0)
    np.testing.assert_allclose(found["augmented-lagrangian"], expected, rtol=1e-9)


@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
@pytest.mark.parametrize("cell", CELLS)
def test_jump_of_a_translation(cell, formulation):
    """In a tied slave moved as a whole, each node has the whole displacement, covered or not."""
    options = {"formulation": formulation, "enforcement": "penalty", "penalty": 1.0}
    rim = Rim(cell, np.zeros_like, qs.Tied(), **options)
    motion = np.array([0.02, -0.01, 0.03])[: rim.gdim]
    u, F, bcs = [], [], []
    for V, value in zip(rim.V, (motion, 0 * motion), strict=True):
        u.append(fem.Function(V))
        F.append(elastic(u[-1]))
        every = np.arange(len(u[-1].x.array) // rim.gdim, dtype=np.int32)
        bcs.append([fem.dirichletbc(value, every, V)])
    qs.ContactProblem(F, u, [rim.contact], bcs).solve()
    jump, facing, force = rim.contact.weighted_gap(), rim.column < N, rim.contact.force("slave")
    np.testing.assert_allclose(jump[facing] - motion, 0, atol=1e-14)
    assert np.isnan(jump[~facing]).all()
    np.testing.assert_allclose(force, -END * motion, rtol=1e-9)
