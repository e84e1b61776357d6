"""Newton's method with friction: what the remedies of qsdolfinx/friction/stick_slip.py do.

Two elastic blocks with wavy contact surfaces are pressed together, dragged and dragged back by the
displacement of the upper one's top, in four steps. Printed are, for each law, the solves that do
not converge (with the line search that ContactProblem tries then) and Newton iterations per solve,
over cells, mesh sizes, formulations and quadratures: as it is; if nodes whose slip turns are not
made to stick; if they do not get Kačanov's rigidity either; and if nodes that open again and again
keep their friction.

    python3 bench/friction_newton.py [--cells triangle …]
"""

import argparse
import itertools

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.friction import stick_slip

COMM = MPI.COMM_WORLD
FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric")
SIZES = {
    "triangle": ((8, 6), (14, 9)),
    "quadrilateral": ((12, 7),),
    "tetrahedron": ((3, 2), (4, 6)),
    "hexahedron": ((3, 2), (5, 4)),
}
LAWS = {
    "Coulomb": qs.Coulomb(0.3),
    "Tresca": qs.Tresca(0.01),
    "Coulomb-Tresca": qs.CoulombTresca(0.4, 0.3, 0.06),
    "Norton": qs.Norton(0.3, 0.4, 0.3),
    "sticking": qs.Sticking(),
}
#: Displacement of the top after each step: along x and down.
STEPS = ((0.0, -0.1), (0.05, -0.1), (0.3, -0.1), (0.0, -0.1))


def block(cell, n, low, E):
    """An elastic block with the lower corner at height low, wavy where it is to touch."""
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    axis, create = gdim - 1, mesh.create_rectangle if gdim == 2 else mesh.create_box
    corner = np.append(np.zeros(axis), low)
    msh = create(COMM, [corner, corner + 1], [n] * axis + [2], mesh.CellType[cell])
    V = fem.functionspace(msh, ("Lagrange", 1, (gdim,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    mu, lmbda = E / 2.6, 0.3 * E / 1.3 / 0.4
    strain = ufl.sym(ufl.grad(u))
    F = (2 * mu * ufl.inner(strain, ufl.grad(v)) + lmbda * ufl.div(u) * ufl.div(v)) * ufl.dx
    near, far = (
        mesh.locate_entities_boundary(msh, axis, lambda x, z=z: np.isclose(x[axis], z))
        for z in (0.0, 1.0 if low == 0 else -1.0)
    )
    value = fem.Constant(msh, np.zeros(gdim))
    bc = fem.dirichletbc(value, fem.locate_dofs_topological(V, axis, far), V)
    x = msh.geometry.x
    phase = x[:, :axis] @ np.array([7.0, 5.0])[:axis]
    x[:, axis] += 0.02 * (1 - np.abs(x[:, axis])) * np.sin(phase + 2 * low)
    return u, F, bc, value, qs.Surface(V, facets=near)


def scene(cell, n, formulation, quadrature, law):
    """Iterations of the solves that converge, and how many do not."""
    lower, upper = block(cell, n[0], -1.0, 1.0), block(cell, n[1], 0.0, 2.0)
    contact = qs.Contact(
        upper[4],
        lower[4],
        formulation,
        penalty=30.0,
        quadrature=quadrature,
        enforcement="penalty",
        friction=law,
        dt=0.5 if law.needs_dt else None,
    )
    bodies = lower, upper
    problem = qs.ContactProblem(
        [b[1] for b in bodies], [b[0] for b in bodies], [contact], [[b[2]] for b in bodies]
    )
    iterations, failures = [], 0
    for shift, press in STEPS:
        upper[3].value[0], upper[3].value[-1] = shift, press
        try:
            problem.solve()
            iterations.append(problem.num_iterations)
        except qs.ConvergenceError:
            failures += 1
    problem.destroy()
    return iterations, failures


VARIANTS = {
    "as it is": {},
    "never made to stick": {"MAX_STICKS": 0},
    "nor Kačanov's rigidity": {"MAX_STICKS": 0, "MAX_WAIT": 0},
    "friction never lost": {"MAX_OPENINGS": np.inf},
    "none of them": {"MAX_STICKS": 0, "MAX_WAIT": 0, "MAX_OPENINGS": np.inf},
}
DEFAULTS = {name: getattr(stick_slip, name) for name in ("MAX_STICKS", "MAX_WAIT", "MAX_OPENINGS")}


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cells", nargs="+", choices=tuple(SIZES), default=tuple(SIZES))
    cells = parser.parse_args().cells
    cases = [(cell, n) for cell in cells for n in SIZES[cell]]
    say = print if COMM.rank == 0 else lambda *args, **kwargs: None
    say(f"{'law':16}" + "".join(f"{name:>24}" for name in VARIANTS))
    say(" " * 16 + f"{'failed':>13} {'its/solve':>11}" * len(VARIANTS))
    for name, law in LAWS.items():
        cells_of_row = []
        for changes in VARIANTS.values():
            for constant, value in (DEFAULTS | changes).items():
                setattr(stick_slip, constant, value)
            iterations, failures = [], 0
            product = itertools.product(cases, FORMULATIONS, ("nodal", "overlay"))
            for (cell, n), formulation, quadrature in product:
                found, failed = scene(cell, n, formulation, quadrature, law)
                iterations += found
                failures += failed
            count = len(iterations) + failures
            cells_of_row.append(f"{failures:>6} / {count:<4} {np.mean(iterations):>11.1f}")
        say(f"{name:16}" + "".join(cells_of_row), flush=True)


if __name__ == "__main__":
    main()
