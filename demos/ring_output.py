"""Results of the ring compression test: radii, force, and energy balance."""

import qsdolfinx as qs

from ring_bodies import HEIGHT


class Record:
    """Record of the history of a run, with radii and energies.

    Args:
        comm: Communicator.
        scene: What :func:`ring_compression.build` returns.
        t_end: Time at which the run ends.
        speed: Velocity of the upper die.
        verbose: Whether to print the history.
    """

    def __init__(self, comm, scene, t_end, speed, verbose):
        self.ring, self.contacts, self.stepper = scene
        self.speed, self.volume = speed, self.ring.volume()
        self.history = qs.History(comm, t_end=t_end, verbose=verbose)
        self.power = self.work = self.plastic = self.force = 0.0
        #: Radii and energies after the last step.
        self.last = {}
        self.stepper.on_solved = self.on_solved

    def on_solved(self):
        """Compute the dissipated power on the mesh on which the velocity was solved."""
        self.power = self.ring.power()

    def add_step(self):
        """Add a row: work of the dies, dissipation of the ring and of friction. Collective."""
        dt = self.stepper.last_dt
        self.force = sum(contact.force("slave")[1] for contact in self.contacts[2:])
        self.work -= self.force * self.speed * dt
        self.plastic += self.power * dt
        taken = sum(contact.dissipated_energy() for contact in self.contacts)
        inner, outer = self.ring.radii()
        self.last = {
            "reduction": self.speed * self.stepper.t / HEIGHT,
            "inner_radius": inner,
            "outer_radius": outer,
            "work": self.work,
            "plastic": self.plastic,
            "friction": taken,
            "energy_error": (self.work - self.plastic - taken) / self.work,
        }
        self.history.add(qs.step_row(self.stepper) | self.last)

    def result(self):
        """Return the results for --json, without the error. Collective."""
        return {
            "inner_radius": self.last["inner_radius"],
            "outer_radius": self.last["outer_radius"],
            "force": abs(self.force),
            "dissipated_energy": self.last["friction"],
            "volume_change": self.ring.volume() / self.volume - 1,
            "steps": self.stepper.num_steps,
            "snes_iterations": sum(row["iterations"] for row in self.history.rows),
        }

    def close(self):
        """Close the history."""
        self.history.close()
