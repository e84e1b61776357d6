"""Run the half ring on a block (ring.py) through GetFEM: large sliding contact by ray tracing.

python3 bench/peers/install.py getfem --install FOLDER
FOLDER/getfem/python bench/peers/getfem_ring.py --refine 2 --friction 0.2
"""

import pathlib
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import getfem_sliding as sliding
import ring

#: Number of the clamped region.
HELD = 2
#: Fraction of the largest traction above which a node counts as active.
CLOSED = 0.01


class Scene(sliding.Scene):
    """The model of both bodies in contact."""

    HEADER = (
        "step    x_end   y_end      down     along  ring x    ring y   block y"
        "  Newton  in vain  parts  closed  seconds"
    )

    def __init__(self, p):
        bodies = ring.bodies(p.refine)
        parts = {n: sliding.Part(body, p.order) for n, body in bodies.items()}
        for name, part in parts.items():
            part.mark_between(HELD, bodies[name].held)
        super().__init__(p, parts, {name: ring.moduli(name) for name in parts})
        master = {"ring": "block", "block": "ring"}[p.slave]
        brick, before = self.add_brick(p.slave)
        self.model.add_slave_contact_boundary_to_large_sliding_contact_brick(
            brick,
            parts[p.slave].surface,
            sliding.TOUCHING,
            f"u_{p.slave}",
            "traction",
            *before[p.slave],
        )
        self.model.add_master_contact_boundary_to_large_sliding_contact_brick(
            brick, parts[master].surface, sliding.TOUCHING, f"u_{master}", *before[master]
        )
        self.clamp("ring", HELD, "moved")
        self.clamp("block", HELD, "fixed")

    def row(self):
        """Return the results of a state.

        ``down`` and ``along`` are the force of the ring on the block, from the reactions of the
        block's clamped nodes; ``balance`` is the difference from the reactions of the ring's
        clamped nodes; ``inside`` is the largest residual force at a node without contact and
        conditions. The others are displacements.
        """
        forces = {name: self.forces(name) for name in self.parts}
        on_ring, on_block = (forces[n][self.parts[n].body.held].sum(axis=0) for n in self.parts)
        inside = [np.delete(forces[n], self.loaded(n), axis=0) for n in self.parts]
        tractions = np.hypot(*self.values("traction").reshape(-1, 2).T)
        found = {
            "down": float(on_block[1]),
            "along": float(-on_block[0]),
            "balance": float(np.abs(on_ring + on_block).max()),
            "inside": float(max(np.abs(f).max() for f in inside)),
            "closed": int((tractions > CLOSED * tractions.max()).sum()),
        }
        for name, part in self.parts.items():
            u = self.displacements(name)
            found |= {point: u[node].tolist() for point, node in part.body.tracked.items()}
        return found

    def line(self, row):
        """Format a line of the table."""
        ends = row["ends"]
        return (
            f"{row['step']:4}{ends[0]:9.3f}{ends[1]:8.3f}{row['down']:10.4f}{row['along']:10.4f}"
            f"{row['ring_outside'][0]:8.4f}{row['ring_outside'][1]:10.5f}"
            f"{row['block_middle'][1]:10.5f}{row['newton']:8}{row['in_vain']:9}{row['parts']:7}"
            f"{row['closed']:8}{row['seconds']:9.2f}"
        )

    def loaded(self, name):
        """Return the nodes with external forces."""
        body = self.parts[name].body
        return np.union1d(body.touching, body.held)


def main():
    parser = sliding.arguments(__doc__, release=0.15)
    add = parser.add_argument
    add("--slave", choices=("ring", "block"), default="ring", help="surface with multipliers")
    p = parser.parse_args()
    if sliding.gf is None:
        parser.error("needs the package getfem: see the head of this file")
    sliding.run(Scene, p, ring.path(p.along))


if __name__ == "__main__":
    main()
