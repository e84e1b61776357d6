"""Write the history of a run, and fields for ParaView, into a folder."""

import pathlib

import qsdolfinx as qs


class Output:
    """Writes the history of a run, optionally also to the terminal, and fields into a folder.

    Args:
        comm: Communicator.
        folder: Output folder; with None nothing is written.
        t_end: End time of the run.
        verbose: Whether to print the history.
        after: Number of steps made before this run. Their history is continued; the fields go to
            new files.
    """

    def __init__(self, comm, folder, t_end, verbose, after=0):
        self.folder = pathlib.Path(folder) if folder else None
        if self.folder and comm.rank == 0:
            self.folder.mkdir(parents=True, exist_ok=True)
        comm.barrier()
        file = self.folder and self.folder / "history.csv"
        self.history = qs.History(comm, file, t_end=t_end, verbose=verbose, append=after > 0)
        self.part = f"_from_{after}" if after else ""
        self.files, self.writers = [], []

    def add_fields(self, name, msh, fields, at_vertices):
        """Open a file for cell fields and for continuous fields at the vertices."""
        if self.folder:
            path = self.folder / f"{name}{self.part}.xdmf"
            self.files.append((path, msh, fields, at_vertices))

    def write(self, t, row):
        """Add a step. Collective."""
        self.history.add(row)
        if not self.writers:  # tractions with an automatic penalty are known from here on
            self.writers = [qs.FieldWriter(*file) for file in self.files]
        for writer in self.writers:
            writer.write(t)

    def close(self):
        """Close the history and the files."""
        self.history.close()
        for writer in self.writers:
            writer.close()
