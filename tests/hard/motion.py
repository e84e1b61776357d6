"""Case 9: sliding over many facets, closed surfaces, and rotated frames."""

import math

import numpy as np
from fuzz.bodies import Shape, make_mesh
from hard.bodies import NU, Body, iterations, lattice, problem, solve
from hard.cases import SHORT, Case
from scenes import WORLD, largest

from dolfinx import fem, mesh

import qsdolfinx as qs

FACETS = 50
#: Reason for differences of the force after each facet.
BESIDE = "Small; probably due to the choice of the facet when a node slides over a vertex."


def slide(variant, facets=FACETS):
    """Drag a block over 50 facets of a slab, without friction.

    After each whole facet the two meshes have the same relative position as before. The slab is
    held so close to its surface that its ends, ten thicknesses away, have no influence: the force
    must stay the same.
    """
    h = 0.25
    slab = Body(lattice("quadrilateral", np.arange(-40, facets + 44) * h, np.linspace(-1, 0, 3)))
    block = Body(lattice("quadrilateral", np.linspace(0.1, 0.9, 5), np.linspace(0, 0.5, 3)))
    slab.hold(slab.facets(1, -1.0))
    top = block.hold(block.facets(1, 0.5))
    surfaces = block.surface(1, 0.0), slab.surface(1, 0.0)
    contact = qs.Contact(*surfaces, penalty=20.0, **variant.options)
    p = problem((slab, block), [contact])

    def drive(t, dt):
        top.value[:] = [h * max(t - 2, 0.0), -0.01]

    stepper, forces = qs.TimeStepper(p, 1.0, drive, num_pairings=2), []
    for _ in range(facets + 2):
        stepper.step()
        iterations.append(stepper.num_iterations)
        forces.append(contact.force("slave")[1])
    p.destroy()
    forces = np.array(forces)[3:]  # steady from here on
    return np.ptp(forces) / abs(forces.mean())


# --- Rings


def ring(inner, outer, n, layers, turned=0.0):
    """Make a ring of quadrilaterals, n around."""
    angle = turned + 2 * math.pi * np.arange(n) / n
    radius = np.linspace(inner, outer, layers + 1)
    x = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)[None]
    i, j = (a.ravel() for a in np.meshgrid(np.arange(layers), np.arange(n), indexing="ij"))
    k = (j + 1) % n
    cells = np.stack([i * n + j, (i + 1) * n + j, i * n + k, (i + 1) * n + k], axis=1)
    return Body(make_mesh(WORLD, Shape(x.reshape(-1, 2), cells, "quadrilateral"), n))


def circle(body, radius):
    """Return the facets on a circle, whose nodes are on it up to rounding."""
    on = lambda x: np.abs(np.hypot(x[0], x[1]) - radius) < 1e-9  # noqa: E731
    return mesh.locate_entities_boundary(body.mesh, 1, on)


def lame(a, b, c, widening):
    """Pressure between two rings in plane strain, the inner widened at a, the outer fixed at c.

    In each ring u_r = A r + B / r.
    """
    mu, lmbda = 1 / 2 / (1 + NU), NU / (1 + NU) / (1 - 2 * NU)
    k, g = 2 * (lmbda + mu), 2 * mu  # σ_r = k A − g B / r²
    rows = [
        [a, 1 / a, 0, 0],
        [b, 1 / b, -b, -1 / b],
        [k, -g / b**2, -k, g / b**2],
        [0, 0, c, 1 / c],
    ]
    A, B, _, _ = np.linalg.solve(rows, [widening, 0, 0, 0])
    return -(k * A - g * B / b**2)


def rings(variant, what):
    """A ring in a ring, closed non-matching surfaces, pressed together by widening the bore."""
    a, b, c, widening = 0.5, 1.0, 1.5, 0.02
    inner, outer = ring(a, b, 64, 8), ring(b, c, 80, 8, turned=0.01)
    penalty = {} if variant.augmented else {"penalty": 1e3}
    surfaces = [qs.Surface(body.V, facets=circle(body, b)) for body in (inner, outer)]
    contact = qs.Contact(*surfaces, search_radius=0.2, **variant.options | penalty)
    outer.hold(circle(outer, c))
    shift = inner.hold(circle(inner, a), fem.Function(inner.V))
    shift.interpolate(lambda x: widening * x[:2] / np.hypot(x[0], x[1]).clip(a / 2))
    p = problem((outer, inner), [contact])
    solve(p)
    surface = contact.slave
    t, x = surface.node_values(contact.traction("slave")), surface.node_x[:, :2]
    outward = x / np.linalg.norm(x, axis=1, keepdims=True)
    size = WORLD.allreduce(float(surface.node_area.sum()))
    pressure = WORLD.allreduce(float(-np.sum(t * outward, axis=1) @ surface.node_area)) / size
    net = np.abs(contact.force("slave")).max(), np.abs(contact.moment("slave")).max()
    p.destroy()
    if what == "pressure":
        return abs(pressure / lame(a, b, c, widening) - 1)
    return max(net) / (pressure * size)


# --- Frames


def axis_rotation(gdim, degrees=30.0):
    """Return a rotation in the plane, or about an axis that is not an axis of the frame."""
    angle = math.radians(degrees)
    if gdim == 2:
        return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    n = np.array([1.0, 2.0, -0.5]) / math.sqrt(5.25)
    skew = np.array([[0, -n[2], n[1]], [n[2], 0, -n[0]], [-n[1], n[0], 0]])
    return np.eye(3) + math.sin(angle) * skew + (1 - math.cos(angle)) * skew @ skew


def punch(variant, cell, R):
    """Return displacements and force of a curved punch on a block, in the unrotated frame."""
    gdim = len(R)
    up = gdim - 1
    n, m = ((17, 10), (3, 2)) if gdim == 2 else ((7, 5), (2, 2))
    lower = Body(lattice(cell, *[np.linspace(-1, 1, n[0])] * up, np.linspace(-1, 0, m[0] + 1)))
    upper = Body(lattice(cell, *[np.linspace(-0.6, 0.63, n[1])] * up, np.linspace(0, 1, m[1] + 1)))
    lower.hold(lower.facets(up, -1.0))
    press = np.zeros(gdim)
    press[0], press[-1] = 0.02, -0.1
    upper.hold(upper.facets(up, 1.0), R @ press)
    faces = [body.facets(up, 0.0) for body in (upper, lower)]
    x = upper.mesh.geometry.x
    curve = 0.15 * np.sum((x[:, :up] - 0.03) ** 2, axis=1) + 0.02 * np.sin(7 * x[:, 0] + 1)
    x[:, up] += (1 - x[:, up]) * curve
    for body in (upper, lower):
        x = body.mesh.geometry.x
        x[:, :gdim] = x[:, :gdim] @ R.T
    surfaces = [qs.Surface(b.V, facets=f) for b, f in zip((upper, lower), faces, strict=True)]
    contact = qs.Contact(*surfaces, search_radius=0.7, penalty=30.0, **variant.options)
    p = problem((lower, upper), [contact])
    solve(p)
    back = [b.u.x.array.reshape(-1, gdim) @ R for b in (lower, upper)]
    force = contact.force("slave") @ R
    p.destroy()
    return back, force


def rotated(variant, cell):
    """The punch in two frames must have the same displacements and force."""
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    a, force = punch(variant, cell, np.eye(gdim))
    b, other = punch(variant, cell, axis_rotation(gdim))
    moved = largest(*(x - y for x, y in zip(a, b, strict=True))) / largest(*a)
    return max(moved, largest(force - other) / largest(force))


def cases(variant):
    name, some = "9 motion", variant in SHORT[:2]
    run = lambda: slide(variant)  # noqa: E731
    known = BESIDE if variant[:2] == ("master-slave", "nodal") else ""
    yield Case(name, f"sliding over {FACETS} facets", "force", 1e-6, run, known=known)
    for label, what, allowed, of in (
        ("ring in ring, against Lamé", "mean pressure", 0.05, "pressure"),
        ("ring in ring", "net force and moment", 1e-3, "net"),
    ):
        yield Case(name, label, what, allowed, lambda of=of: rings(variant, of), some)
    for cell in ("triangle", "quadrilateral", "tetrahedron", "hexahedron"):
        label, what = f"both bodies turned by 30°, {cell}", "displacements, force"
        run = lambda cell=cell: rotated(variant, cell)  # noqa: E731
        yield Case(name, label, what, 1e-10, run, some and cell in ("quadrilateral", "hexahedron"))
