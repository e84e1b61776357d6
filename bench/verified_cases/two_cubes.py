"""Two cubes pressed on each other, compared with asimov-contact (`dolfinx_contact`).

asimov-contact uses unbiased Nitsche contact. n³ non-matching hexahedra of degree 1, E = 3e4 and
1.3e4, ν = 0.3, the bottom clamped, the top clamped and moved down by 0.02, frictionless
(`bench/peers/cubes.py`): the displacement is prescribed, and the force is compared. The reference
is the force of asimov-contact 0.9.0 on the same meshes, with incomplete Cholesky, recorded in
`bench/results/peers.json`; the scatter is the spread over its linear solvers. Our model: overlay,
augmented Lagrangian.
"""

import json
import pathlib
import sys

import numpy as np
from common.bodies import facets_at
from verified_cases.row import Row

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1] / "peers"))

import cubes

BENCH = pathlib.Path(__file__).resolve().parents[1]

TITLE = "Two cubes (asimov-contact)"
FAR = 1e-4


def recorded(sizes):
    """Return the force of asimov-contact and the relative spread over its linear solvers."""
    rows = json.loads((BENCH / "results" / "peers.json").read_text())["rows"]
    forces = {
        row["run"]: row["force"]
        for row in rows
        if row["program"] == "asimov" and tuple(row["sizes"]) == sizes
    }
    values = list(forces.values())
    return forces["CG, incomplete Cholesky"], (max(values) - min(values)) / max(values)


def body(comm, i, n):
    """Return form, unknowns, condition and surface of the lower cube (0) or the upper cube (1)."""
    corners = [[0.0, 0.0, i], [1.0, 1.0, i + 1]]
    msh = mesh.create_box(comm, corners, [n] * 3, cell_type=mesh.CellType.hexahedron)
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    moduli = (fem.Constant(msh, value) for value in (cubes.E[i], cubes.NU))
    F = ufl.inner(qs.materials.linear_elastic(u, *moduli), ufl.grad(v)) * ufl.dx(degree=3)
    dofs = fem.locate_dofs_topological(V, 2, facets_at(msh, 2, 2.0 * i))
    bc = fem.dirichletbc(np.array([0.0, 0.0, i * cubes.PRESS]), dofs, V)
    return F, u, [bc], qs.Surface(V, facets=facets_at(msh, 2, 1.0))


def run(small, comm):
    """Rows of the case."""
    rows = []
    for sizes in ((22, 18),) if small else ((22, 18), (35, 28)):
        F, u, bcs, (lower, upper) = zip(
            *(body(comm, i, n) for i, n in enumerate(sizes)), strict=True
        )
        contact = qs.Contact(upper, lower)
        problem = qs.ContactProblem(F, u, [contact], bcs, linear_solver="amg")
        problem.solve()
        reference, scatter = recorded(sizes)
        name = f"force, {sizes[0]}³ and {sizes[1]}³ cells"
        source = "asimov-contact 0.9.0, `bench/results/peers.json`"
        rows.append(Row(name, reference, abs(contact.force("slave")[2]), scatter, source))
        problem.destroy()
    return rows
