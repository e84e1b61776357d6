"""Draw pictures of forging: bodies, pressure on the lower die and force, step by step."""

import numpy as np

from common.drawing import (
    GREY,
    STEEL,
    boundary,
    draw_triangles,
    gather,
    node_values,
    pyplot,
    save,
    set_view,
    steps_of_colour,
)


class Film:
    """Keeps the state of each step for the pictures, gathered on rank 0.

    Args:
        height: Initial height of the workpiece.
        speed: Speed of the upper die.
    """

    def __init__(self, height, speed):
        self.height, self.speed = height, speed
        self.states = []

    def __call__(self, scene, strain):
        """Keep the present state. Collective."""
        work, dies, contacts, _, stepper = scene
        comm = work.mesh.comm
        x = work.mesh.geometry.x
        nodes, behind = boundary(work.mesh, x)
        state = {
            "reduction": 100 * self.speed * stepper.t / self.height,
            "work": gather(comm, x[nodes], strain.x.array[behind]),
        }
        force = 0.0
        side = "slave" if contacts[0].slave is dies[0].surface else "master"
        pressures = [None, None]
        if stepper.num_steps > 0:
            force = 4 * abs(contacts[1].force(side)[2])
            pressures[0] = -node_values(contacts[0].traction(side))[:, 2]
        state["force"] = force / 1e3
        for name, die, motion, pressure in zip(
            ("lower", "upper"), dies, stepper.motions[1:], pressures, strict=True
        ):
            nodes, _ = boundary(die.mesh, motion.reference)
            if pressure is None:
                pressure = np.zeros(len(motion.reference))
            on_face = np.isclose(motion.reference[nodes, 2], 0.0).all(axis=1)
            x = motion.reference + motion.values()
            state[name] = gather(comm, x[nodes], pressure[nodes].mean(axis=1), on_face)
        if comm.rank == 0:
            self.states.append(state)

    def scales(self):
        """Return the colour scales of strain and pressure, the same in all pictures."""
        strain = max(state["work"][1].max() for state in self.states)
        pressure = max(state["lower"][1].max() for state in self.states)
        limits = (max(strain, 1e-9), "inferno"), (max(pressure, 1e-9), "viridis")
        return [steps_of_colour(*limit) for limit in limits]

    def draw(self, figure, i):
        """Draw one state."""
        state, (strain, pressure) = self.states[i], self.scales()
        # Positions of the axes are fixed, so that nothing jumps between the pictures of a film.
        axis = figure.add_axes((0.0, 0.0, 0.32, 0.95), projection="3d")
        reach = np.max(self.states[0]["lower"][0][:, :, 0])
        limits = (0, reach), (0, reach), (-9, self.height + 9)
        set_view(axis, 14, 235, limits, zoom=1.05)
        for name in ("lower", "upper"):
            triangles = state[name][0]
            draw_triangles(axis, triangles, np.tile(GREY, (len(triangles), 1)))
        draw_triangles(axis, state["work"][0], strain.to_rgba(state["work"][1]))
        figure.text(0.16, 0.95, f"{state['reduction']:.0f} % reduction", ha="center")
        figure.colorbar(
            strain,
            cax=figure.add_axes((0.33, 0.15, 0.01, 0.75)),
            label="equivalent strain (-)",
        )
        self.draw_pressure(figure, state, pressure, reach)
        self.draw_force(figure.add_axes((0.775, 0.15, 0.215, 0.75)), i)

    @staticmethod
    def draw_pressure(figure, state, scale, reach):
        """Draw the face of the lower die, seen from above."""
        from matplotlib.collections import PolyCollection

        axis = figure.add_axes((0.455, 0.15, 0.19, 0.75))
        triangles, values, on_face = state["lower"]
        faces = PolyCollection(triangles[on_face][:, :, :2], array=values[on_face])
        faces.set(cmap=scale.cmap, norm=scale.norm, edgecolor="face", linewidth=0.2)
        axis.add_collection(faces)
        axis.set(xlim=(0, reach), ylim=(0, reach), aspect="equal", title="lower die from above")
        axis.set(xlabel="x (mm)", ylabel="y (mm)")
        axis.apply_aspect()
        box = axis.get_position()
        bar = figure.add_axes((box.x1 + 0.01, box.y0, 0.01, box.height))
        figure.colorbar(scale, cax=bar, label="pressure (MPa)")

    def draw_force(self, axis, i):
        """Draw the force over the reduction, as a full line up to this state."""
        reduction, force = (
            np.array([state[name] for state in self.states]) for name in ("reduction", "force")
        )
        first = 0 if len(force) == 1 else 1  # there is no force before the first step
        axis.plot(reduction[first:], force[first:], color="0.8")
        axis.plot(reduction[first : i + 1], force[first : i + 1], color="tab:blue")
        axis.plot(reduction[i], force[i], "o", color="tab:blue", clip_on=False)
        axis.set(xlim=(0, None), ylim=(0, 1.05 * max(force.max(), 1e-9)), title="forming force")
        axis.set(xlabel="reduction of the height (%)", ylabel="force on the upper die (kN)")
        axis.grid()

    def plot(self, filename):
        """Draw the picture of the last state; on rank 0."""
        if not self.states:
            return
        figure = self.figure()
        self.draw(figure, len(self.states) - 1)
        save(figure, filename)

    def animate(self, filename, frames_per_second=4):
        """Write all states as a GIF; on rank 0."""
        if not self.states:
            return
        from matplotlib.animation import PillowWriter

        figure, writer = self.figure(), PillowWriter(fps=frames_per_second)
        with writer.saving(figure, filename, dpi=80):
            for i in range(len(self.states)):
                figure.clear()
                self.draw(figure, i)
                writer.grab_frame()
            for _ in range(2 * frames_per_second):  # show the last picture longer
                writer.grab_frame()
        pyplot().close(figure)

    @staticmethod
    def figure():
        """Make a figure of the size that all pictures have."""
        return pyplot().figure(figsize=(12.5, 4.0))


# --- Comparison of contact formulations


def compare(filename, states, limit=300.0, lift=6.0):
    """Draw lower dies with the pressure on their faces, and the workpieces above them; on rank 0.

    Args:
        filename: Name of the picture file.
        states: Last state of each film, by title.
        limit: Upper end of the pressure scale, MPa.
        lift: Distance by which a workpiece is drawn above the die, mm.
    """
    from matplotlib import cm, colors

    figure = pyplot().figure(figsize=(12, 5.2))
    scale = cm.ScalarMappable(colors.Normalize(0, limit), "viridis")
    for i, (title, state) in enumerate(states.items()):
        axis = figure.add_axes((i / 3, 0.14, 1 / 3, 0.78), projection="3d")
        set_view(axis, 28, 35, ((0, 18), (0, 18), (-9, 17)), zoom=1.0)
        triangles, pressure, on_face = state["lower"]
        colours = np.tile(GREY, (len(triangles), 1))
        colours[on_face] = scale.to_rgba(pressure[on_face])
        draw_triangles(axis, triangles, colours, linewidth=0.25)
        work = state["work"][0] + [0, 0, lift]
        draw_triangles(axis, work, np.tile(STEEL, (len(work), 1)), linewidth=0.3)
        figure.text((i + 0.5) / 3, 0.95, title, ha="center")
    bar = figure.add_axes((0.3, 0.12, 0.4, 0.03))
    label = "pressure on the lower die, mean of a facet (MPa); radius of the die 18 mm"
    figure.colorbar(scale, cax=bar, orientation="horizontal", extend="max", label=label)
    save(figure, filename)
