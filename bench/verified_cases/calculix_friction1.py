"""A block is pressed on a cube and sticks to it elastically.

A block of side 0.5 is placed on the middle of a unit cube, both with E = 210000, ν = 0.3. A
pressure of 100 acts on its top, which cannot move sideways; the bottom of the cube is fixed.
Coulomb friction, μ = 0.2, sticks everywhere, with a stiffness of 47000. The references are contact
stresses at the nodes of the block, averaged over nodes that are equal by symmetry, in the CalculiX
test friction1 (friction1.inp, friction1.dat.ref): node-to-face contact with a penalty of 1e7 and
large displacements. Our model: the same meshes of 4 × 4 × 4 bricks and the same penalties,
evaluated at the nodes of the block ("master-slave", "nodal"), small strains. The penalty of
CalculiX is softer at small depths, by 2 % at the corner and 5 % in the middle; our model does not
include this. The small run is the same as the full run.
"""

import numpy as np
from common.bodies import facets_at, fix, measure
from verified_cases.probes import along
from verified_cases.row import Row

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

TITLE = "Block that sticks to a cube (CalculiX, friction1)"
FAR = 0.002

#: Name of the node, x and y, pressure, friction.
REFERENCES = (
    ("corner", (0.75, 0.75), 133.3510, 3.1836),
    ("middle of the edge", (0.75, 0.5), 101.3087, 2.0412),
    ("quarter", (0.625, 0.625), 102.3614, 1.6086),
    ("middle", (0.5, 0.5), 54.45570, None),
)


def cube(low, high, comm):
    """Return the residual without loads, displacement, test function and mesh."""
    msh = mesh.create_box(comm, [low, high], [4, 4, 4], mesh.CellType.hexahedron)
    V = fem.functionspace(msh, ("Lagrange", 1, (3,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    F = ufl.inner(qs.materials.linear_elastic(u, 210000.0, 0.3), ufl.grad(v)) * ufl.dx
    return F, u, v, msh


def solve(comm):
    """Solve one step and return the contact."""
    F_c, u_c, _, cube_mesh = cube([0.0, 0.0, 0.0], [1.0, 1.0, 1.0], comm)
    F_b, u_b, v_b, block_mesh = cube([0.25, 0.25, 1.0], [0.75, 0.75, 1.5], comm)
    top, bottom = facets_at(block_mesh, 2, 1.5), facets_at(cube_mesh, 2, 0.0)
    F_b += 100.0 * v_b[2] * measure(block_mesh, top)
    bcs = [
        [fix(u_b.function_space, axis, top) for axis in (0, 1)],
        [fix(u_c.function_space, axis, bottom) for axis in (0, 1, 2)],
    ]
    contact = qs.Contact(
        qs.Surface(u_b.function_space, facets=facets_at(block_mesh, 2, 1.0)),
        qs.Surface(u_c.function_space, facets=facets_at(cube_mesh, 2, 1.0)),
        formulation="master-slave",
        quadrature="nodal",
        enforcement="penalty",
        penalty=1e7,
        friction=qs.Coulomb(0.2),
        friction_penalty=47000.0,
    )
    qs.ContactProblem([F_b, F_c], [u_b, u_c], [contact], bcs).solve()
    return contact


def run(small, comm):
    """Return rows of pressures and friction stresses at nodes of the block."""
    contact = solve(comm)
    block = contact.slave
    x, t = along(block, block.node_values(contact.traction("slave")))
    rows = []
    for name, point, pressure, friction in REFERENCES:
        (node,) = np.flatnonzero(np.all(np.isclose(x[:, :2], point), axis=1))
        rows.append(Row(f"pressure at the {name}", pressure, t[node, 2], 0.0, "friction1"))
        if friction:
            ours = np.linalg.norm(t[node, :2])
            rows.append(Row(f"friction at the {name}", friction, ours, 0.0, "friction1"))
    return rows
