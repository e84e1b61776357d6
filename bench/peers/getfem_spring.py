"""Run the spring of spring.py through GetFEM: its large sliding contact with ray tracing.

The self-contact surface is both slave and master: multipliers are on all of it.

    python3 bench/peers/install.py getfem --install FOLDER
    FOLDER/getfem/python bench/peers/getfem_spring.py --refine 2 --friction 0.2

With --slave lower or upper this half is the slave, the other one the master.
"""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import getfem_sliding as sliding
import spring

#: Numbers of the clamped regions, and of the halves of the contact surface.
FIXED, MOVED, SLAVE, MASTER = 2, 3, 4, 5


class Scene(sliding.Scene):
    """The model of the spring in self-contact."""

    HEADER = spring.HEADER + "  in vain  parts  seconds"

    def __init__(self, p):
        self.body = body = spring.spring(p.refine)
        part = sliding.Part(body, p.order)
        part.mark_between(FIXED, body.fixed)
        part.mark_between(MOVED, body.moved)
        super().__init__(p, {"spring": part}, {"spring": spring.moduli()})
        if p.slave == "both":
            self.add_itself(part)
        else:
            self.add_two(part, {"lower": (-1, 1), "upper": (1, -1)}[p.slave])
        self.clamp("spring", FIXED, "fixed")
        self.clamp("spring", MOVED, "moved")

    def add_itself(self, part):
        """Make the whole surface both slave and master."""
        brick, before = self.add_brick("spring")
        self.model.add_master_slave_contact_boundary_to_large_sliding_contact_brick(
            brick, part.surface, sliding.TOUCHING, "u_spring", "traction", *before["spring"]
        )

    def add_two(self, part, halves):
        """Make one half the slave, the other one the master."""
        for region, half in zip((SLAVE, MASTER), halves, strict=True):
            part.mark_edges(region, self.body.half(half))
        brick, before = self.add_brick("spring", SLAVE)
        self.model.add_slave_contact_boundary_to_large_sliding_contact_brick(
            brick, part.surface, SLAVE, "u_spring", "traction", *before["spring"]
        )
        self.model.add_master_contact_boundary_to_large_sliding_contact_brick(
            brick, part.surface, MASTER, "u_spring", *before["spring"]
        )

    def row(self):
        """Return the results of a state, see spring.told()."""
        return spring.told(self.body, self.displacements("spring"), self.forces("spring"))

    def line(self, row):
        """Format a line of the table."""
        return (
            spring.line(row["ends"], row)
            + f"{row['in_vain']:9}{row['parts']:7}{row['seconds']:9.2f}"
        )


def main():
    parser = sliding.arguments(__doc__, release=0.3)
    slaves = "both", "lower", "upper"
    parser.add_argument("--slave", choices=slaves, default="both", help="half with multipliers")
    p = parser.parse_args()
    if sliding.gf is None:
        parser.error("needs the package getfem: see the head of this file")
    sliding.run(Scene, p, spring.path(p.along))


if __name__ == "__main__":
    main()
