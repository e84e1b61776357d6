"""What the forging demo writes beside its table: energy, fields, checkpoints."""

from mpi4py import MPI

import ufl
from dolfinx import fem

import qsdolfinx as qs


class Energy:
    """Work of the upper die's drive against what becomes of it, of the quarter (N mm).

    Args:
        work: The workpiece.
        dies: The dies.
        speed: Velocity of the drive.
    """

    def __init__(self, work, dies, speed):
        self.speed = speed
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
        lost = self.work - self.dissipated - elastic
        return {
            "work": self.work,
            "dissipated": self.dissipated,
            "elastic": elastic,
            "energy_error": lost / self.work,
        }


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
            f"{name}_{i}": lambda c=contact, n=name: c.fields(side)[n]
            for i, contact in enumerate(contacts)
            for name in contact.fields(side)
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
