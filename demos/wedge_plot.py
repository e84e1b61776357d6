"""The picture of demos/sliding_wedge.py."""

from mpi4py import MPI

import numpy as np
from plotting import cells, draw_cells, node_values, pyplot, save


class Look:
    """Keeps the deformed bodies at the end, gathered for the picture alone."""

    def __call__(self, *bodies):
        """Take them over; collective."""
        comm = bodies[0].mesh.comm
        moves = [node_values(body.u) for body in bodies]
        largest = comm.allreduce(max(np.abs(u).max(initial=0.0) for u in moves), op=MPI.MAX)
        #: Displacements are drawn this many times as large: 1, 2 or 5 times a power of ten.
        self.factor = max(f for f in magnifications() if f == 1 or f * largest <= 0.4)
        self.bodies = [
            cells(body.mesh, self.factor * u, body.stress[1, 1])
            for body, u in zip(bodies, moves, strict=True)
        ]

    def plot(self, filename, table, exact):
        """Stress in the deformed bodies, and F / G; on rank 0."""
        figure, axes = pyplot().subplots(
            1, 2, figsize=(12, 4), width_ratios=(1.5, 1), layout="constrained"
        )
        limit = max(np.percentile(np.abs(stress), 98) for _, stress in self.bodies)
        for corners, stress in self.bodies:
            drawn = draw_cells(axes[0], corners, stress, cmap="RdBu_r", clim=(-limit, limit))
        axes[0].autoscale_view()
        axes[0].set(xlabel="x (-)", ylabel="y (-)")
        axes[0].set_title(f"deformed meshes, displacements {self.factor:g} times as large")
        label = "vertical stress / (G / length) (-)"
        below = {"orientation": "horizontal", "aspect": 40, "extend": "both"}
        figure.colorbar(drawn, ax=axes[0], label=label, **below)
        shift = 1e3 * np.array([row["shift"] for row in table])
        axes[1].plot(shift, [row["ratio"] for row in table], "o-", label="F / G")
        axes[1].axhline(exact, color="black", ls="--", lw=1, label="closed form, full slip")
        axes[1].set(xlabel="shift of the wedge's back (1e-3)", ylabel="F / G (-)")
        axes[1].set(xlim=(0, None), ylim=(0, 1.15 * max(exact, *(row["ratio"] for row in table))))
        axes[1].grid()
        axes[1].legend(loc="lower right")
        save(figure, filename)


def magnifications():
    """1, 2, 5, 10 and so on."""
    return [digit * 10**power for power in range(6) for digit in (1, 2, 5)]
