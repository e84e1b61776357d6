"""The scene of the closed-die demo on a given mesh of the billet, so that a new one can follow."""

import dataclasses

import numpy as np

import ufl
from dolfinx import fem

import qsdolfinx as qs

from closed_die_tools import FLASH, skin
from common.bodies import facets_at, fix
from forming_bodies import NortonHoff

K, M = 50.0, 0.15  # MPa sᵐ at START, -
SOFTENING, START = 2.7e-3, 1100.0  # 1/K, °C
SPEED = 100.0  # of the press, mm/s
MU, M_BAR = 0.2, 0.4  # Coulomb's coefficient, and the factor of the shear yield stress at most


@dataclasses.dataclass
class Scene:
    """Billet on one mesh between the dies; what a new mesh replaces."""

    billet: NortonHoff
    temperature: fem.Function
    surface: qs.Surface
    contacts: list[qs.Contact]
    problem: qs.ContactProblem
    flow_stress: fem.Constant


def build(msh, dies, dt, friction="coulomb-tresca", solver="auto", **settings):
    """The billet on a mesh, its contacts with both dies, and the problem.

    Args:
        msh: Mesh of a quarter of the billet.
        dies: Lower and upper die, rigid tools.
        dt: First step.
        friction: "coulomb-tresca" or "norton", or "none".
        solver: Linear solver.
        settings: More of the contacts.
    """
    T = fem.Function(fem.functionspace(msh, ("Lagrange", 1)), name="temperature")
    T.x.array[:] = START
    consistency = K * ufl.exp(-SOFTENING * (T - START))
    billet = NortonHoff(msh, consistency, M, slow=1e-3 * SPEED / 20.0)
    V = billet.W.sub(0)
    billet.bcs = [fix(V, axis, facets_at(msh, axis, 0.0)) for axis in (0, 1)]
    surface = billet.surface(skin(msh))
    flow_stress = fem.Constant(msh, K * np.sqrt(3) ** (M + 1) * 5.0**M)
    laws = {
        "none": lambda: None,
        "norton": lambda: qs.Norton(0.3, K, M),
        "coulomb-tresca": lambda: qs.CoulombTresca(MU, M_BAR, flow_stress),
    }
    contacts = [
        qs.Contact(
            surface, die, unknown="velocity", dt=dt, friction=laws[friction](), **settings
        )
        for die in dies
    ]
    problem = qs.ContactProblem([billet.F], [billet.w], contacts, [billet.bcs], solver=solver)
    return Scene(billet, T, surface, contacts, problem, flow_stress)


def raise_upper(die, stroke):
    """Put the upper die where the press begins."""
    die.position = np.column_stack([np.eye(3), [0.0, 0.0, stroke]])


def stroke_of(tall, web):
    """Way of the upper die from the top of a billet of a height on the web to its end."""
    return tall - 2 * web - FLASH
