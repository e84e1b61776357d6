"""Convergence test of Fourment & Popa (2005), Figure 2: upsetting of two identical elastic blocks.

Two blocks of 2 × 1 are stacked and upset between clamped dies in plane strain: u = 0 at the bottom,
u = (0, −δ) at the top, free sides, E = 1, ν = 0.3. By symmetry the right half is modelled, with
u_x = 0 on x = 0, so that each block's part is the unit square. The lower block is the master, the
upper one the slave, and a ratio of 2:3 means 2 cells of the master to 3 of the slave along the
interface. They are tied, so that the exact solution is that of a single body. It is computed with
cubic elements on a mesh that contains all others: errors are integrated there without
interpolating anything inexactly. Reported are, relative to the single body's values,

- the energy norm of the error of both blocks, and
- the L2 norm of the error of the recovered normal traction over the interface, ends included, for
  the slave and the master side.

At the die's corners the stress is singular: displacements go like r^0.71, which would limit the
energy norm to h^0.71 on uniform meshes (--grading 1) whatever the contact does. The meshes are
graded towards the die and the free side, with cells of size h^1.5 at the corner, so that single
body and matching meshes tend to order 1 and what contact loses can be seen.

    python3 demos/upsetting_convergence.py --plot upsetting.png
    mpirun -n 2 python3 demos/upsetting_convergence.py --levels 3 --json result.json

The JSON object is flat. With ratio R ("2:3" and so on), formulation F as in qs.Contact, level L
from 0 and N one of energy, slave_traction and master_traction, it has "error_N_F_R_L",
"rate_N_F_R", "h_R_L" (1 / cells of the coarser side), "error_energy_single_L" and
"rate_energy_single" (a single body with the cells of 1:1), "reference_energy_error" (cubic against
quadratic elements), "total_seconds" and the parameters.
"""

import argparse
import dataclasses
import json
import pathlib
import sys
import time
import warnings

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from output_file import output_file
from plotting import picture_file

# What a finer master does at nodes is what is measured here.
warnings.filterwarnings("ignore", "quadrature: ", qs.ContactWarning)

E, NU, DELTA = 1.0, 0.3, 0.01
FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric")
SIDES = ("master", "slave")
NORMS = ("energy", "slave_traction", "master_traction")
# Cells of master and slave along the interface on level 0; each level halves the cells. All are
# divisors of FINEST, the cells of the reference.
CELLS = {"1:1": (6, 6), "2:3": (4, 6), "3:2": (6, 4), "1:4": (3, 12), "4:1": (12, 3)}
FINEST = 12
# Ratios at which tying every slave node makes the displacement continuous.
CONFORMING = ("1:1", "1:4")


@dataclasses.dataclass
class Parameters:
    """What can be varied; the penalty is penalty_factor · E / (smallest facet).

    With the mean facet size instead, facets at the graded end of the interface would see a soft
    penalty, and it, not the meshes, would limit the traction.
    """

    levels: int = 4
    grading: float = 1.5
    penalty_factor: float = 1e3


def stress(u):
    """Stress in plane strain."""
    strain = ufl.sym(ufl.grad(u))
    identity = ufl.Identity(2)
    return E / (1 + NU) * (strain + NU / (1 - 2 * NU) * ufl.tr(strain) * identity)


def locate(msh, axis, value):
    """Facets, boundary or not, in a plane across an axis."""
    return mesh.locate_entities(msh, 1, lambda x: np.abs(x[axis] - value) < 1e-12)


def create_mesh(comm, n, lower, upper, grading):
    """Graded mesh between heights lower and upper (−1, 0 or 1), n cells wide."""
    # Errors need the cells on both sides of facets that ranks share.
    ghosts = {"ghost_mode": mesh.GhostMode.shared_facet}
    corners, cells = [[0.0, lower], [1.0, upper]], [n, n * (upper - lower)]
    msh = mesh.create_rectangle(comm, corners, cells, mesh.CellType.quadrilateral, **ghosts)
    # Coordinates that meshes have in common are equal to the last bit.
    t = np.rint(n * msh.geometry.x[:, :2]) / n
    msh.geometry.x[:, :2] = np.sign(t) * (1 - (1 - np.abs(t)) ** grading)
    msh.topology.create_connectivity(1, 2)
    return msh


class Body:
    """Elastic body with the conditions of the dies it reaches."""

    def __init__(self, msh, degree=1):
        self.mesh = msh
        self.V = fem.functionspace(msh, ("Lagrange", degree, (2,)))
        self.u = fem.Function(self.V)
        self.F = ufl.inner(stress(self.u), ufl.grad(ufl.TestFunction(self.V))) * ufl.dx
        self.bcs = [
            self.condition(axis, at, component, value)
            for axis, at, component, value in (
                (0, 0.0, 0, 0.0),  # symmetry
                (1, -1.0, 0, 0.0),
                (1, -1.0, 1, 0.0),
                (1, 1.0, 0, 0.0),
                (1, 1.0, 1, -DELTA),
            )
        ]

    def condition(self, axis, at, component, value):
        """Dirichlet condition on a component of u, on the plane across an axis."""
        V = self.V.sub(component)
        dofs = fem.locate_dofs_topological(V, 1, locate(self.mesh, axis, at))
        return fem.dirichletbc(fem.Constant(self.mesh, value), dofs, V)

    def solve(self):
        """Solve for this body alone."""
        qs.ContactProblem([self.F], [self.u], [], [self.bcs]).solve()
        return self.u


class Reference:
    """Single-body solution on a mesh that contains all others, and errors against it."""

    def __init__(self, comm, n, grading):
        self.comm = comm
        msh = create_mesh(comm, n, -1, 1, grading)
        u = Body(msh, degree=3).solve()
        # Q1 functions of a coarser mesh are Q1 here too, apart from jumps across the interface:
        # each block has its own function, which is of use in the cells of this block only.
        V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
        self.V, self.w, self.t = V, fem.Function(V), fem.Function(V)
        index_map = msh.topology.index_map(2)
        cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
        above = (mesh.compute_midpoints(msh, 2, cells)[:, 1] > 0).astype(np.int32)
        self.cells = {"master": cells[above == 0], "slave": cells[above == 1]}
        dx = ufl.Measure("dx", domain=msh, subdomain_data=mesh.meshtags(msh, 2, cells, above))
        facets = np.sort(locate(msh, 1, 0.0))
        tags = mesh.meshtags(msh, 1, facets, np.full(len(facets), 1, dtype=np.int32))
        dS = ufl.Measure("dS", domain=msh, subdomain_data=tags)(1)

        def energy(v, measure):
            return fem.form(ufl.inner(stress(v), ufl.grad(v)) * measure)

        pressure = ufl.avg(stress(u)[1, 1])  # traction on the master; minus that on the slave
        self.energy_forms, self.traction_forms = {}, {}
        for tag, (side, sign) in enumerate((("master", 1), ("slave", -1))):
            self.energy_forms[side] = energy(self.w - u, dx(tag))
            self.traction_forms[side] = fem.form((self.t("+")[1] - sign * pressure) ** 2 * dS)
        self.energy = self.total(energy(u, ufl.dx))
        self.traction = self.total(fem.form(pressure**2 * dS))
        v = Body(msh, degree=2).solve()
        #: How far quadratic elements are from cubic ones: a bound of the reference's own error.
        self.error = np.sqrt(self.total(energy(u - v, ufl.dx)) / self.energy)

    def total(self, form):
        """Integral over all ranks."""
        return self.comm.allreduce(fem.assemble_scalar(form), op=MPI.SUM)

    def energy_error(self, u, sides):
        """Square of the energy norm of the error on some sides, relative to the whole energy."""
        error = 0.0
        for side in sides:
            self.w.interpolate_nonmatching(u, self.cells[side], self.transfer(u, side))
            error += self.total(self.energy_forms[side])
        return error / self.energy

    def traction_error(self, traction, side):
        """L2 norm of the error of the normal traction on the interface, relative."""
        transfer = self.transfer(traction, side)
        self.t.interpolate_nonmatching(traction, self.cells[side], transfer)
        return np.sqrt(self.total(self.traction_forms[side]) / self.traction)

    def transfer(self, u, side):
        """Where the points of the reference's cells on one side lie on the mesh of u."""
        return fem.create_interpolation_data(
            self.V, u.function_space, self.cells[side], padding=1e-9
        )


def errors(reference, master, slave, formulation, penalty_factor):
    """Tie two bodies; errors in the order of NORMS."""
    surfaces = [qs.Surface(b.V, facets=locate(b.mesh, 1, 0.0)) for b in (slave, master)]
    penalty = penalty_factor * E / min(s.facet_size_range[0] for s in surfaces)
    contact = qs.Contact(*surfaces, formulation, qs.Tied(), penalty)
    bodies = (master, slave)
    for body in bodies:
        body.u.x.array[:] = 0
    F, u, bcs = ([getattr(b, name) for b in bodies] for name in ("F", "u", "bcs"))
    qs.ContactProblem(F, u, [contact], bcs).solve()
    energy = sum(reference.energy_error(b.u, [s]) for b, s in zip(bodies, SIDES, strict=True))
    tractions = [reference.traction_error(contact.traction(s), s) for s in SIDES[::-1]]
    return [float(value) for value in (np.sqrt(energy), *tractions)]


def rate(h, error):
    """Exponent of h that fits errors on all levels best (least squares of the logarithms)."""
    return float(np.polyfit(np.log(h), np.log(error), 1)[0])


def run(p, comm=MPI.COMM_WORLD):
    """Solve everything; returns what --json writes."""
    reference = Reference(comm, FINEST * 2 ** (p.levels - 1), p.grading)
    result = dataclasses.asdict(p) | {"reference_energy_error": float(reference.error)}
    levels = range(p.levels)
    single = []
    for level in levels:
        body = Body(create_mesh(comm, CELLS["1:1"][0] * 2**level, -1, 1, p.grading))
        single.append(float(np.sqrt(reference.energy_error(body.solve(), SIDES))))
        result[f"error_energy_single_{level}"] = single[-1]
    for ratio, (n_master, n_slave) in CELLS.items():
        h = [1 / (min(n_master, n_slave) * 2**level) for level in levels]
        result |= {f"h_{ratio}_{level}": h[level] for level in levels}
        found = {}
        for level in levels:
            master = Body(create_mesh(comm, n_master * 2**level, -1, 0, p.grading))
            slave = Body(create_mesh(comm, n_slave * 2**level, 0, 1, p.grading))
            for f in FORMULATIONS:
                values = errors(reference, master, slave, f, p.penalty_factor)
                for norm, value in zip(NORMS, values, strict=True):
                    result[f"error_{norm}_{f}_{ratio}_{level}"] = value
                    found.setdefault(f"{norm}_{f}_{ratio}", []).append(value)
        if ratio == "1:1":
            found["energy_single"] = single
        result |= {f"rate_{key}": rate(h, values) for key, values in found.items()}
    return result


def check(result):
    """Compare with what is known; returns what was checked.

    Raises:
        AssertionError: If a formulation matters on matching meshes or those give another error
            than the single body, or quasi-symmetric contact does not have the smaller error in
            the energy norm on non-matching ones.
    """
    for level in range(result["levels"]):
        for ratio in CELLS:
            ms, qs_ = (result[f"error_energy_{f}_{ratio}_{level}"] for f in FORMULATIONS[::2])
            single = result[f"error_energy_single_{level}"]
            if ratio == "1:1":
                assert abs(ms / single - 1) < 1e-2 and abs(qs_ / ms - 1) < 1e-6, (ratio, level)
            elif ratio not in CONFORMING:
                assert qs_ < ms, (ratio, level)
    return (
        "Checked: on matching meshes the formulations agree to 1e-6 and with the single body to\n"
        "1 %; on 2:3, 3:2 and 4:1 quasi-symmetric contact has the smaller error in the energy norm."
    )


def table(result):
    """Rates and errors as text."""
    last = result["levels"] - 1
    lines = [
        f"Relative errors on level {last} and rates fitted over {result['levels']} levels, as "
        "error / rate",
        "",
        f"{'master:slave':14}{'formulation':18}"
        + "".join(f"{n.replace('_', ' '):>19}" for n in NORMS),
    ]

    def entry(key):
        return f"{result[f'error_{key}_{last}']:12.2e} /{result[f'rate_{key}']:5.2f}"

    lines.append(f"{'':14}{'single body':18}{entry('energy_single')}")
    for ratio in CELLS:
        for f in FORMULATIONS:
            columns = "".join(entry(f"{norm}_{f}_{ratio}") for norm in NORMS)
            lines.append(f"{ratio:14}{f:18}{columns}")
    return "\n".join(lines)


def main():
    default = Parameters()
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--levels", type=int, default=default.levels, help="meshes of each ratio, at least 2")
    add("--grading", type=float, default=default.grading, help="1: uniform meshes")
    add("--penalty-factor", type=float, default=default.penalty_factor, help="ε h / E")
    add("--json", type=output_file, metavar="FILE", help="write errors and rates as JSON")
    add("--plot", type=picture_file, metavar="FILE", help="draw errors over h")
    a = parser.parse_args()
    if a.levels < 2 or a.grading < 1 or a.penalty_factor <= 0:
        parser.error("--levels must be at least 2, --grading at least 1, --penalty-factor positive")
    start = time.perf_counter()
    result = run(Parameters(a.levels, a.grading, a.penalty_factor))
    result["total_seconds"] = time.perf_counter() - start
    if MPI.COMM_WORLD.rank == 0:
        print(table(result))
        if a.json:
            with open(a.json, "w") as file:
                json.dump(result, file, indent=2)
        if a.plot:
            from upsetting_plot import plot

            plot(result, a.plot)
    said = check(result)
    if MPI.COMM_WORLD.rank == 0:
        print(f"\n{said}")


if __name__ == "__main__":
    main()
