"""Contact in factors, Lᵀ W R, against the assembled contact blocks."""

from petsc4py import PETSc

import numpy as np
import pytest
from linear.test_schur import elastic_body, flow_body, problem_of
from scenes import WORLD, Pair, drag_top, largest

import qsdolfinx as qs
from qsdolfinx.contact import active_set
from qsdolfinx.system.blocks import Blocks
from qsdolfinx.system.factors import ContactFactors

FORMULATIONS = ("quasi-symmetric", "master-slave", "double-pass")
OPTIONS = {
    "overlay": lambda: {"constraints": "nodes"},
    "nodal": lambda: {"quadrature": "nodal"},
    "points": lambda: {"constraints": "points"},
    "tied": lambda: {},
    "coulomb": lambda: {"friction": qs.Coulomb(0.2), "constraints": "nodes"},
    "coulomb-points": lambda: OPTIONS["coulomb"]() | OPTIONS["points"](),
    "norton": lambda: {"friction": qs.Norton(0.3, 0.4, 0.3), "dt": 0.1, "constraints": "nodes"},
    "norton-points": lambda: OPTIONS["norton"]() | OPTIONS["points"](),
}


def waves(vec, factor):
    """Fill a vector with numbers that do not depend on the partition."""
    vec.array[:] = np.sin(factor * np.arange(*vec.owner_range) + 1.0)
    return vec


def pressed(cell, formulation, name):
    """Press and drag two blocks with wavy surfaces, so that some constraints are open."""
    options = {"enforcement": "penalty"} | OPTIONS[name]()
    law = qs.Tied() if name == "tied" else qs.Unilateral()
    pair = Pair(cell, formulation, law, n=(5, 4), wave=0.05, contact_options=options)
    drag_top(pair, 0.03)
    problem = pair.problem(solver="direct")
    problem.solve()
    return problem


def compare(problem):
    """Return largest relative differences: product, transpose, diagonal, formed, coarse; active."""
    system = problem.system
    of = system.bodies, system.contacts, system.sides
    bulk = [body.matrix() for body in system.bodies]
    blocks = Blocks(*of, bulk, bulk=False)
    blocks.assemble()
    expected = blocks.matrix.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
    factors = ContactFactors(system.contacts, system.sides, bulk, system.scales)
    P = aggregates(expected)
    coarse = factors.product.coarse(P)
    factors.update()
    coarse.update()
    x, y = (waves(vec, 1.7) for vec in expected.createVecs())
    z = y.duplicate()
    pairs = []
    for product, add in (
        (expected.mult, factors.product.add_product),
        (expected.multTranspose, factors.product.add_transposed),
    ):
        product(x, y)
        z.set(0.0)
        add(x, z)
        pairs.append((y.array_r.copy(), z.array_r.copy()))
    diagonals = expected.getDiagonal(), factors.product.diagonal()
    pairs.append(tuple(d.array_r.copy() for d in diagonals))
    for right, found in (
        (expected, factors.product.formed()),
        (expected.ptap(P), coarse.matrix),
    ):
        x, y = right.createVecs()
        waves(x, 1.3)
        right.mult(x, y)
        pairs.append((y.array_r.copy(), (found * x).array_r.copy()))
    closed = sum(active_set.num_closed(contact) for contact in system.contacts)
    problem.destroy()
    errors = [largest(a - b) / largest(a) for a, b in pairs]
    return errors, WORLD.allreduce(closed)


def aggregates(matrix):
    """Return a matrix with a third as many unknowns, each of which moves three."""
    own = matrix.getLocalSize()[0]
    coarse = -(-own // 3)
    first = WORLD.exscan(coarse) or 0
    sizes = (own, PETSc.DETERMINE), (coarse, PETSc.DETERMINE)
    pointer = np.arange(own + 1, dtype=np.int32)
    columns = (first + np.arange(own) // 3).astype(np.int32)
    return PETSc.Mat().createAIJ(sizes, csr=(pointer, columns, np.ones(own)), comm=WORLD)


@pytest.mark.parametrize("name", OPTIONS)
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_factors(cell, formulation, name):
    errors, closed = compare(pressed(cell, formulation, name))
    assert closed > 0
    assert max(errors) < 1e-13, errors


@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.2)))
def test_velocities(friction):
    """Columns are multiplied by the displacement per unknown."""
    bodies = [flow_body("triangle", 6, 0.0), elastic_body("triangle", 5)]
    problem = problem_of(bodies, "direct", friction)
    problem.solve()
    errors, closed = compare(problem)
    assert closed > 0
    assert max(errors) < 1e-13, errors


def test_rigid_tool():
    """A master without unknowns, such as a rigid tool, has no columns."""
    pair = Pair("hexahedron")
    plane = qs.RigidSurface.plane(WORLD, [0, 0, 0.02], [0, 0, 1])
    contact = qs.Contact(pair.slave, plane, penalty=30.0, friction=qs.Coulomb(0.3))
    problem = qs.ContactProblem([pair.F[1]], [pair.u[1]], [contact], [pair.bcs[1]])
    problem.solve()
    errors, closed = compare(problem)
    assert closed > 0
    assert max(errors) < 1e-13, errors
