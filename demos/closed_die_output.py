"""Results and pictures of the closed-die demo: sections, force over stroke, die stress."""

import numpy as np

from dolfinx import mesh

import qsdolfinx as qs

from closed_die_bodies import SPEED, TO_BILLET, TO_HEAT
from closed_die_tools import EDGE, profile
from common.drawing import (
    boundary,
    draw_triangles,
    gather,
    pyplot,
    save,
    set_view,
    steps_of_colour,
)


def mean_edge(surface):
    """Compute the edge of equilateral triangles with the facets' mean area. Collective."""
    msh, facets = surface.mesh, surface.facets
    own = facets[facets < msh.topology.index_map(2).size_local]
    area = 0.0
    if len(own):
        x = msh.geometry.x[mesh.entities_to_geometry(msh, 2, own)]
        across = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
        area = 0.5 * np.linalg.norm(across, axis=1).sum()
    area, number = msh.comm.allreduce(np.array([area, len(own)]))
    return np.sqrt(4 / np.sqrt(3) * area / number)


class Record:
    """Record of force, energies, volume and penetration of a run, over all meshes.

    Args:
        comm: Communicator.
        whole: Stroke of the press until the dies are closed.
        scene: The first scene.
        verbose: Whether to print the steps.
    """

    def __init__(self, comm, whole, scene, verbose):
        self.comm, self.whole = comm, whole
        self.volume = scene.billet.volume()
        self.facet_size = mean_edge(scene.contacts[0].slave)
        self.history = qs.History(comm, t_end=whole / SPEED, verbose=verbose)
        self.way = self.work = self.dissipated = self.friction = 0.0
        self.stored = self.cooled = self.warmed = 0.0
        self.steps = 0
        self.last_volume, self.last_filled, self.depth = self.volume, 0.0, 0.0
        #: Displacement of the press (mm) and force of the whole wheel (N) after each step.
        self.curve = [(0.0, 0.0)]

    def add_step(self, scene, stepper):
        """Add the results of a step. Collective."""
        dt = stepper.last_dt
        scene.advance(dt)
        self.way += SPEED * dt
        self.steps += 1
        force = scene.push()
        self.curve.append((self.way, 4 * force))
        self.work += force * SPEED * dt
        self.dissipated += dt * scene.power
        self.friction += sum(contact.step_dissipation() for contact in scene.contacts)
        self.stored = sum(contact.stored_energy() for contact in scene.contacts)
        self.cooled += dt * scene.cooled
        self.warmed += scene.warmed
        depth = scene.penetration()
        self.depth = max(self.depth, depth)
        self.last_volume = scene.billet.volume()
        self.last_filled = scene.filled(self.whole - self.way)
        motion = stepper.motions[0]
        row = {
            "way": self.way,
            "force_kN": 4e-3 * force,
            "depth": depth,
            "filled": self.last_filled,
            "quality": motion.quality(motion.reference),
            "energy_error": self.energy_error(),
            "heat_error": self.heat_error(),
            "iterations": stepper.num_iterations,
        }
        self.history.add({"t": self.way / SPEED, "dt": dt} | row)

    def energy_error(self):
        """Return the part of the work not in dissipation, friction or the contact penalty."""
        return 1 - (self.dissipated + self.friction + self.stored) / self.work

    def heat_error(self):
        """Return the error of the billet's heat balance over the heat of the work."""
        given = TO_HEAT * self.dissipated + TO_BILLET * self.friction
        return (given - self.cooled - self.warmed) / (TO_HEAT * self.work)

    def result(self, remeshings):
        """Return the results for --json, without those of the die and the time."""
        self.history.close()
        return {
            "steps": self.steps,
            "remeshings": remeshings,
            "volume_change": self.last_volume / self.volume - 1,
            "max_penetration": self.depth,
            "facet_size": float(self.facet_size),
            "filled": self.last_filled,
            "force_max": max(force for _, force in self.curve),
            "energy_error": float(max(self.energy_error(), self.heat_error(), key=abs)),
        }


def checks(result):
    """Return the checks of a run as lines: a value, its limit, and whether it is met."""
    limits = {
        "volume_change": (abs(result["volume_change"]), 5e-3),
        "max_penetration": (result["max_penetration"], 0.1 * result["facet_size"]),
        "energy_error": (abs(result["energy_error"]), 2e-2),
    }
    for name, (value, limit) in limits.items():
        kept = "kept" if value <= limit else "MISSED"
        yield f"{name:16} {value:.3g}, at most {limit:.3g}: {kept}"


def write_curve(filename, curve):
    """Write displacement (mm) and force (N) of the press after each step."""
    np.savetxt(filename, curve, delimiter=",", header="way_mm,force_N", comments="", fmt="%.9g")


def read_curve(filename):
    """Read a file of write_curve: displacement and force, shape (steps + 1, 2).

    Raises:
        ValueError: If the file has another format.
    """
    try:
        curve = np.loadtxt(filename, delimiter=",", skiprows=1, ndmin=2)
    except (OSError, ValueError) as error:
        raise ValueError(f"no curve in {filename}: {error}") from None
    if curve.shape[0] < 2 or curve.shape[1] != 2:
        raise ValueError(f"no curve in {filename}: it needs two columns and at least two rows")
    return curve


def compared(curve, other):
    """Return the differences of two curves on their common stroke, as lines.

    The mean difference is the area between the curves over the area (the work) below the other one.
    """
    curve, other = np.array(curve), np.array(other)
    end = min(curve[-1, 0], other[-1, 0])
    way = np.linspace(0.0, end, 2001)
    force, reference = (np.interp(way, *c.T) for c in (curve, other))
    apart, work = np.abs(force - reference), np.trapezoid(reference, way)
    mean = np.trapezoid(apart, way) / work
    at = int(np.argmax(apart))
    yield (
        f"forces to {end:.1f} mm: {mean:.2%} apart in the mean, "
        f"work {np.trapezoid(force, way) / work - 1:+.2%}, "
        f"at most {apart[at] / reference.max():.2%} of the largest, at {way[at]:.1f} mm"
    )


# --- Pictures


class Stages:
    """Data of each step for the pictures, gathered on rank 0."""

    def __init__(self, p):
        self.states, self.curve, self.whole = [], [], 0.0

    def __call__(self, scene, record):
        """Take a picture. Collective."""
        msh = scene.mesh
        nodes, behind = boundary(msh, msh.geometry.x)
        x = msh.geometry.x[nodes]
        values = scene.strain.x.array[behind]
        state = gather(msh.comm, x, values)
        self.curve, self.whole = record.curve, record.whole
        if state is not None:
            self.states.append((record.way, *state))

    def largest(self):
        """Return the largest strain on a symmetry plane, except for a few cells."""
        triangles, values = self.states[-1][1:]
        return max(np.percentile(values[np.abs(triangles[:, :, 1]).max(axis=1) < 1e-6], 99), 0.1)

    def draw_section(self, axis, i, scale):
        """Draw the billet between the dies in the plane y = 0, and its mirror image."""
        from matplotlib.collections import PolyCollection

        way, triangles, values = self.states[i]
        on = np.abs(triangles[:, :, 1]).max(axis=1) < 1e-6
        for side in (1, -1):
            corners = triangles[on][:, :, [0, 2]] * [side, 1]
            cells = PolyCollection(corners, array=values[on], cmap=scale.cmap, norm=scale.norm)
            cells.set(edgecolor=(0, 0, 0, 0.25), linewidth=0.15)
            axis.add_collection(cells)
        for die, turn, lift in (("lower", -1, 0.0), ("upper", 1, self.whole - way)):
            r, z = profile(die, 12).T
            r, z = np.concatenate([-r[::-1], r]), np.concatenate([z[::-1], z]) + lift
            back = z.min() - 9 if turn < 0 else z.max() + 9
            axis.fill_between(r, z, back, facecolor="0.8", edgecolor="0.35", lw=0.6, hatch="////")
            axis.plot(r, z, color="black", lw=0.9)
        axis.set(xlim=(-EDGE, EDGE), ylim=(-20, 24 + self.whole), aspect="equal")
        axis.set_axis_off()
        axis.set_title(f"{abs(self.whole - way):.1f} mm to go", fontsize=9)

    def draw_curve(self, axis, i):
        """Draw the force of the press over its displacement, and mark a state."""
        way, force = np.array(self.curve).T
        axis.plot(way[1:], force[1:] / 1e3, color="0.75")
        axis.plot(way[1 : i + 1], force[1 : i + 1] / 1e3, color="tab:blue")
        if i:
            axis.plot(way[i], force[i] / 1e3, "o", color="tab:blue", clip_on=False)
        axis.set(xlim=(0, self.whole), ylim=(0, 1.05 * max(force.max() / 1e3, 1e-9)))
        axis.set(xlabel="way of the press (mm)", ylabel="force of the press (kN)")
        axis.grid()

    def draw_wheel(self, axis, scale):
        """Draw three quarters of the final wheel, so that the section is visible."""
        _, triangles, values = self.states[-1]
        parts, colours = [], []
        for quarter in range(3):
            c, s = np.round(np.cos(quarter * np.pi / 2)), np.round(np.sin(quarter * np.pi / 2))
            turned = triangles @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
            parts.append(turned)
            colours.append(scale.to_rgba(values))
        reach = np.abs(triangles[:, :, 0]).max()
        low, high = triangles[:, :, 2].min(), triangles[:, :, 2].max()
        set_view(axis, 32, -45, ((-reach, reach), (-reach, reach), (low, high)), zoom=1.45)
        draw_triangles(axis, np.concatenate(parts), np.concatenate(colours), linewidth=0.1)

    def plot(self, filename, die):
        """Draw stages, force, the wheel, and stress in the lower die. Collective."""
        nodes, behind = boundary(die.mesh, die.mesh.geometry.x)
        stress = die.von_mises()
        solid = gather(die.mesh.comm, die.mesh.geometry.x[nodes], stress[behind])
        if not self.states:
            return
        strain = steps_of_colour(self.largest(), "inferno")
        figure = pyplot().figure(figsize=(12.5, 7.4))
        last = len(self.states) - 1
        way = np.array([state[0] for state in self.states])
        for k, part in enumerate((0.0, 0.4, 0.75, 1.0)):
            i = int(np.argmin(np.abs(way - part * way[-1])))
            axis = figure.add_axes((0.005 + 0.232 * k, 0.5, 0.228, 0.47))
            self.draw_section(axis, i, strain)
        bar = figure.add_axes((0.935, 0.55, 0.01, 0.38))
        figure.colorbar(strain, cax=bar, label="equivalent strain (-)", extend="max")
        self.draw_curve(figure.add_axes((0.06, 0.09, 0.25, 0.36)), last)
        axis = figure.add_axes((0.33, 0.0, 0.33, 0.46), projection="3d")
        self.draw_wheel(axis, strain)
        axis = figure.add_axes((0.64, 0.0, 0.28, 0.46), projection="3d")
        triangles, values = solid
        mises = steps_of_colour(max(np.percentile(values, 99.5), 1e-9), "viridis")
        limits = (0, EDGE), (0, EDGE), (triangles[:, :, 2].min(), triangles[:, :, 2].max())
        set_view(axis, 42, 225, limits, zoom=1.05)
        draw_triangles(axis, triangles, mises.to_rgba(values), linewidth=0.1)
        bar = figure.add_axes((0.925, 0.06, 0.01, 0.36))
        label = "equivalent stress, lower die (MPa)"
        figure.colorbar(mises, cax=bar, label=label, extend="max")
        save(figure, filename)

    def animate(self, filename, frames_per_second=6):
        """Write all states as a GIF, on rank 0."""
        if not self.states:
            return
        from matplotlib.animation import PillowWriter

        figure, writer = pyplot().figure(figsize=(9, 4)), PillowWriter(fps=frames_per_second)
        strain = steps_of_colour(self.largest(), "inferno")
        with writer.saving(figure, filename, dpi=80):
            for i in range(len(self.states)):
                figure.clear()
                self.draw_section(figure.add_axes((0.0, 0.0, 0.5, 0.93)), i, strain)
                bar = figure.add_axes((0.51, 0.12, 0.012, 0.78))
                figure.colorbar(strain, cax=bar, label="equivalent strain (-)", extend="max")
                self.draw_curve(figure.add_axes((0.67, 0.13, 0.31, 0.78)), i)
                writer.grab_frame()
            for _ in range(2 * frames_per_second):  # hold the last frame
                writer.grab_frame()
        pyplot().close(figure)
