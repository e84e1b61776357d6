"""Upsetting of an elasto-plastic billet, Ø20 × 30 mm, by 60 % between dies that it sticks to.

The classic test of Lippmann (Metal Forming Plasticity, 1979) and Taylor & Becker (1983): E = 200 GPa,
ν = 0.3, yield stress 700 MPa, hardening 300 MPa. Axisymmetric, upper half: the die comes down by
9 mm, and the side folds on to it. Contact is with a rigid plane, with qs.Sticking().

    python3 bench/upsetting_j2.py
    python3 bench/upsetting_j2.py --cells 12 --steps 36 --json upsetting.json
    python3 bench/upsetting_j2.py --element taylor-hood

A row a step: the reduction of height in per cent; the force (kN); Siebel's estimate of it for dies
with the friction factor 1, π R² Y (1 + 2 R / (3 √3 h)), where Y = σ_Y + H ln(h₀/h) and R is the
radius of a cylinder of the same volume; the force without friction, π R² Y; the billet's radius (mm)
at half height, and where it leaves the die; its change of volume, and the error of the energies,
the die's work less what is stored and dissipated, both relative.
"""

import argparse
import json

from mpi4py import MPI

import basix.ufl
import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

RADIUS, HEIGHT, STROKE = 10.0, 15.0, 9.0  # mm, of the half billet
E, NU, YIELD, HARDENING = 200e3, 0.3, 700.0, 300.0  # MPa
ELEMENTS = ("mini", "taylor-hood", "p2")


def space(msh, element):
    """Displacement and pressure, or with "p2" the displacement alone."""
    if element == "mini":
        return qs.materials.mini_space(msh)
    cell = msh.basix_cell()
    P2 = basix.ufl.element("Lagrange", cell, 2, shape=(2,))
    mixed = basix.ufl.mixed_element([P2, basix.ufl.element("Lagrange", cell, 1)])
    return fem.functionspace(msh, mixed if element == "taylor-hood" else P2)


class Billet:
    """The upper half of the billet in any of its shapes, z = 0 at half height.

    Args:
        msh: Mesh in (r, z).
        die: Plane that moves down.
        element: One of ELEMENTS.
    """

    def __init__(self, msh, die, element="mini"):
        self.mesh = msh
        self.w = fem.Function(space(msh, element))
        V = self.w.function_space if element == "p2" else self.w.function_space.sub(0)
        degree = 2 if element == "p2" else 4  # with more points it would lock
        self.body = qs.J2Plasticity(
            self.w, E, NU, YIELD, HARDENING, axisymmetric=True, degree=degree
        )
        axis, middle = (self.facets(lambda x, k=k: np.isclose(x[k], 0)) for k in (0, 1))
        bcs = [fix(V, 0, axis), fix(V, 1, middle)]
        outer = self.facets(lambda x: np.maximum(x[0], x[1]) > 1e-9)
        outer = np.setdiff1d(outer, np.concatenate([axis, middle]))
        # Gaps of nodes from a plane are exact, and nodes of a side that folds on to it see it at once.
        surface = qs.Surface(V, facets=outer, axisymmetric=True)
        self.contact = qs.Contact(surface, die, friction=qs.Sticking(), quadrature="nodal" if element == "mini" else "overlay")
        self.problem = qs.ContactProblem([self.body.residual], [self.w], [self.contact], [bcs])
        around = qs.materials.axisymmetric_weight(msh)
        F = ufl.Identity(3) + qs.materials.gradient(displacement(self.w), axisymmetric=True)
        self._volume = fem.form(around * ufl.det(F) * self.body.dx)
        self._energy = fem.form(self.body.stored_energy), fem.form(self.body.dissipated_energy)

    def facets(self, where):
        return mesh.locate_entities_boundary(self.mesh, 1, where)

    def total(self, form):
        return self.mesh.comm.allreduce(fem.assemble_scalar(form))

    def volume(self):
        return self.total(self._volume)

    def energy(self):
        """Stored, and dissipated. Collective."""
        return [self.total(form) for form in self._energy]


def displacement(w):
    """Of a function in any of the spaces."""
    return w if w.ufl_shape == (2,) else ufl.split(w)[0]


def fix(V, axis, facets):
    component = V.sub(axis)
    return fem.dirichletbc(0.0, fem.locate_dofs_topological(component, 1, facets), component)
