"""Forging: a hot-steel cylinder upset between elastic dies with finer contact faces.

A quarter of a Norton-Hoff cylinder (radius 10 mm, height 15 mm; K = 50 MPa sᵐ, m = 0.15) in
velocities, MINI element, between two elastic dies (E = 2.1e5 MPa) in displacements. The lower die
stands, the top of the upper one comes down at 10 mm/s. The faces of the dies are --die-refinement
times finer than the workpiece, which carries the multipliers (--swap: the dies do). No Dirichlet
condition holds the workpiece up or down: contact does. There is no friction unless --friction names
a law; friction factors are of the flow stress at the nominal strain rate, velocity over height.

    mpirun -n 2 python3 demos/forging.py --die-refinement 4 --quadrature overlay --json forging.json
    mpirun -n 2 python3 demos/forging.py --friction coulomb-tresca --mu 0.2 --m-bar 0.4
    python3 demos/forging.py --friction sticking --plot forging.png --animate forging.gif

Keys of the JSON object (forces of the whole cylinder):

- forming_force (N): at the end, on the upper die;
- force_balance_error: largest |force on a die + force on the workpiece| / |force|, of all steps;
- die_traction_peak (MPa): largest pressure on the dies' nodes within 70 % of the contact's radius;
- die_traction_roughness: standard deviation over mean of the pressure there;
- unloaded_die_nodes: share of these nodes with less than a tenth of the mean pressure;
- volume_change: of the workpiece, relative;
- steps, snes_iterations, total_seconds.

Pressures are contact forces over nodal areas. How much the workpiece barrels is on the terminal.
"""

import argparse
import contextlib
import dataclasses
import json
import pathlib
import sys
import time

from mpi4py import MPI

import gmsh
import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.compat import interpolation_points, model_to_mesh

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from forging_film import Film
from forging_output import Energy, Output, barrelling, measure
from forming_friction import Friction, FrictionParameters, add_arguments
from output_file import output_file
from plotting import film_file, picture_file

RADIUS, HEIGHT = 10.0, 15.0  # mm
DIE_RADIUS, DIE_HEIGHT = 18.0, 9.0
K, M, SPEED = 50.0, 0.15, 10.0  # MPa sᵐ, -, mm/s
E_DIE, NU_DIE = 2.1e5, 0.3
PENALTY = (
    5e4  # MPa: times 1/h. A stiffer one makes the nodes of the workpiece hop from dent to dent
)
SIZES = {"coarse": 2.5, "medium": 1.7, "fine": 1.2}  # mm, cells of the workpiece
FORMULATIONS = ("master-slave", "quasi-symmetric", "double-pass", "two-half-pass")


@dataclasses.dataclass
class Parameters(FrictionParameters):
    """One forging; lengths in mm."""

    die_refinement: float = 4.0
    formulation: str = "quasi-symmetric"
    quadrature: str = "overlay"
    enforcement: str = "penalty"
    reduction: float = 0.3
    size: str = "coarse"
    num_steps: int = 15
    swap: bool = False
    output: str | None = None
    restart: bool = False
    verbose: bool = False


# --- Meshes


def create_quarter(comm, radius, bottom, height, size):
    """Tetrahedra of a quarter cylinder; ``size`` is a number or gmsh's formula for their size."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
    if comm.rank == 0:
        gmsh.model.occ.addCylinder(0, 0, bottom, 0, 0, height, radius, angle=np.pi / 2)
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.field.add("MathEval", 1)
        gmsh.model.mesh.field.setString(1, "F", str(size))
        gmsh.model.mesh.field.setAsBackgroundMesh(1)
        gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], 1)
        gmsh.model.mesh.generate(3)
    out = model_to_mesh(gmsh.model, comm, 0, gdim=3)[0]
    gmsh.finalize()
    return out


def die_size(z, h):
    """Formula: h on the face at height z where contact may come, growing away from it."""
    beyond = f"(sqrt(x*x+y*y)-{1.2 * RADIUS})"
    return f"{h}+0.35*(abs(z-{z})+0.5*({beyond}+abs({beyond})))"


def facets_at(msh, axis, value):
    return mesh.locate_entities_boundary(msh, 2, lambda x: np.isclose(x[axis], value))


def fix(V, axis, facets, value=0.0):
    """Dirichlet condition on one component of the velocity or displacement space V."""
    component = V.sub(axis)
    constant = fem.Constant(V.mesh, float(value))
    dofs = fem.locate_dofs_topological(component, 2, facets)
    return fem.dirichletbc(constant, dofs, component), constant


# --- Bodies


class Workpiece:
    """Norton-Hoff cylinder between the heights 0 and HEIGHT."""

    def __init__(self, comm, h):
        self.mesh = create_quarter(comm, RADIUS, 0.0, HEIGHT, h)
        self.W = qs.materials.mini_space(self.mesh)
        self.w = fem.Function(self.W)
        self.m = fem.Constant(self.mesh, M)
        velocity = ufl.split(self.w)[0]
        slow = 1e-3 * SPEED / HEIGHT
        self.stress = qs.materials.norton_hoff(velocity, K, self.m, slow)
        self.F = qs.materials.incompressible(self.w, self.stress)
        self.rate = qs.materials.equivalent_strain_rate(velocity)
        V = self.W.sub(0)
        self.bcs = [fix(V, axis, facets_at(self.mesh, axis, 0.0))[0] for axis in (0, 1)]
        self.lower, self.upper = (
            qs.Surface(V, facets=facets_at(self.mesh, 2, z)) for z in (0.0, HEIGHT)
        )


class Die:
    """Elastic die with its face at height z, above (1) or below (-1) it; total displacements."""

    def __init__(self, comm, z, sign, h):
        bottom = z if sign > 0 else z - DIE_HEIGHT
        self.mesh = create_quarter(comm, DIE_RADIUS, bottom, DIE_HEIGHT, die_size(z, h))
        self.V = fem.functionspace(self.mesh, ("Lagrange", 1, (3,)))
        self.u = fem.Function(self.V)
        stress = qs.materials.linear_elastic(self.u, E_DIE, NU_DIE)
        self.stress = stress
        self.F = ufl.inner(stress, ufl.grad(ufl.TestFunction(self.V))) * ufl.dx
        self.bcs = [fix(self.V, axis, facets_at(self.mesh, axis, 0.0))[0] for axis in (0, 1)]
        back, self.height = fix(self.V, 2, facets_at(self.mesh, 2, z + sign * DIE_HEIGHT))
        self.bcs.append(back)
        self.surface = qs.Surface(self.V, facets=facets_at(self.mesh, 2, z))


def create_bodies(comm, h, die_refinement):
    """The workpiece, with cells of size h, and the two dies."""
    fine = h / die_refinement
    return Workpiece(comm, h), [Die(comm, 0.0, -1, fine), Die(comm, HEIGHT, 1, fine)]


def build(comm, p):
    """Workpiece, dies, contacts and the stepper."""
    h = SIZES[p.size]
    return assemble(p, h, *create_bodies(comm, h, p.die_refinement))


def assemble(p, h, work, dies):
    """The same of bodies that are there; h (mm) is what the penalty is for."""
    time_step = p.reduction * HEIGHT / SPEED / p.num_steps
    friction = Friction(p, work.mesh, K, M)
    contacts = []
    for face, die in zip((work.lower, work.upper), dies, strict=True):
        sides, unknown = (face, die.surface), ("velocity", "displacement")
        contact = qs.Contact(
            *(sides[::-1] if p.swap else sides),
            p.formulation,
            penalty=PENALTY / h,
            quadrature=p.quadrature,
            enforcement=p.enforcement,
            gap_tolerance=1e-5,
            unknown=unknown[::-1] if p.swap else unknown,
            dt=time_step,
            friction=friction.law(),
        )
        contacts.append(contact)
    bodies = [work, *dies]
    problem = qs.ContactProblem(
        [b.F for b in bodies], [work.w, *(d.u for d in dies)], contacts, [b.bcs for b in bodies]
    )

    def drive(t, dt):
        dies[1].height.value = -SPEED * t
        friction.set_rate(SPEED / (HEIGHT - SPEED * (t - dt / 2)))

    def solve(step):
        if step > 0:
            with contextlib.suppress(qs.ConvergenceError):
                return problem.solve()
        return qs.solve_with_continuation(problem, work.m, M)

    stepper = qs.TimeStepper(problem, time_step, drive, solve=solve)
    return work, dies, contacts, problem, stepper


# --- Results


def run(p, comm=MPI.COMM_WORLD, on_step=None):
    """Forge, and say what came out; ``on_step(scene, strain)`` at the start and after each step.

    Returns:
        What --json writes, and what :func:`build` returns.
    """
    comm.barrier()
    start = time.perf_counter()
    scene = _, dies, contacts, _, stepper = build(comm, p)
    volume = stepper.motions[0].volume()
    work = scene[0]
    strain = fem.Function(fem.functionspace(work.mesh, ("DG", 0)))
    rate = fem.Function(strain.function_space)
    expression = fem.Expression(work.rate, interpolation_points(strain.function_space))
    energy = Energy(work, dies, contacts, SPEED)

    def on_solved():
        rate.interpolate(expression)
        energy.on_solved()

    stepper.on_solved = on_solved
    folder = pathlib.Path(p.output) if p.output else None
    if p.restart:
        energy.restore(qs.load_run(stepper, folder / "checkpoint", {"strain": strain}))
    output = Output(folder, scene, strain, energy) if folder else None
    history = qs.History(
        comm,
        folder and folder / "history.csv",
        t_end=p.reduction * HEIGHT / SPEED,
        verbose=p.verbose,
        append=p.restart,
    )
    on_step = on_step or (lambda scene, strain: None)
    on_step(scene, strain)
    iterations, imbalance = 0, 0.0
    for _ in stepper.run(p.reduction * HEIGHT / SPEED):
        strain.x.array[:] += stepper.last_dt * rate.x.array
        push = abs(contacts[1].force("slave")[2])
        history.add(qs.step_row(stepper) | energy.row(push, stepper.last_dt))
        if output:
            output.write()
        iterations += stepper.num_iterations
        for contact in contacts:
            forces = contact.force("slave"), contact.force("master")
            imbalance = max(
                imbalance, np.linalg.norm(forces[0] + forces[1]) / np.linalg.norm(forces[0])
            )
        on_step(scene, strain)
    history.close()
    if output:
        output.close()
    on_die = contacts[1].force("slave" if p.swap else "master")
    result = {
        "forming_force": 4 * abs(on_die[2]),
        "force_balance_error": imbalance,
        **measure(comm, p.swap, contacts),
        "volume_change": stepper.motions[0].volume() / volume - 1,
        "steps": stepper.num_steps,
        "snes_iterations": iterations,
        "total_seconds": comm.allreduce(time.perf_counter() - start, op=MPI.MAX),
    }
    return {k: v.item() if hasattr(v, "item") else v for k, v in result.items()}, scene


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    default = Parameters()
    add = parser.add_argument
    add("--die-refinement", type=float, default=default.die_refinement)
    add("--formulation", choices=FORMULATIONS, default=default.formulation)
    add("--quadrature", choices=("nodal", "overlay"), default=default.quadrature)
    add("--enforcement", choices=("penalty", "augmented-lagrangian"), default=default.enforcement)
    add("--reduction", type=float, default=default.reduction)
    add("--size", choices=tuple(SIZES), default=default.size)
    add("--steps", dest="num_steps", type=int, default=default.num_steps)
    add("--swap", action="store_true", help="the dies are the slaves")
    add_arguments(parser)
    add("--output", metavar="FOLDER", help="fields, history.csv and a checkpoint")
    add("--restart", action="store_true", help="go on from --output's checkpoint")
    add("--json", type=output_file, metavar="FILE")
    add("--plot", type=picture_file, metavar="FILE", help="picture of the end")
    add("--animate", type=film_file, metavar="FILE", help="all steps as a GIF")
    a = vars(parser.parse_args())
    filename, picture, animation = (a.pop(name) for name in ("json", "plot", "animate"))
    if a["restart"] and not a["output"]:
        parser.error("--restart needs the --output of the run before")
    film = Film(HEIGHT, SPEED) if picture or animation else None
    result, scene = run(Parameters(**a, verbose=True), on_step=film)
    radii = barrelling(scene[0])
    if MPI.COMM_WORLD.rank == 0:
        print("largest radius at mid height {:.5g}, at the dies {:.5g}".format(*radii))
        for key, value in result.items():
            print(f"{key:24}{value:.6g}")
        if filename:
            with open(filename, "w") as file:
                json.dump(result, file, indent=2)
        if picture:
            film.plot(picture)
        if animation:
            film.animate(animation)


if __name__ == "__main__":
    main()
