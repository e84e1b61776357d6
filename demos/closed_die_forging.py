"""One run of the closed-die demo: the present state of the billet, and its remeshing."""

import qsdolfinx as qs

from closed_die_bodies import RADIUS, SPEED, M, build, raise_die, read_dies, stroke_of
from closed_die_tools import FLASH, billet_mesh, cell_size

SMALLEST = 0.4  # size of the smallest cells over that of the largest
TURNED = 5.2  # mm: size of the largest cells over the angle of a cell on a rounding (rad)


class Forging:
    """A run: the present state of the billet, and the stepper that remeshes it.

    Args:
        p: Parameters.
        comm: Communicator.
    """

    def __init__(self, p, comm):
        self.p, self.dt = p, p.advance / SPEED
        self.dies, self.whole = read_dies(comm, p.tool_size), stroke_of(p.flash)
        raise_die(self.dies[1], self.whole)
        self.build([billet_mesh(comm, RADIUS, p.flash, p.size)], [None])
        remesh = qs.Remeshing(
            self.build,
            self.size,
            every=p.every,
            min_quality=p.remesh_quality,
            fields=lambda: {"strain": self.scene.strain},
        )
        self.stepper = qs.TimeStepper(
            self.scene.problem,
            self.dt,
            self.drive,
            solve=self.solve,
            min_quality=p.min_quality,
            staggered=self.scene.heat,
            remesh=remesh,
        )
        self.stepper.on_solved = lambda: self.scene.measure()

    def build(self, meshes, tags):
        """Build the scene on a mesh, the first one or a new one."""
        p = self.p
        self.scene = build(meshes[0], self.dies, self.dt, p.penalty, p.friction, p.solver)
        return self.scene.problem, self.scene.heat

    def size(self, msh):
        """Return cell sizes: smaller where the billet's surface is curved or near both dies."""
        largest, smallest = self.p.size, SMALLEST * self.p.size
        way = self.dies[1].position[2, 3]
        curved = qs.size_from_curvature(msh, largest / TURNED, smallest, largest)
        return [curved, lambda x: cell_size(x, way, largest, smallest)]

    def drive(self, t, dt):
        """Move the press down."""
        self.dies[1].displacement = [0.0, 0.0, -SPEED * dt]

    def solve(self, step):
        """Solve from the last velocity; from m = 1 in the first step, and if that fails."""
        qs.solve_with_continuation(self.scene.problem, self.scene.billet.m, M)

    def limit_step(self, way):
        """Limit the next step such that the flash loses at most a part of its thickness.

        Args:
            way: Remaining stroke of the press to closed dies.
        """
        self.stepper.dt_max = min(self.p.advance, self.p.thinning * (way + FLASH)) / SPEED
