"""Draw the pictures of the demos, one for each; those of forging are in film.py.

All functions are collective: the data are gathered on rank 0, which draws the picture.
"""

import dataclasses

from mpi4py import MPI

import numpy as np

import ufl

from common.command import FORMULATIONS
from common.drawing import (
    STEEL,
    boundary,
    cells,
    draw_cells,
    draw_triangles,
    gather,
    node_values,
    pyplot,
    save,
    set_view,
)

#: Line styles of the two sides of a contact.
SIDES = {"slave": "o-", "master": "s-"}

# --- Patch test


def patch_test(filename, parameters, run, stress, n_master=8, n_slave=3):
    """Draw the contact traction on both sides, for three contact formulations.

    Args:
        filename: Name of the picture file.
        parameters: Class of the parameters of the patch test.
        run: Called with parameters; its second result is the contact.
        stress: Exact stress.
        n_master: Number of cells along an edge of the master.
        n_slave: Number of cells along an edge of the slave.
    """
    kinds = {"master-slave": {"formulation": "master-slave"}, "quasi-symmetric": {}}
    kinds["overlay"] = {"quadrature": "overlay"}
    contacts = {name: run(parameters(n_master, n_slave, **kind))[1] for name, kind in kinds.items()}
    panels = []
    for side, n in (("slave", n_slave), ("master", n_master)):
        for name, contact in contacts.items():
            surface = getattr(contact, side)
            values = np.abs(surface.node_values(contact.traction(side))[:, 2] / stress)
            nodes = gather(surface.comm, surface.node_x, values)
            panels.append((f"{name}, {side}, {n} × {n}", np.linspace(0, 1, n + 1), nodes))
    if panels[0][-1] is None:
        return
    figure, axes = pyplot().subplots(
        2, 3, figsize=(10.5, 6.8), sharex=True, sharey=True, layout="compressed"
    )
    for axis, (title, ticks, (x, values)) in zip(axes.flat, panels, strict=True):
        grid = values[np.lexsort((x[:, 0], x[:, 1]))].reshape(len(ticks), len(ticks))
        options = {"shading": "gouraud", "cmap": "RdBu_r", "vmin": 0, "vmax": 2}
        image = axis.pcolormesh(ticks, ticks, grid, **options)
        axis.plot(*np.meshgrid(ticks, ticks), ".", color="black", markersize=3, clip_on=False)
        worst = 100 * np.max(np.abs(values - 1))
        text = f"{worst:.0f}" if worst > 1 else f"{worst:.0e}"
        axis.set(title=f"{title}\nlargest error {text} %", aspect="equal")
    for axis in axes[-1]:
        axis.set_xlabel("x / edge of the cube (-)")
    for axis in axes[:, 0]:
        axis.set_ylabel("y / edge of the cube (-)")
    label = "contact traction / applied pressure (-)"
    figure.colorbar(image, ax=axes, label=label, shrink=0.8, extend="max")
    save(figure, filename)
    print(f"\n{filename}: contact traction on both sides")


# --- Hertz and partial slip


def sorted_nodes(surface, x, *values):
    """Return the values at all nodes of a surface along x, on rank 0; None elsewhere."""
    lines = gather(surface.comm, x, *values)
    return lines and [line[np.argsort(lines[0])] for line in lines]


def hertz(filename, p, solve):
    """Draw the traction on both sides over Hertz's pressure, for three contact formulations.

    Args:
        filename: Name of the picture file.
        p: Parameters.
        solve: Called with parameters; returns closed form, slave, master, contact and problem.
    """
    panels = []
    for formulation, quadrature in (
        ("master-slave", "nodal"),
        ("quasi-symmetric", "nodal"),
        ("quasi-symmetric", "overlay"),
    ):
        case = dataclasses.replace(p, formulation=formulation, quadrature=quadrature)
        exact, slave, master, contact, problem = solve(case)
        lines = []
        for side, body in (("slave", slave), ("master", master)):
            surface = body.surface
            normal = surface.node_normal[:, : p.dim]
            t = -np.sum(surface.node_values(contact.traction(side)) * normal, axis=1)
            r = np.linalg.norm(surface.node_x[:, : p.dim - 1], axis=1)
            lines.append(sorted_nodes(surface, r, t))
        panels.append((f"{formulation}, {quadrature}", lines))
        problem.destroy()
    if lines[0] is None:
        return
    figure, axes = pyplot().subplots(1, 3, figsize=(12, 4), sharey=True, layout="constrained")
    s = np.linspace(0, 1.6, 400)
    for axis, (title, lines) in zip(axes, panels, strict=True):
        for (side, style), (r, t) in zip(SIDES.items(), lines, strict=True):
            # In 3D, nodes at the same distance have different values: no lines.
            style = style if p.dim == 2 else style.rstrip("-")
            near = r <= 1.6 * exact.a
            axis.plot(r[near] / exact.a, t[near] / exact.p0, style, ms=3, lw=0.8, label=side)
        axis.plot(s, exact.pressure(s * exact.a) / exact.p0, color="black", label="Hertz")
        axis.set(title=title, xlabel="distance from the middle / a (-)")
        axis.grid()
    axes[0].legend()
    axes[0].set_ylabel("contact traction / p0 (-)")
    save(figure, filename)


def cattaneo_mindlin(filename, p, solve, tractions):
    """Draw the normal traction above, the tangential traction below, nodal and overlay.

    Args:
        filename: Name of the picture file.
        p: Parameters.
        solve: Called with parameters; returns the scene.
        tractions: Called with scene and side; returns normal and tangential traction at its nodes.
    """
    columns = []
    for quadrature in ("nodal", "overlay"):
        scene = solve(dataclasses.replace(p, quadrature=quadrature))
        surfaces = {side: body.surface for side, body in scene.bodies.items()}
        lines = {
            side: sorted_nodes(surface, surface.node_x[:, 0], *tractions(scene, side))
            for side, surface in surfaces.items()
        }
        columns.append((f"{p.formulation}, {quadrature}", lines))
    if lines["slave"] is None:
        return
    figure, axes = pyplot().subplots(
        2, 2, figsize=(11, 7), sharex=True, sharey="row", layout="constrained"
    )
    exact, s = scene.exact, np.linspace(-1.3, 1.3, 2001)
    rows = (
        ("normal traction / p0 (-)", exact.p0, exact.normal),
        ("tangential traction / (μ p0) (-)", exact.limit, exact.tangential),
    )
    for column, (title, lines) in zip(axes.T, columns, strict=True):
        column[0].set_title(title)
        column[1].set_xlabel("x / b (-)")
        for axis, (_, unit, function), part in zip(column, rows, (1, 2), strict=True):
            for side, style in SIDES.items():
                x, t = lines[side][0] / exact.a, lines[side][part] / unit
                near = np.abs(x) <= 1.3
                axis.plot(x[near], t[near], style, ms=2.5, lw=0.7, label=side)
            closed = function(s * exact.a) / unit
            axis.plot(s, closed, color="black", lw=1, label="closed form")
            axis.grid()
    for axis, (label, _, _) in zip(axes[:, 0], rows, strict=True):
        axis.set_ylabel(label)
    axes[0, 0].legend()
    save(figure, filename)


# --- Block on block


class Friction:
    """Friction on a dragged block, and the state of its nodes, in three states.

    Args:
        limit: Total friction μN at full slip; the area of contact is 1.
    """

    KINDS = (("white", "open"), ("black", "sticks"), ("red", "slips"))

    def __init__(self, limit):
        self.limit = limit
        self.states = []

    def __call__(self, contact, row):
        """Keep the present state. Collective."""
        surface = contact.slave
        t = surface.node_values(contact.traction("slave", part="tangential"))
        status = contact.active().astype(int) + contact.slipping()
        nodes = gather(contact.comm, surface.node_x[:, :2], t[:, :2] / self.limit, status)
        self.states.append((row, nodes))

    def draw(self, filename):
        """Draw the first drag, the state with half of the area slipping, and the end; on rank 0."""
        if self.states[0][1] is None:
            return
        middle = min(self.states[1:], key=lambda state: abs(state[0]["slip"] - 0.5))
        figure, axes = pyplot().subplots(1, 3, figsize=(12, 4.5), sharey=True)
        figure.subplots_adjust(left=0.05, right=0.91, bottom=0.2, top=0.94, wspace=0.06)
        for axis, state in zip(axes, (self.states[1], middle, self.states[-1]), strict=True):
            colours = self.draw_state(axis, *state)
            axis.set_xlabel("x, dragged to the right (-)")
        axes[0].set_ylabel("y (-)")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncols=3)
        box = axes[-1].get_position()
        bar = figure.add_axes((box.x1 + 0.012, box.y0, 0.012, box.height))
        label = "friction on the upper block / (μN / area) (-)"
        figure.colorbar(colours, cax=bar, label=label, ticks=np.linspace(0, 2, 5))
        save(figure, filename)

    def draw_state(self, axis, row, nodes):
        """Draw size and direction of the friction, and whether nodes stick or slip."""
        x, t, status = nodes
        size = np.linalg.norm(t, axis=1)
        colours = axis.tricontourf(*x.T, size, levels=np.linspace(0, 2, 21), extend="max")
        axis.quiver(*x.T, *t.T, color="white", width=0.004, scale=16, zorder=3)
        for kind, (face, label) in enumerate(self.KINDS):
            style = {"ms": 4.5, "mec": "black", "mew": 0.5, "clip_on": False}
            axis.plot(*x[status == kind].T, "o", color=face, label=label, **style)
        axis.set_title(f"shift {row['shift']:.3f}: T = {row['ratio']:.2f} μN")
        axis.set_aspect("equal")
        return colours


# --- Sliding wedge


def sliding_wedge(filename, bodies, rows, exact):
    """Draw the stress in the deformed bodies, and F / G.

    Args:
        filename: Name of the picture file.
        bodies: The bodies at the end.
        rows: Table rows of all steps.
        exact: F / G from the closed form.
    """
    moves = [node_values(body.u) for body in bodies]
    comm = bodies[0].mesh.comm
    largest = comm.allreduce(max(np.abs(u).max(initial=0.0) for u in moves), op=MPI.MAX)
    # The displacements are magnified by a factor of 1, 2 or 5 times a power of ten.
    factors = [digit * 10**power for power in range(6) for digit in (1, 2, 5)]
    factor = max(f for f in factors if f == 1 or f * largest <= 0.4)
    drawn = [
        cells(body.mesh, factor * u, body.stress[1, 1])
        for body, u in zip(bodies, moves, strict=True)
    ]
    if drawn[0] is None:
        return
    figure, (left, right) = pyplot().subplots(
        1, 2, figsize=(12, 4), width_ratios=(1.5, 1), layout="constrained"
    )
    limit = max(np.percentile(np.abs(stress), 98) for _, stress in drawn)
    for corners, stress in drawn:
        colours = draw_cells(left, corners, stress, cmap="RdBu_r", clim=(-limit, limit))
    left.autoscale_view()
    left.set(xlabel="x (-)", ylabel="y (-)")
    left.set_title(f"deformed meshes, displacements {factor:g} times as large")
    label = "vertical stress / (G / length) (-)"
    below = {"orientation": "horizontal", "aspect": 40, "extend": "both"}
    figure.colorbar(colours, ax=left, label=label, **below)
    ratio = [row["ratio"] for row in rows]
    right.plot(1e3 * np.array([row["shift"] for row in rows]), ratio, "o-", label="F / G")
    right.axhline(exact, color="black", ls="--", lw=1, label="closed form, full slip")
    right.set(xlabel="shift of the wedge's back (1e-3)", ylabel="F / G (-)")
    right.set(xlim=(0, None), ylim=(0, 1.15 * max(exact, *ratio)))
    right.grid()
    right.legend(loc="lower right")
    save(figure, filename)


# --- Ironing


def ironing(filename, p, iron, plateau):
    """Draw deformed meshes in the middle of the slide, and forces over the slide.

    Args:
        filename: Name of the picture file.
        p: Parameters.
        iron: Called with parameters and ``on_step(row, scene)``; its second result is the rows.
        plateau: Called with parameters and rows; returns the columns of the plateau, and the row
            before it.
    """
    kinds = (
        ("master-slave", "nodal", "tab:red"),
        ("quasi-symmetric", "nodal", "tab:blue"),
        ("quasi-symmetric", "overlay", "black"),
    )
    run_in, steps = p.plan()
    lines, bodies = [], []

    def at_middle(row, scene):
        if not bodies and row.slide >= (run_in + steps) / 2 * p.facets / steps:
            bodies.extend(deformed(body) for body in scene[:2])

    for formulation, quadrature, colour in kinds:
        bodies.clear()
        case = dataclasses.replace(p, formulation=formulation, quadrature=quadrature)
        lines.append((f"{formulation}, {quadrature}", colour, iron(case, on_step=at_middle)[1]))
    if bodies[0] is None:
        return
    figure = pyplot().figure(figsize=(12, 7.4), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=(1.15, 1))
    draw_meshes(above.subplots(), bodies)
    axes = below.subplots(1, 3)
    for title, colour, rows in lines:
        columns, before = plateau(p, rows)
        sliding = [row for row in rows if row.slide > 0]
        place = [row.slide for row in sliding]
        for axis, name in zip(axes, ("fx", "fy"), strict=False):
            mean = np.average(getattr(columns, name), weights=columns.dt)
            force = np.array([getattr(row, name) for row in sliding])
            axis.plot(place, 100 * (force / mean - 1), "-", color=colour, lw=1, label=title)
        axes[2].plot(place, [abs(row.fx / row.fy) for row in sliding], color=colour, lw=1)
    axes[0].set(ylim=(-2.6, 2.6), ylabel="Fx, off its mean on the plateau (%)")
    axes[1].set(ylim=(-0.5, 0.5), ylabel="Fy, off its mean on the plateau (%)")
    axes[2].set(ylim=(0.97 * p.mu, 1.03 * p.mu), ylabel="|Fx / Fy| (-); dashed: μ")
    axes[2].axhline(p.mu, color="grey", ls="--", lw=1)
    for axis in axes:
        axis.axvspan(0, before.slide, color="0.93", zorder=0)
        axis.set(xlabel="slide (facets of the slab)", xlim=(0, None))
        axis.grid()
    axes[0].legend(loc="lower right")
    save(figure, filename)


def deformed(body):
    """Return the deformed cells and the Cauchy shear stress in them, on rank 0."""
    F = ufl.Identity(2) + ufl.grad(body.u)
    shear = (body.stress * F.T / ufl.det(F))[0, 1]
    return cells(body.mesh, node_values(body.u), shear)


def draw_meshes(axis, bodies):
    """Draw both bodies around the contact, with equal scales."""
    limit = max(np.abs(shear).max() for _, shear in bodies[1:])
    for corners, shear in bodies:
        drawn = draw_cells(axis, corners, shear, cmap="RdBu_r", clim=(-limit, limit))
    x = bodies[0][0]
    middle, half = 0.5 * (x[..., 0].min() + x[..., 0].max()), 2.2
    axis.set(xlim=(middle - half, middle + half), ylim=(-1.02, 0.8))
    axis.set(xlabel="x / height of the slab (-)", ylabel="y / height of the slab (-)")
    axis.set_title("deformed meshes in the middle of the slide to the right, overlay")
    label = "shear stress / E of the slab (-)"
    axis.figure.colorbar(drawn, ax=axis, label=label, extend="both", pad=0.01)


# --- Shaft


def shaft(filename, p, turn):
    """Draw deformed meshes and traction before and after the turn, and torque over angle.

    Args:
        filename: Name of the picture file.
        p: Parameters; without friction the shaft is also turned with a coefficient of 0.2.
        turn: Called with parameters and ``on_step(row, scene)``; its second result is the rows.
    """
    with_friction = p if p.mu else dataclasses.replace(p, mu=0.2)
    states, lines = [], []

    def keep(row, scene):
        if row.angle in (0, p.turn):
            states.append((row, pressed(*scene[:3])))

    for mu in (0.0, with_friction.mu):
        for steps in (4 * p.steps, p.steps):
            states.clear()
            case = dataclasses.replace(p, mu=mu, steps=steps)
            lines.append((mu, steps, turn(case, on_step=keep)[1]))
    if states[0][1] is None:
        return
    figure = pyplot().figure(figsize=(12, 4.1), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(2, 1))
    axes = left.subplots(1, 2, sharey=True)
    largest = max(np.percentile(drawn[0][1], 98) for _, drawn in states)
    for axis, (row, drawn) in zip(axes, (states[0], states[-1]), strict=True):
        colours = draw_pressed(axis, largest, *drawn)
        axis.set_xlabel("x / radius (-)")
        axis.set_title(f"turned by {row.angle:.0f}°; arrows: traction")
    axes[0].set_ylabel("y / radius (-)")
    label = "radial stress, compression / E of the bore (-)"
    left.colorbar(colours, ax=axes, label=label, extend="max", pad=0.01, shrink=0.82)
    draw_torque(right.subplots(), lines)
    save(figure, filename)


def pressed(inner, outer, contact):
    """Return the cells with radial stress, a spoke of each body, and the traction, on rank 0."""
    bodies = []
    for body in (inner, outer):
        F = ufl.Identity(2) + ufl.grad(body.u)
        x = ufl.SpatialCoordinate(body.mesh) + body.u
        radial = ufl.dot(x, body.stress * F.T / ufl.det(F) * x) / ufl.dot(x, x)
        now = cells(body.mesh, node_values(body.u), -radial)
        bodies.append((body.start, cells(body.mesh), now))
    own = inner.touching[inner.touching < inner.V.dofmap.index_map.size_local]
    t = contact.traction("slave").x.array.reshape(-1, 2)
    arrows = gather(contact.comm, inner.positions()[own], t[own])
    if arrows is None:
        return None
    spokes = []
    for start, (corners, _), (moved, _) in bodies:
        x, y = corners.reshape(-1, 2).T
        on = np.abs(np.arctan2(y, x) - start) < 1e-6
        spokes.append(moved.reshape(-1, 2)[on][np.argsort(np.hypot(x, y)[on])])
    both = [np.concatenate(parts) for parts in zip(*(now for *_, now in bodies), strict=True)]
    return both, spokes, arrows


def draw_pressed(axis, largest, drawn, spokes, arrows):
    """Draw both bodies, the traction on the shaft, and the displaced spoke of each body."""
    colours = draw_cells(axis, *drawn, cmap="Oranges", clim=(0, 1.25 * largest), linewidth=0.25)
    for spoke, colour in zip(spokes, ("tab:blue", "black"), strict=True):
        axis.plot(*spoke.T, color=colour, lw=3, solid_capstyle="butt")
    x, t = arrows
    some = np.argsort(np.arctan2(*x.T))[:: max(1, len(x) // 16)]
    size = np.linalg.norm(t, axis=1).max()
    options = {"angles": "xy", "pivot": "tip", "width": 0.007, "zorder": 3}
    axis.quiver(*x[some].T, *(t[some] / size).T, scale_units="xy", scale=2.6, **options)
    axis.set(xlim=(-1.6, 1.6), ylim=(-1.6, 1.6))
    return colours


def draw_torque(axis, lines):
    """Draw the torque over the angle, and the closed form."""
    few = min(steps for _, steps, _ in lines)
    for mu, steps, rows in lines:
        angle, torque = ([getattr(row, name) for row in rows] for name in ("angle", "torque"))
        colour = "tab:blue" if mu else "tab:green"
        style = {"marker": "o", "ls": ""} if steps == few else {"lw": 1.5}
        axis.plot(angle, torque, color=colour, label=f"μ = {mu:g}, {steps} steps", **style)
    end = rows[-1]
    closed = np.copysign(mu * end.normal * end.radius, end.torque)
    axis.axhline(closed, color="black", ls="--", lw=1, label="μ N r", zorder=0)
    axis.set_title("torque on the shaft")
    axis.set(xlabel="angle (degrees)", ylabel="torque / (radius² E of the bore) (-)")
    axis.grid()
    axis.legend(loc="center right")


# --- Ring compression


def ring_compression(filename, results, shown=(0.0, 0.15, 0.7)):
    """Draw deformed sections, and calibration curves.

    Args:
        filename: Name of the picture file.
        results: Result, history and ring for each friction factor.
        shown: Friction factors whose sections are drawn.
    """
    sections = {factor: cells(results[factor][2].mesh) for factor in shown}
    if sections[shown[0]] is None:
        return
    figure = pyplot().figure(figsize=(12, 5.6), layout="constrained")
    grid = figure.add_gridspec(len(shown), 2, width_ratios=(1, 1.25))
    first = None
    for i, (factor, (corners, _)) in enumerate(sections.items()):
        first = axis = figure.add_subplot(grid[i, 0], sharex=first)
        draw_cells(axis, corners, facecolor="none", edgecolor="tab:red", linewidth=0.5)
        for z in (0, corners[..., 1].max()):
            axis.plot([0, 24], [z, z], color="black", lw=2)
        axis.axvline(0, color="black", lw=0.8, ls="-.")
        for radius in (7.5, 15.0):
            axis.axvline(radius, color="gray", lw=0.8, ls=":")
        axis.set(ylabel="z (mm)", xlim=(-0.5, 24))
        title = "no friction" if factor == 0 else f"m\u0304 = {factor:g}"
        axis.set_title(f"{title}, {results[factor][1][-1]['reduction']:.0%} reduction")
        axis.tick_params(labelbottom=i == len(shown) - 1)
    first.set_xlabel("r (mm); dotted: radii before")
    draw_calibration(figure.add_subplot(grid[:, 1]), results)
    save(figure, filename)


def draw_calibration(axis, results):
    """Draw the inner diameter over the reduction."""
    colours = pyplot().get_cmap("viridis")(np.linspace(0, 0.9, len(results)))
    for colour, (factor, (_, rows, _)) in zip(colours, results.items(), strict=True):
        reduction = np.array([0.0] + [row["reduction"] for row in rows])
        change = np.array([1.0] + [row["inner_radius"] for row in rows]) - 1
        axis.plot(100 * reduction, -100 * change, color=colour, label=f"m\u0304 = {factor:g}")
    s = np.linspace(0, max(reduction), 50)
    axis.plot(100 * s, 100 * (1 - 1 / np.sqrt(1 - s)), "k:", label="closed form, m\u0304 = 0")
    axis.axhline(0, color="gray", lw=0.8)
    axis.set_xlabel("reduction of the height (%)")
    axis.set_ylabel("decrease of the inner diameter (%)")
    axis.set_title("ring 6:3:2, Tresca's friction")
    axis.grid()
    axis.legend()


# --- Upsetting of a cylinder


class Upsetting:
    """Forces, and the billet at the start and at the end."""

    def __init__(self):
        self.forces, self.first, self.last = [], None, None

    def __call__(self, msh, *force):
        """Keep the billet; after a step also reduction, force on a die, closed form. Collective."""
        if msh.geometry.dim == 2:
            shape = cells(msh)
        else:
            x = msh.geometry.x
            shape = gather(msh.comm, x[boundary(msh, x)[0]])
        self.last = shape and shape[0]
        if force:
            self.forces.append(force)
        else:
            self.first = self.last

    def draw(self, filename):
        """Draw the billet, the force and its error; on rank 0."""
        if self.first is None:
            return
        figure = pyplot().figure(figsize=(12, 4.2), layout="constrained")
        grid = figure.add_gridspec(2, 3, width_ratios=(0.9, 0.9, 1.5), height_ratios=(1.6, 1))
        for i, (shape, title) in enumerate(((self.first, "before"), (self.last, "at the end"))):
            if shape.shape[-1] == 2:
                axis = figure.add_subplot(grid[:, i])
                draw_cells(axis, shape, facecolor=STEEL)
                axis.set(xlabel="r (-)", ylabel="z (-)" if i == 0 else None)
                axis.set(xlim=(0, 1.05 * self.last[..., 0].max()))
                axis.set(ylim=(-0.5, 1.05 * self.first[..., 1].max()))
            else:
                axis = figure.add_subplot(grid[:, i], projection="3d")
                reach, height = self.last[..., 0].max(), self.first[..., 2].max()
                set_view(axis, 20, 35, ((0, reach), (0, reach), (0, height)))
                draw_triangles(axis, shape, np.tile(STEEL, (len(shape), 1)))
            axis.set_title(title)
        self.draw_forces(figure.add_subplot(grid[0, 2]), figure.add_subplot(grid[1, 2]))
        save(figure, filename)

    def draw_forces(self, above, below):
        """Draw the force and the closed form, and the deviation."""
        reduction, force, exact = np.array(self.forces).T
        above.plot(100 * reduction, exact / exact[0], color="black", label="closed form")
        above.plot(100 * reduction, force / exact[0], "o", color="tab:orange", label="upper die")
        above.set(ylabel="force / first (-)")
        above.tick_params(labelbottom=False)
        above.legend()
        error = np.maximum(np.abs(force / exact - 1), 1e-16)
        below.semilogy(100 * reduction, error, ".-")
        decades = np.floor(np.log10(error.min())), np.ceil(np.log10(error.max()))
        below.set_ylim(*10.0 ** np.array(decades))
        below.set(xlabel="reduction of the height (%)", ylabel="rel. error (-)")
        for axis in (above, below):
            axis.set_xlim(0, None)
            axis.grid()


# --- Convergence of clamped upsetting


def upsetting_convergence(filename, result, ratios, norms):
    """Draw all errors over h, from the --json object for these ratios and norms; on rank 0."""
    if MPI.COMM_WORLD.rank > 0:
        return
    figure, axes = pyplot().subplots(
        3, 3, figsize=(10, 9.6), sharex=True, sharey="row", layout="constrained"
    )
    styles = dict(zip(FORMULATIONS, ("s-", "^-", "o-"), strict=True))
    for row, norm in zip(axes, norms, strict=True):
        for axis, formulation in zip(row, FORMULATIONS, strict=True):
            draw_errors(axis, result, ratios, f"{norm}_{formulation}", styles[formulation])
        what = "energy norm" if norm == "energy" else "traction of the " + norm.partition("_")[0]
        row[0].set_ylabel(f"relative error, {what} (-)")
        row[0].set_ylim(bottom=row[0].get_ylim()[0] / 12)  # room for the legends
    for axis, formulation in zip(axes[0], FORMULATIONS, strict=True):
        axis.set_title(formulation)
    for axis in axes[-1]:
        axis.set_xlabel("h of the coarser side / width (-)")
        low, high = axis.get_xlim()
        ticks = [t for t in (0.01, 0.02, 0.05, 0.1, 0.2, 0.5) if low <= t <= high]
        axis.set_xticks(ticks, [f"{t:g}" for t in ticks])
        axis.tick_params(which="minor", labelbottom=False)
    save(figure, filename)


def draw_errors(axis, result, ratios, key, style):
    """Draw one norm of one formulation, for all mesh ratios."""
    levels = range(result["levels"])
    colours = ("black", "tab:blue", "tab:cyan", "tab:green", "tab:red")
    for ratio, colour in zip(ratios, colours, strict=True):
        h = [result[f"h_{ratio}_{i}"] for i in levels]
        error = [result[f"error_{key}_{ratio}_{i}"] for i in levels]
        rate = round(result[f"rate_{key}_{ratio}"], 2) + 0.0  # no minus sign before 0
        axis.loglog(h, error, style, color=colour, label=f"{ratio}, rate {rate:.2f}")
    axis.legend(fontsize=7, loc="lower right", title="master:slave", title_fontsize=7)
    axis.grid(which="both")


# --- Fold


class Fold:
    """Collects the spring of the first mesh at some strokes and at first self-contact, and forces.

    Args:
        strokes: Strokes at which the spring is kept.
        half_distance: Half the initial distance of the planes.
    """

    def __init__(self, strokes, half_distance):
        self.strokes, self.half_distance = strokes, half_distance
        self.mesh, self.states, self.touched = None, [], False

    def __call__(self, row, scene):
        """Keep the spring, if it is to be drawn. Collective."""
        spring = scene[0]
        self.mesh = self.mesh or spring.mesh
        if spring.mesh is not self.mesh:
            return
        first = row.touching > 0 and not self.touched
        self.touched = self.touched or first
        if first or row.stroke in self.strokes:
            shape = cells(spring.mesh, node_values(spring.u), spring.fibre_stress())
            self.states.append((row, shape))

    def draw(self, filename, lines):
        """Draw the spring between the planes, and forces over strokes; on rank 0.

        Args:
            filename: Name of the picture file.
            lines: Table rows of each mesh, by the name of the mesh.
        """
        if self.states[0][1] is None:
            return
        figure = pyplot().figure(figsize=(12, 5.4), layout="constrained")
        left, right = figure.subfigures(1, 2, width_ratios=(1.7, 1))
        axes = left.subplots(-(-len(self.states) // 2), 2, sharex=True, sharey=True)
        largest = np.percentile(np.abs(self.states[-1][1][1]), 99)
        for axis, (row, shape) in zip(axes.flat, self.states, strict=False):
            colours = draw_cells(axis, *shape, cmap="RdBu_r", linewidth=0.15)
            colours.set_clim(-largest, largest)
            self.draw_planes(axis, row)
        for axis in axes[:, 0]:
            axis.set_ylabel("y / thickness (-)")
        for axis in axes[-1]:
            axis.set_xlabel("x / thickness (-)")
        label = "stress along the spring / E (-)"
        left.colorbar(colours, ax=axes, label=label, extend="both", pad=0.01, shrink=0.9)
        self.draw_forces(right.subplots(), lines)
        save(figure, filename)

    def draw_planes(self, axis, row):
        """Draw both planes, and a description of the state."""
        reach = self.half_distance + 0.7
        for side in (1, -1):
            y = side * (self.half_distance - row.stroke)
            axis.axhspan(*sorted((y, side * 2 * reach)), color="0.8", zorder=0)
            axis.axhline(y, color="black", lw=1)
        axis.set(xlim=(-3.6, 11.6), ylim=(-reach, reach))
        touching = f", touching on {row.touching:.1f}" if row.touching else ""
        axis.set_title(f"stroke {row.stroke:.2f}, force {row.force:.2g}{touching}")

    def draw_forces(self, axis, lines):
        """Draw the force over the stroke for each mesh, and mark the states that are drawn."""
        for (name, rows), style in zip(lines.items(), ("o-", "-"), strict=True):
            stroke, force = ([getattr(row, key) for row in rows[1:]] for key in ("stroke", "force"))
            axis.semilogy(stroke, force, style, ms=2.5, label=name)
        for row, _ in self.states:
            if row.force:
                axis.plot(row.stroke, row.force, "s", color="black", ms=6, mfc="none", mew=1)
        axis.set_title("force on a plane; squares: states on the left")
        axis.set(xlabel="stroke of a plane / thickness (-)", ylabel="force / (E thickness) (-)")
        axis.grid(which="both")
        axis.legend()
