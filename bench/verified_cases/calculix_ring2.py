"""Shrink fit of two rings.

Axisymmetric, length 0.1, E = 210000, ν = 0.3. The inner ring extends from r = 0.9501 to 1.0501, the
outer ring from 1.05 to 1.15, so that the interference is 1e-4; no friction. The references are
displacements of nodes in the CalculiX test ring2 (ring2.inp, ring2.dat.ref): face-to-face contact
with a penalty of 1e7 per length, one element of degree 2 per ring, large displacements. Our model:
the same penalty, two quadrilaterals of degree 2 per ring, small strains. The small run is the same
as the full run.
"""

import numpy as np
from common.bodies import facets_at
from verified_cases.probes import at_node
from verified_cases.row import Row

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

TITLE = "Shrink fit of two rings (CalculiX, ring2)"
FAR = 0.001

LENGTH, E, NU = 0.1, 210000.0, 0.3
#: Body, r, z, component, reference.
REFERENCES = (
    ("inner", 0.9501, 0.05, 0, -4.734676e-05),
    ("inner", 1.0501, 0.05, 0, -4.615912e-05),
    ("outer", 1.05, 0.05, 0, 5.373072e-05),
    ("outer", 1.15, 0.05, 0, 5.209029e-05),
    ("inner", 1.0501, 0.1, 1, 7.494678e-07),
    ("outer", 1.05, 0.1, 1, -6.814448e-07),
)


def ring(inner, outer, side, held, comm):
    """Return residual, displacement, conditions and contact surface of a ring fixed along z."""
    corners = [[inner, 0.0], [outer, LENGTH]]
    msh = mesh.create_rectangle(comm, corners, [1, 2], mesh.CellType.quadrilateral)
    V = fem.functionspace(msh, ("Lagrange", 2, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    stress = qs.materials.linear_elastic(u, E, NU, axisymmetric=True)
    power = ufl.inner(stress, qs.materials.gradient(v, axisymmetric=True))
    F = power * qs.materials.axisymmetric_weight(msh) * ufl.dx(degree=5)
    middle = mesh.locate_entities_boundary(
        msh, 0, lambda x: np.isclose(x[0], held) & np.isclose(x[1], LENGTH / 2)
    )
    dofs = fem.locate_dofs_topological(V.sub(1), 0, middle)
    surface = qs.Surface(V, facets=facets_at(msh, 0, side), axisymmetric=True)
    return F, u, [fem.dirichletbc(0.0, dofs, V.sub(1))], surface


def run(small, comm):
    """Return rows of displacements of nodes."""
    F, u, bcs, (master, slave) = zip(
        ring(0.9501, 1.0501, 1.0501, 0.9501, comm), ring(1.05, 1.15, 1.05, 1.15, comm), strict=True
    )
    qs.ContactProblem(
        F, u, [qs.Contact(slave, master, enforcement="penalty", penalty=1e7)], bcs
    ).solve()
    bodies = dict(zip(("inner", "outer"), u, strict=True))
    return [
        Row(
            f"u_{'rz'[axis]} of the {body} ring at r = {r}, z = {z}",
            reference,
            at_node(bodies[body], (r, z))[axis],
            0.0,
            "ring2",
        )
        for body, r, z, axis, reference in REFERENCES
    ]
