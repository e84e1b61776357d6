"""Results and files of the forging demo: pressures on the dies, shape, energy, strain."""

import pathlib

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs
from qsdolfinx.compat import interpolation_points

from common.output import Output


def inner_pressure(contact, side):
    """Return the pressure at the die's owned nodes within 70 % of the contact radius."""
    comm = contact.comm
    surface = getattr(contact, side)
    pressure = np.abs(surface.node_values(contact.traction(side))[:, 2])
    # Contact radius: of the disc on which a uniform pressure has this mean square distance.
    distance = np.linalg.norm(surface.node_x[:, :2], axis=1)
    force = comm.allreduce(pressure @ surface.node_area)
    second = comm.allreduce(distance**2 @ (pressure * surface.node_area))
    return pressure[distance <= 0.7 * np.sqrt(2 * second / force)]


def die_pressures(contacts, side):
    """Return the pressures of both dies, which are on this side of their contacts. Collective."""
    comm = contacts[0].comm
    values = np.concatenate([inner_pressure(contact, side) for contact in contacts])
    count, total = comm.allreduce(np.array([len(values), values.sum()]))
    mean = total / count
    squares, few = comm.allreduce(
        np.array([np.sum((values - mean) ** 2), np.count_nonzero(values < 0.1 * mean)])
    )
    return {
        "die_traction_peak": comm.allreduce(values.max(initial=0.0), op=MPI.MAX),
        "die_traction_roughness": np.sqrt(squares / count) / mean,
        "unloaded_die_nodes": few / count,
    }


def barrelling(work):
    """Compute the largest radius of the workpiece at mid height and at the dies. Collective."""
    msh = work.mesh
    x = msh.geometry.x
    radius, comm = np.hypot(x[:, 0], x[:, 1]), msh.comm
    # DOLFINx divides by the number of facets, which may be zero on a rank.
    faces = [surface.facets for surface in (work.lower, work.upper) if len(surface.facets)]
    nodes = [mesh.entities_to_geometry(msh, 2, facets).ravel() for facets in faces]
    at_dies = np.concatenate([np.zeros(0, dtype=np.int32), *nodes])
    low, high = (
        comm.allreduce(sign * (sign * x[at_dies, 2]).max(initial=-np.inf), op=op)
        for sign, op in ((-1, MPI.MIN), (1, MPI.MAX))
    )
    middle = np.abs(x[:, 2] - (low + high) / 2) < 0.15 * (high - low)
    local = [radius[middle].max(initial=0.0), radius[at_dies].max(initial=0.0)]
    return tuple(comm.allreduce(value, op=MPI.MAX) for value in local)


class Energy:
    """Energy balance of the quarter (N mm): work of the upper die's drive and its parts.

    Args:
        work: The workpiece.
        dies: The dies.
        contacts: Contacts between them; the dissipation of their friction has its own column.
        speed: Velocity of the drive.
    """

    def __init__(self, work, dies, contacts, speed):
        self.speed = speed
        self.contacts = [contact for contact in contacts if contact.friction is not None]
        self.comm = work.mesh.comm
        self.workpiece = work
        self.elastic = [fem.form(0.5 * ufl.inner(d.stress, ufl.grad(d.u)) * ufl.dx) for d in dies]
        self.power = self.work = self.dissipated = 0.0

    def sums(self):
        """Return the sums that a checkpoint has to save."""
        return {"work": self.work, "dissipated": self.dissipated}

    def restore(self, sums):
        """Continue from these sums."""
        self.work, self.dissipated = sums["work"], sums["dissipated"]

    def _total(self, form):
        return self.comm.allreduce(fem.assemble_scalar(form), op=MPI.SUM)

    def on_solved(self):
        """Compute the dissipated power on the mesh on which the velocity was solved."""
        self.power = self.workpiece.power()

    def row(self, force, dt):
        """Add a step with the force of the drive; return columns of the history."""
        self.work += force * self.speed * dt
        self.dissipated += self.power * dt
        elastic = sum(map(self._total, self.elastic))
        row = {"work": self.work, "dissipated": self.dissipated, "elastic": elastic}
        if self.contacts:
            row["friction"] = sum(contact.dissipated_energy() for contact in self.contacts)
        lost = self.work - sum(value for key, value in row.items() if key != "work")
        return row | {"energy_error": lost / self.work}


class Record:
    """Record of strain, balances, energies and history; with --output also fields and a checkpoint.

    Args:
        comm: Communicator.
        p: Parameters; with ``restart`` the run continues from the checkpoint.
        scene: What :func:`forging.build` returns.
        t_end: Time at which the run ends.
        speed: Velocity of the drive.
    """

    def __init__(self, comm, p, scene, t_end, speed):
        work, dies, self.contacts, _, self.stepper = scene
        self.volume, self.iterations, self.imbalance = self.stepper.motions[0].volume(), 0, 0.0
        space = fem.functionspace(work.mesh, ("DG", 0))
        #: Equivalent strain of the workpiece, one value per cell.
        self.strain, self.rate = fem.Function(space), fem.Function(space)
        self.expression = fem.Expression(work.rate, interpolation_points(space))
        self.energy = Energy(work, dies, self.contacts, speed)
        self.stepper.on_solved = self.on_solved
        self.checkpoint = pathlib.Path(p.output) / "checkpoint" if p.output else None
        self.functions = {"strain": self.strain}
        if p.restart:
            self.energy.restore(qs.load_run(self.stepper, self.checkpoint, self.functions))
        self.output = Output(comm, p.output, t_end, p.verbose, after=self.stepper.num_steps)
        #: Sides of the contacts of workpiece and dies.
        self.sides = ("master", "slave") if p.swap else ("slave", "master")
        self.add_fields(work, dies, *self.sides)

    def add_fields(self, work, dies, on_work, on_dies):
        """Files of fields of all bodies, which are on these sides of their contacts."""
        stress = work.stress - work.pressure * ufl.Identity(3)
        fields = {"strain_rate": work.rate, "strain": self.strain, "stress": stress}
        at_vertices = {"velocity": ufl.split(work.w)[0], "pressure": work.pressure}
        for i, contact in enumerate(self.contacts):
            at_vertices |= {f"{k}_{i}": f for k, f in contact.field_sources(on_work).items()}
        self.output.add_fields("workpiece", work.mesh, fields, at_vertices)
        for name, die, contact in zip(("lower", "upper"), dies, self.contacts, strict=True):
            fields = {"displacement": die.u, "stress": die.stress}
            sources = {f"{k}_0": f for k, f in contact.field_sources(on_dies).items()}
            self.output.add_fields(f"{name}_die", die.mesh, fields, sources)

    def on_solved(self):
        """Compute rates on the mesh on which the velocity was solved."""
        self.rate.interpolate(self.expression)
        self.energy.on_solved()

    def add_step(self):
        """Add the results of a step. Collective."""
        for contact in self.contacts:
            forces = contact.force("slave"), contact.force("master")
            unbalanced = np.linalg.norm(forces[0] + forces[1]) / np.linalg.norm(forces[0])
            self.imbalance = max(self.imbalance, unbalanced)
        self.iterations += self.stepper.num_iterations
        dt, push = self.stepper.last_dt, abs(self.contacts[1].force("slave")[2])
        self.strain.x.array[:] += dt * self.rate.x.array
        self.output.write(self.stepper.t, qs.step_row(self.stepper) | self.energy.row(push, dt))
        if self.checkpoint:
            qs.save_run(self.stepper, self.checkpoint, self.functions, self.energy.sums())

    def result(self):
        """Return the results for --json, without the run time. Collective."""
        side = self.sides[1]
        return {
            "forming_force": 4 * abs(self.contacts[1].force(side)[2]),
            "force_balance_error": self.imbalance,
            **die_pressures(self.contacts, side),
            "volume_change": self.stepper.motions[0].volume() / self.volume - 1,
            "steps": self.stepper.num_steps,
            "snes_iterations": self.iterations,
        }

    def close(self):
        """Close the files."""
        self.output.close()
