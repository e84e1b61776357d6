"""Upsetting of a Norton-Hoff cylinder between rigid frictionless dies, against the closed form.

The billet (radius 10, height 15; MINI element in velocities) stays a cylinder, and the force on a
die is F = π R² K √3^{m+1} (V/h)^m. The upper die comes down with the constant velocity V until half
of the height is left. R and h are those for which the velocity is solved, as F is: with the
midpoint scheme half a step ahead of the end of the last step.

    python3 demos/upset_cylinder.py --m 0.15 --rate 1 --dim 2 --json upset.json
    mpirun -n 2 python3 demos/upset_cylinder.py --m 0.5 --dim 3 --plot upset.png

Keys of the JSON object:

- force_error: largest relative deviation from the closed form, of all steps and both dies;
- volume_change: relative, at the end;
- steps, snes_iterations, total_seconds.

--dim 2 is axisymmetric, --dim 3 a quarter of the cylinder, whose R is that of the volume of its
polygonal mesh. In neither does a Dirichlet condition hold the billet along the axis.
"""

import argparse
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
from qsdolfinx.compat import model_to_mesh

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from output_file import output_file
from plotting import picture_file
from upset_plot import Recorder

RADIUS, HEIGHT = 10.0, 15.0


@dataclasses.dataclass
class Parameters:
    """One upsetting; lengths, times and stresses in any consistent units."""

    m: float = 0.15
    K: float = 50.0
    rate: float = 1.0
    dim: int = 2
    reduction: float = 0.5
    num_steps: int = 25
    scheme: str = "midpoint"
    formulation: str = "quasi-symmetric"
    quadrature: str = "nodal"
    verbose: bool = False


# --- Billet


def create_billet(comm, dim):
    """Half a meridian section, or a quarter of the cylinder."""
    if dim == 2:
        return mesh.create_rectangle(comm, [[0, 0], [RADIUS, HEIGHT]], [6, 9])
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    if comm.rank == 0:
        gmsh.model.occ.addCylinder(0, 0, 0, 0, 0, HEIGHT, RADIUS, angle=np.pi / 2)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", 3.0)
        gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], 1)
        gmsh.model.mesh.generate(3)
    out = model_to_mesh(gmsh.model, comm, 0, gdim=3)[0]
    gmsh.finalize()
    return out


def facets_at(msh, axis, value):
    return mesh.locate_entities_boundary(
        msh, msh.topology.dim - 1, lambda x: np.isclose(x[axis], value)
    )


class Billet:
    """Form, conditions of symmetry and the two faces."""

    def __init__(self, comm, p):
        self.mesh = create_billet(comm, p.dim)
        self.axisymmetric = p.dim == 2
        self.W = qs.materials.mini_space(self.mesh)
        self.w = fem.Function(self.W)
        self.m = fem.Constant(self.mesh, p.m)
        stress = qs.materials.norton_hoff(
            ufl.split(self.w)[0], p.K, self.m, 1e-4 * p.rate, self.axisymmetric
        )
        self.F = qs.materials.incompressible(self.w, stress)
        V, self.bcs = self.W.sub(0), []
        for axis in range(p.dim - 1):
            component = V.sub(axis)
            dofs = fem.locate_dofs_topological(
                component, p.dim - 1, facets_at(self.mesh, axis, 0.0)
            )
            self.bcs.append(fem.dirichletbc(0.0, dofs, component))
        self.faces = [
            qs.Surface(V, facets=facets_at(self.mesh, p.dim - 1, z), axisymmetric=self.axisymmetric)
            for z in (0.0, HEIGHT)
        ]

    def section(self):
        """Mean area of the sections across the axis, of the whole billet as it is. Collective."""
        x = self.mesh.geometry.x[:, -1 if self.mesh.geometry.dim == 3 else 1]
        comm = self.mesh.comm
        height = comm.allreduce(x.max(), op=MPI.MAX) - comm.allreduce(x.min(), op=MPI.MIN)
        return self.volume() / height, height

    def volume(self):
        """Volume of the whole billet. Collective."""
        one = fem.Constant(self.mesh, 1.0)
        weight = qs.materials.axisymmetric_weight(self.mesh) if self.axisymmetric else 4.0
        local = fem.assemble_scalar(fem.form(one * weight * ufl.dx(domain=self.mesh)))
        return self.mesh.comm.allreduce(local, op=MPI.SUM)


def build(comm, p):
    """Billet, dies, contacts and the stepper."""
    billet = Billet(comm, p)
    up = np.eye(p.dim)[-1]
    dies = [qs.RigidSurface.plane(comm, z * up, sign * up) for z, sign in ((0.0, 1), (HEIGHT, -1))]
    speed = p.rate * HEIGHT
    dt = p.reduction * HEIGHT / speed / p.num_steps
    contacts = [
        qs.Contact(
            face,
            die,
            p.formulation,
            quadrature=p.quadrature,
            enforcement="augmented-lagrangian",
            unknown="velocity",
            dt=dt,
        )
        for face, die in zip(billet.faces, dies, strict=True)
    ]
    problem = qs.ContactProblem([billet.F], [billet.w], contacts, [billet.bcs])

    def drive(t, dt):
        dies[1].displacement = -speed * dt * up

    def solve(step):
        qs.solve_with_continuation(problem, billet.m, p.m)

    theta = {"midpoint": 0.5, "euler": 0.0}[p.scheme]
    stepper = qs.TimeStepper(problem, dt, drive, solve=solve, theta=theta)
    return billet, contacts, stepper


def run(p, comm=MPI.COMM_WORLD, look=None):
    """Upset, and compare every step with the closed form.

    look is called with the billet at first, and with the billet, the reduction, the force on a die
    and that of the closed form after each step.
    """
    comm.barrier()
    start = time.perf_counter()
    billet, contacts, stepper = build(comm, p)
    look = look or (lambda *state: None)
    look(billet)
    volume = billet.volume()
    speed = p.rate * HEIGHT
    share = 1.0 if p.dim == 2 else 4.0
    solved_at = []

    def measure():
        solved_at.append(billet.section())

    stepper.on_solved = measure
    history = qs.History(comm, t_end=p.reduction / p.rate, verbose=p.verbose)
    error, iterations = 0.0, 0
    for _ in stepper.run(p.reduction / p.rate):
        area, height = solved_at[-1]
        force = area * p.K * np.sqrt(3) ** (p.m + 1) * (speed / height) ** p.m
        forces = [share * abs(contact.force("slave")[-1]) for contact in contacts]
        error = max(error, *(abs(f / force - 1) for f in forces))
        look(billet, 1 - height / HEIGHT, forces[1], force)
        iterations += stepper.num_iterations
        history.add(qs.step_row(stepper) | {"force_error": error})
    history.close()
    result = {
        "force_error": error,
        "volume_change": billet.volume() / volume - 1,
        "steps": stepper.num_steps,
        "snes_iterations": iterations,
        "total_seconds": comm.allreduce(time.perf_counter() - start, op=MPI.MAX),
    }
    return {k: v.item() if hasattr(v, "item") else v for k, v in result.items()}, stepper


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    default = Parameters()
    parser.add_argument("--m", type=float, default=default.m, help="rate sensitivity")
    parser.add_argument("--K", type=float, default=default.K, help="consistency")
    parser.add_argument("--rate", type=float, default=default.rate, help="V / initial height")
    parser.add_argument("--dim", type=int, choices=(2, 3), default=default.dim)
    parser.add_argument("--reduction", type=float, default=default.reduction)
    parser.add_argument("--steps", dest="num_steps", type=int, default=default.num_steps)
    parser.add_argument("--scheme", choices=("midpoint", "euler"), default=default.scheme)
    parser.add_argument(
        "--formulation", choices=("master-slave", "quasi-symmetric"), default=default.formulation
    )
    parser.add_argument("--quadrature", choices=("nodal", "overlay"), default=default.quadrature)
    parser.add_argument("--json", type=output_file, metavar="FILE")
    parser.add_argument("--plot", type=picture_file, metavar="FILE", help="draw billet and force")
    a = vars(parser.parse_args())
    filename, picture = a.pop("json"), a.pop("plot")
    look = Recorder() if picture else None
    result, _ = run(Parameters(**a, verbose=True), look=look)
    if MPI.COMM_WORLD.rank == 0:
        for key, value in result.items():
            print(f"{key:18}{value:.6g}")
        if filename:
            with open(filename, "w") as file:
                json.dump(result, file, indent=2)
        if picture:
            look.plot(picture)


if __name__ == "__main__":
    main()
