"""Sliding wedge, after the NAFEMS contact benchmark CGS-4, against the closed form.

A deformable wedge lies on a deformable incline of slope tan α = 0.1; the meshes of the two sides do
not match. The wedge carries the vertical load G and is pushed up the incline by the horizontal
force F. Balance of the wedge at full slip gives, for any elastic moduli,

    F / G = (tan α + μ) / (1 − μ tan α),

0.1, 0.202020, 0.306122, 0.412371 for μ = 0, 0.1, 0.2, 0.3.

G is a dead load on the horizontal top. The wedge is pushed by a prescribed horizontal displacement
of its back, whose nodes are free to move up: the guide can take a moment, but no vertical force, so
that all of G is carried by the incline. The lowest nodes of the back, next to the contact, are not
guided. Thus F is measured where no contact force acts: it is the sum of the residuals of the
elastic form at the guided nodes, and not made from the contact forces. These are printed beside
it, for two-half-pass contact those on the wedge. μ = 0 is solved without friction.

The back is pushed in steps until all nodes in contact slip, and twice more. By default points and
normals stay as they are paired at first (small sliding); with --travel the steps are made by
qs.TimeStepper, which pairs anew, until the wedge has gone that far.

    python3 demos/sliding_wedge.py --mu 0.3 --plot wedge.png
    mpirun -n 2 python3 demos/sliding_wedge.py --mu 0.1 --formulation double-pass --json wedge.json
    python3 demos/sliding_wedge.py --mu 0.2 --quadrature overlay --travel 1

Key of the JSON object:

- ratio_error: relative deviation of F / G from the closed form, a positive number.
"""

import argparse
import dataclasses
import json
import pathlib
import sys

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, la, mesh

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from output_file import output_file
from plotting import picture_file
from wedge_plot import Look

SLOPE, LOAD, E, NU = 0.1, 1.0, 1e3, 0.3
FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric", "two-half-pass")
TWO_PASSES = ("double-pass", "two-half-pass")
#: Most steps to full slip.
MAX_STEPS = 30


@dataclasses.dataclass
class Parameters:
    """One wedge; lengths, forces and stresses in any consistent units."""

    mu: float = 0.2
    formulation: str = "quasi-symmetric"
    quadrature: str = "nodal"
    enforcement: str = "penalty"
    n: int = 1
    push: float = 1e-3
    travel: float = 0.0


def closed_form(mu):
    """F / G at full slip."""
    return (SLOPE + mu) / (1 - mu * SLOPE)


# --- Bodies


class Body:
    """An elastic body between two lines over an interval of x."""

    def __init__(self, comm, n, ends, low, high):
        self.mesh = mesh.create_rectangle(
            comm, [[ends[0], 0.0], [ends[1], 1.0]], n, mesh.CellType.quadrilateral
        )
        x = self.mesh.geometry.x
        #: Height in the body, from 0 at its lower line to 1.
        s = x[:, 1].copy()
        self.lower, self.upper, self.back = (
            self.facets(lambda x: np.isclose(x[1], 0)),
            self.facets(lambda x: np.isclose(x[1], 1)),
            # Without the facet at the lower line.
            self.facets(lambda x: np.isclose(x[0], ends[0]) & (x[1] > 0.5 / n[1])),
        )
        x[:, 1] = (1 - s) * low(x[:, 0]) + s * high(x[:, 0])
        self.V = fem.functionspace(self.mesh, ("Lagrange", 1, (2,)))
        self.u, self.v = fem.Function(self.V), ufl.TestFunction(self.V)
        self.stress = qs.materials.linear_elastic(self.u, E, NU)
        self.F = ufl.inner(self.stress, ufl.grad(self.v)) * ufl.dx

    def facets(self, where):
        return mesh.locate_entities_boundary(self.mesh, 1, where)

    def hold(self, facets):
        """Condition on both components."""
        dofs = fem.locate_dofs_topological(self.V, 1, facets)
        return fem.dirichletbc(np.zeros(2), dofs, self.V)


class Wedge(Body):
    """The wedge under its load, with its back guided along x."""

    def __init__(self, comm, n):
        super().__init__(comm, n, (1.2, 4.1), lambda x: SLOPE * x, lambda x: 1.3 + 0 * x)
        tags = mesh.meshtags(self.mesh, 1, np.sort(self.upper), np.ones_like(self.upper))
        ds = ufl.Measure("ds", domain=self.mesh, subdomain_data=tags)(1)
        length = self.sum(fem.assemble_scalar(fem.form(fem.Constant(self.mesh, 1.0) * ds)))
        self.F += fem.Constant(self.mesh, LOAD / length) * self.v[1] * ds
        self.shift = fem.Constant(self.mesh, 0.0)
        dofs = fem.locate_dofs_topological(self.V.sub(0), 1, self.back)
        self.bc = fem.dirichletbc(self.shift, dofs, self.V.sub(0))
        self.guided = dofs[dofs < self.V.dofmap.index_map.size_local * 2]
        self.residual = fem.form(self.F)

    def sum(self, value):
        return self.mesh.comm.allreduce(value, op=MPI.SUM)

    def push(self):
        """Horizontal force on the guided nodes. Collective."""
        b = fem.assemble_vector(self.residual)
        b.scatter_reverse(la.InsertMode.add)
        return self.sum(float(b.array[self.guided].sum()))


def build(comm, p):
    """Wedge, contact and problem."""
    wedge = Wedge(comm, (13 * p.n, 6 * p.n))
    incline = Body(comm, (26 * p.n, 5 * p.n), (0.0, 6.0), lambda x: -1 + 0 * x, lambda x: SLOPE * x)
    wedge.incline = incline  # for the picture
    options = {"quadrature": p.quadrature, "enforcement": p.enforcement}
    if p.formulation in TWO_PASSES:
        # Multipliers on both sides cannot close every gap of meshes that do not match.
        options["gap_tolerance"] = 1e-5
    contact = qs.Contact(
        qs.Surface(wedge.V, facets=wedge.lower),
        qs.Surface(incline.V, facets=incline.upper),
        p.formulation,
        friction=qs.Coulomb(p.mu) if p.mu != 0 else None,
        **options,
    )
    bcs = [[wedge.bc], [incline.hold(incline.lower)]]
    problem = qs.ContactProblem([wedge.F, incline.F], [wedge.u, incline.u], [contact], bcs)
    return wedge, contact, problem


# --- Steps


def state(wedge, contact):
    """What the table shows of a step. Collective."""
    force = contact.force("slave")
    sides = ("slave", "master") if contact.formulation in TWO_PASSES else ("slave",)
    active = slipping = 0
    for side in sides:
        active += wedge.sum(int(contact.active(side).sum()))
        if contact.friction is not None:
            slipping += wedge.sum(int(contact.slipping(side).sum()))
    return {
        "shift": float(wedge.shift.value),
        "ratio": wedge.push() / LOAD,
        "contact_ratio": -force[0] / force[1],
        "carried": force[1] / LOAD,
        "active": active,
        "slipping": active if contact.friction is None else slipping,
    }


def steps(p, wedge, contact, problem):
    """Push the wedge, and yield the state after each step."""
    size = p.push
    stepper = None
    if p.travel > 0:
        size = p.travel / np.ceil(p.travel / 0.1)  # less than half a facet
        # So that a failed step is made again with a part of the displacement.
        stepper = qs.TimeStepper(
            problem, size, lambda t, dt: setattr(wedge.shift, "value", t), dt_max=size
        )
    after = 0
    for _ in range(MAX_STEPS if stepper is None else 10**6):
        if stepper is None:
            wedge.shift.value += size
            problem.solve()
        else:
            stepper.step(p.travel)
        now = state(wedge, contact) | {"iterations": (stepper or problem).num_iterations}
        yield now
        after = after + 1 if now["slipping"] == now["active"] else 0
        if (after == 3) if stepper is None else (stepper.t >= p.travel):
            return


def run(p, comm=MPI.COMM_WORLD, look=None):
    """Solve; returns what --json writes, and the states after the steps.

    look is called with the two bodies at the end.
    """
    wedge, contact, problem = build(comm, p)
    table = list(steps(p, wedge, contact, problem))
    if look is not None:
        look(wedge, wedge.incline)
    problem.destroy()
    return {"ratio_error": abs(table[-1]["ratio"] / closed_form(p.mu) - 1)}, table


def main():
    default = Parameters()
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--mu", type=float, default=default.mu, help="coefficient of friction")
    add("--formulation", choices=FORMULATIONS, default=default.formulation)
    add("--quadrature", choices=("nodal", "overlay"), default=default.quadrature)
    add("--enforcement", choices=("penalty", "augmented-lagrangian"), default=default.enforcement)
    add("--n", type=int, default=default.n, help="factor of the numbers of cells along an edge")
    add("--push", type=float, default=default.push, help="displacement of the back in a step")
    add("--travel", type=float, default=default.travel, help="way to go, pairing in every step")
    add("--json", type=output_file, metavar="FILE")
    add("--plot", type=picture_file, metavar="FILE", help="draw stresses and F / G")
    arguments = vars(parser.parse_args())
    filename, picture = arguments.pop("json"), arguments.pop("plot")
    p = Parameters(**arguments)
    if not 0 <= p.mu < 10:
        parser.error("--mu: from 0 to below 10, where the wedge would jam")
    look = Look() if picture else None
    result, table = run(p, look=look)
    if MPI.COMM_WORLD.rank == 0:
        print("   shift       F / G  of contact  nodes closed  slipping  iterations")
        for row in table:
            print(
                f"{row['shift']:8.4f}{row['ratio']:12.8f}{row['contact_ratio']:12.8f}"
                f"{row['active']:14}{row['slipping']:10}{row['iterations']:12}"
            )
        print(f"closed form {closed_form(p.mu):.8f}, ratio_error {result['ratio_error']:.2e}")
        if filename:
            with open(filename, "w") as file:
                json.dump(result, file, indent=2)
        if picture:
            look.plot(picture, table, closed_form(p.mu))
    if table[-1]["slipping"] != table[-1]["active"]:
        raise SystemExit("not all nodes slip yet: the closed form does not hold; --push further")


if __name__ == "__main__":
    main()
