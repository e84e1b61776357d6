"""What the ironing demo writes beside its table: history and fields."""

import pathlib

import qsdolfinx as qs


class Output:
    """History and fields for ParaView in a folder."""

    def __init__(self, comm, p):
        if p.output and comm.rank == 0:
            pathlib.Path(p.output).mkdir(parents=True, exist_ok=True)
        comm.barrier()
        self.folder = pathlib.Path(p.output) if p.output else None
        self.history = qs.History(
            comm,
            self.folder and self.folder / "history.csv",
            t_end=p.steps,
            verbose=p.verbose,
        )
        self.sides = ("master", "slave") if p.swap else ("slave", "master")
        self.writers = None

    def __call__(self, row, scene):
        *bodies, contact, stepper = scene
        self.history.add(qs.step_row(stepper) | row._asdict())
        if self.folder and self.writers is None:
            self.writers = [
                qs.FieldWriter(
                    self.folder / f"{name}.xdmf",
                    body.mesh,
                    {"displacement": body.u, "stress": body.stress},
                    contact.field_sources(side),
                )
                for name, body, side in zip(("indenter", "slab"), bodies, self.sides, strict=True)
            ]
        for writer in self.writers or []:
            writer.write(row.t)

    def close(self):
        self.history.close()
        for writer in self.writers or []:
            writer.close()
