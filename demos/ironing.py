"""Shallow ironing: a hard indenter with a circular edge, pressed into a soft slab and dragged.

After Fischer & Wriggers (2006), Yastrebov (2013) and Poulios & Renard (2015). Plane strain,
neo-Hookean quadrilaterals, ν = 0.3: a slab (E = 1, height 1, clamped at its bottom) with facets of
--h, and an indenter (E = 10, about 1.6 × 0.8, lower edge of radius 4) with facets of ratio × h,
which fit those of the slab nowhere. The indenter's top is displaced by --depth downwards, and then
dragged along the slab, with Coulomb friction. The indenter is the slave (--swap: the slab is).

    python3 demos/ironing.py --formulation quasi-symmetric --quadrature overlay --json ironing.json
    mpirun -n 2 python3 demos/ironing.py --quadrature nodal --formulation master-slave
    python3 demos/ironing.py --plot ironing.png

Forces repeat with each facet of the slab that the indenter has passed. The plateau is the last 12
facets of the slide, after some 4 in which everything starts to slip. Its number of steps has no
divisor in common with 12, so that each samples another place of the facet. (Fx, Fy) is the force on
the indenter's top. Keys of the JSON object:

- force_ratio_error: |mean of |Fx/Fy| over the plateau / μ − 1|;
- force_oscillation: (largest − smallest Fx) / mean of Fx, over the plateau;
- steps: made in all, --steps and what cutbacks add;
- cutbacks: attempts that failed.

|Fx/Fy| is not μ even without errors, and h does not matter. In steady sliding all the work Fx V is
dissipated, ∫ μ p |slip rate|, and the slab's surface under the indenter slips by less than V: by
1.0 % at the default depth. Against that, Fy is less than ∫ p, by 0.1 %; by more if it is deeper.
"""

import argparse
import dataclasses
import json
import math
import pathlib
import sys
import typing

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, la, mesh

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from ironing_output import Output
from output_file import output_file
from plotting import picture_file

E_SLAB, E_INDENTER, NU = 1.0, 10.0, 0.3
HEIGHT = 1.0  # of the slab
WIDTH, THICKNESS, RADIUS = 1.6, 0.8, 4.0  # of the indenter and its edge
MARGIN = 3.0  # of the slab beside the indenter, at the start and at the end
PRESSING = 6  # steps
RUN_IN = 4  # facets of the slab
ENFORCEMENTS = ("penalty", "augmented-lagrangian")
FORMULATIONS = ("master-slave", "double-pass", "quasi-symmetric", "two-half-pass")


@dataclasses.dataclass
class Parameters:
    """One ironing; lengths in units of the slab's height, stresses in its Young's modulus."""

    formulation: str = "quasi-symmetric"
    quadrature: str = "overlay"
    enforcement: str = "penalty"
    penalty: float | None = None
    mu: float = 0.3
    h: float = 0.1
    ratio: float = 1.37
    depth: float = 0.06
    steps: int = 119
    facets: int = 12  # of the plateau
    swap: bool = False
    output: str | None = None
    verbose: bool = False

    def plan(self):
        """Steps of the run-in and of the plateau."""
        sliding = self.steps - PRESSING
        plateau = sliding * self.facets // (self.facets + RUN_IN)
        while math.gcd(plateau, self.facets) > 1:
            plateau -= 1
        if plateau < 2 * self.facets:
            raise ValueError(f"steps: {self.steps} are less than two per facet of the slide")
        return sliding - plateau, plateau


class Row(typing.NamedTuple):
    """Where the run is after a step; force and work are those of the indenter's top."""

    t: float  # steps, if none is cut back
    dt: float
    slide: float  # in facets of the slab
    fx: float
    fy: float
    work: float
    dissipated: float
    elastic: float


# --- Bodies


class Body:
    """A neo-Hookean rectangle, bent to a shape, with one edge in contact and the other held."""

    def __init__(self, comm, E, n, corners, shape, contact):
        msh = self.mesh = mesh.create_rectangle(comm, corners, n, mesh.CellType.quadrilateral)
        edges = [
            mesh.locate_entities_boundary(msh, 1, lambda x, y=y: np.isclose(x[1], y))
            for _, y in corners
        ]
        msh.geometry.x[:, :2] = np.column_stack(shape(*msh.geometry.x.T[:2]))
        V = self.V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
        self.u = fem.Function(V)
        lame = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
        self.stress = qs.materials.neo_hookean(self.u, *lame)
        self.F = ufl.inner(self.stress, ufl.grad(ufl.TestFunction(V))) * ufl.dx
        self._residual = fem.form(self.F)
        self._energy = fem.form(qs.materials.neo_hookean_energy(self.u, *lame) * ufl.dx)
        self.surface = qs.Surface(V, facets=edges[contact])
        self.displacement = fem.Constant(msh, (0.0, 0.0))
        held = fem.locate_dofs_topological(V, 1, edges[1 - contact])
        self._held = held[held < V.dofmap.index_map.size_local]
        self.bcs = [fem.dirichletbc(self.displacement, held, V)]

    def reaction(self):
        """Force that holds the body where it is held. Collective."""
        b = fem.assemble_vector(self._residual)
        b.scatter_reverse(la.InsertMode.add)
        return self.mesh.comm.allreduce(b.array.reshape(-1, 2)[self._held].sum(axis=0))

    def energy(self):
        """Elastic energy. Collective."""
        return self.mesh.comm.allreduce(fem.assemble_scalar(self._energy))


def create_bodies(comm, p):
    """The indenter, where its slide begins, and the slab."""
    slide = (RUN_IN + p.facets) * p.h
    n = math.ceil((slide + WIDTH + 2 * MARGIN) / p.h)
    layers = max(3, round(0.7 * HEIGHT / p.h))
    slab = Body(
        comm,
        E_SLAB,
        [n, layers],
        [(0.0, -HEIGHT), (n * p.h, 0.0)],
        lambda x, y: (x, -HEIGHT * (-y / HEIGHT) ** 1.4),  # finer towards the contact
        contact=1,
    )
    start = (n * p.h - slide) / 2
    m = round(WIDTH / (p.ratio * p.h))
    width = m * p.ratio * p.h  # facets of just that size, and nearly WIDTH

    def rounded(x, y):
        low = RADIUS - np.sqrt(RADIUS**2 - x**2)
        return start + x, low + (1 - low / THICKNESS) * y

    indenter = Body(
        comm,
        E_INDENTER,
        [m, max(3, round(0.7 * m * THICKNESS / WIDTH))],
        [(-width / 2, 0.0), (width / 2, THICKNESS)],
        rounded,
        contact=0,
    )
    return indenter, slab


def build(comm, p):
    """Indenter, slab, contact, and the stepper, whose time counts steps."""
    per_step = p.facets / p.plan()[1] * p.h
    bodies = indenter, slab = create_bodies(comm, p)
    penalty = p.penalty
    if penalty is None:
        # Forces of two-half-pass contact balance the less, the stiffer it is.
        penalty = E_SLAB / p.h if p.formulation == "two-half-pass" else "auto"
    surfaces = [body.surface for body in bodies]
    contact = qs.Contact(
        *(surfaces[::-1] if p.swap else surfaces),
        p.formulation,
        penalty=penalty,
        quadrature=p.quadrature,
        enforcement=p.enforcement,
        # Multipliers on both sides cannot close every gap.
        gap_tolerance=0.02 if p.formulation.endswith("-pass") else 1e-6,
        friction=qs.Coulomb(p.mu),
    )
    problem = qs.ContactProblem(
        [b.F for b in bodies], [b.u for b in bodies], [contact], [b.bcs for b in bodies]
    )

    def drive(t, dt):
        depth = p.depth * min(t / PRESSING, 1)
        indenter.displacement.value[:] = per_step * max(t - PRESSING, 0), -depth

    def solve(step):
        if p.formulation == "two-half-pass" and contact.augmented:
            # Its multipliers may differ by what neither gap feels, more so with each update.
            contact.reset()
        problem.solve()

    return indenter, slab, contact, qs.TimeStepper(problem, 1.0, drive, solve=solve)


# --- Results


def slide(p, comm=MPI.COMM_WORLD, on_step=None):
    """Press and drag, calling ``on_step(row, scene)``; returns all rows and what build() does."""
    scene = indenter, slab, contact, stepper = build(comm, p)
    rows, last = [], np.zeros(4)
    run_in, plateau = p.plan()
    for end in np.cumsum([PRESSING, run_in, plateau]):
        for t in stepper.run(float(end)):
            now = np.append(indenter.reaction(), indenter.displacement.value)
            work = rows[-1].work if rows else 0.0
            work += 0.5 * (now + last)[:2] @ (now - last)[2:]
            energies = contact.dissipated_energy(), indenter.energy() + slab.energy()
            rows.append(Row(t, stepper.last_dt, now[2] / p.h, *now[:2], work, *energies))
            last = now
            if on_step:
                on_step(rows[-1], scene)
    return rows, scene


def on_plateau(p, rows):
    """Columns of the rows of the plateau, and the row before it."""
    first = next(i for i, row in enumerate(rows) if row.t > PRESSING + p.plan()[0] + 1e-6)
    return Row(*np.array(rows[first:]).T), rows[first - 1]


def measure(p, rows, stepper):
    """What --json writes; means are over the slide, whatever the steps."""
    columns, _ = on_plateau(p, rows)
    ratios = np.abs(columns.fx / columns.fy)
    ratio, mean = (np.average(f, weights=columns.dt) for f in (ratios, columns.fx))
    return {
        "force_ratio_error": float(abs(ratio / p.mu - 1)),
        "force_oscillation": float(np.ptp(columns.fx) / abs(mean)),
        "steps": stepper.num_steps,
        "cutbacks": stepper.num_cutbacks,
    }


def run(p, comm=MPI.COMM_WORLD):
    """Iron; returns what --json writes, the rows of all steps, and what :func:`build` returns."""
    output = Output(comm, p)
    rows, scene = slide(p, comm, output)
    output.close()
    return measure(p, rows, scene[-1]), rows, scene


def main():
    default = Parameters()
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--formulation", choices=FORMULATIONS, default=default.formulation)
    add("--quadrature", choices=("nodal", "overlay"), default=default.quadrature)
    add("--enforcement", choices=ENFORCEMENTS, default=default.enforcement)
    add("--penalty", type=float, help="ε, stress per length")
    add("--mu", type=float, default=default.mu)
    add("--h", type=float, default=default.h, help="facets of the slab")
    add("--ratio", type=float, default=default.ratio, help="facets of the indenter in h")
    add("--depth", type=float, default=default.depth)
    add("--steps", type=int, default=default.steps, help="in all, pressing and run-in included")
    add("--swap", action="store_true", help="the slab is the slave")
    add("--output", metavar="FOLDER", help="fields and history.csv")
    add("--json", type=output_file, metavar="FILE")
    add("--plot", type=picture_file, metavar="FILE", help="draw three kinds of contact")
    a = vars(parser.parse_args())
    filename, picture = a.pop("json"), a.pop("plot")
    p = Parameters(**a, verbose=not picture)
    if p.mu <= 0:
        parser.error("--mu: must be positive")
    try:
        p.plan()
    except ValueError as error:
        parser.error(str(error))
    if picture:
        from ironing_plot import plot

        plot(p, picture)
        if not (filename or p.output):
            return
    result = run(p)[0]
    if MPI.COMM_WORLD.rank == 0:
        print("\n".join(f"{key:24}{value:.6g}" for key, value in result.items()))
        if filename:
            with open(filename, "w") as file:
                json.dump(result, file, indent=2)


if __name__ == "__main__":
    main()
