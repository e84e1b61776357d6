"""What the forging demo measures, and writes beside its table: energy, fields, checkpoints."""

from mpi4py import MPI

import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs


def inner_pressure(contact, side):
    """Pressure at the die's owned nodes within 70 % of the contact's radius."""
    comm = contact.comm
    surface = contact.slave if side == "slave" else contact.master
    pressure = np.abs(surface.node_values(contact.traction(side))[:, 2])
    # The radius of the disc on which a uniform pressure has this mean square distance.
    distance = np.linalg.norm(surface.node_x[:, :2], axis=1)
    force = comm.allreduce(pressure @ surface.node_area)
    second = comm.allreduce(distance**2 @ (pressure * surface.node_area))
    return pressure[distance <= 0.7 * np.sqrt(2 * second / force)]


def measure(comm, swap, contacts):
    """Pressures on both dies together."""
    side = "slave" if swap else "master"
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
    """Largest radius of the workpiece at mid height and at the dies. Collective."""
    msh = work.mesh
    x = msh.geometry.x
    radius, comm = np.hypot(x[:, 0], x[:, 1]), msh.comm
    # DOLFINx divides by the number of facets, which some rank may have none of.
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
    """Work of the upper die's drive against what becomes of it, of the quarter (N mm).

    Args:
        work: The workpiece.
        dies: The dies.
        contacts: Between them; what their friction takes is a column of its own.
        speed: Velocity of the drive.
    """

    def __init__(self, work, dies, contacts, speed):
        self.speed = speed
        self.contacts = [contact for contact in contacts if contact.friction is not None]
        self.comm = work.mesh.comm
        rate = qs.materials.strain(ufl.split(work.w)[0])
        self.dissipation = fem.form(ufl.inner(work.stress, rate) * ufl.dx)
        self.elastic = [fem.form(0.5 * ufl.inner(d.stress, ufl.grad(d.u)) * ufl.dx) for d in dies]
        self.power = self.work = self.dissipated = 0.0

    def sums(self):
        """What a checkpoint has to keep."""
        return {"work": self.work, "dissipated": self.dissipated}

    def restore(self, sums):
        """Go on from these sums."""
        self.work, self.dissipated = sums["work"], sums["dissipated"]

    def _total(self, form):
        return self.comm.allreduce(fem.assemble_scalar(form), op=MPI.SUM)

    def on_solved(self):
        """Dissipated power, while the mesh is where the velocity was solved for."""
        self.power = self._total(self.dissipation)

    def row(self, force, dt):
        """Add a step in which the drive pushed with a force; columns of the history."""
        self.work += force * self.speed * dt
        self.dissipated += self.power * dt
        elastic = sum(map(self._total, self.elastic))
        row = {"work": self.work, "dissipated": self.dissipated, "elastic": elastic}
        if self.contacts:
            row["friction"] = sum(contact.dissipated_energy() for contact in self.contacts)
        lost = self.work - sum(value for key, value in row.items() if key != "work")
        return row | {"energy_error": lost / self.work}


class Output:
    """Fields of all bodies for ParaView, and a checkpoint, in a folder.

    Args:
        folder: The folder.
        scene: What :func:`build` returns.
        strain: Equivalent strain of the workpiece.
        energy: Its sums are part of the checkpoint.
    """

    def __init__(self, folder, scene, strain, energy):
        work, dies, contacts, _, self.stepper = scene
        self.folder, self.strain, self.energy = folder, strain, energy
        folder.mkdir(parents=True, exist_ok=True)
        # A run that goes on writes files of its own: those before are still wanted.
        part = f"_from_{self.stepper.num_steps}" if self.stepper.num_steps else ""
        velocity, pressure = ufl.split(work.w)
        stress = work.stress - pressure * ufl.Identity(3)
        sides = ("master", "slave") if contacts[0].slave is dies[0].surface else ("slave", "master")
        fields = {"strain_rate": work.rate, "strain": strain, "stress": stress}
        continuous = {"velocity": velocity, "pressure": pressure}
        continuous |= self._of_contacts(contacts, sides[0])
        path = folder / f"workpiece{part}.xdmf"
        self.writers = [qs.FieldWriter(path, work.mesh, fields, continuous)]
        for name, die, contact in zip(("lower", "upper"), dies, contacts, strict=True):
            continuous = self._of_contacts([contact], sides[1])
            fields = {"displacement": die.u, "stress": die.stress}
            path = folder / f"{name}_die{part}.xdmf"
            self.writers.append(qs.FieldWriter(path, die.mesh, fields, continuous))

    @staticmethod
    def _of_contacts(contacts, side):
        """What contacts have to show on one side."""
        return {
            f"{name}_{i}": source
            for i, contact in enumerate(contacts)
            for name, source in contact.field_sources(side).items()
        }

    def write(self):
        """Fields and checkpoint at the end of a step."""
        for writer in self.writers:
            writer.write(self.stepper.t)
        functions, sums = {"strain": self.strain}, self.energy.sums()
        qs.save_run(self.stepper, self.folder / "checkpoint", functions, sums)

    def close(self):
        for writer in self.writers:
            writer.close()
