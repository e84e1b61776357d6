"""Case 9: sliding over many facets, closed surfaces, and rotated frames."""

import math

import numpy as np
from fuzz.bodies import Shape, make_mesh
from hard.kit import Body, lattice, problem
from hard.scenes import COMM, NU, Check, largest, solve

from dolfinx import fem

import qsdolfinx as qs

FACETS = 50


def slide(kind):
    """A block is dragged over 50 facets of a slab, without friction.

    After each whole facet the two meshes lie on each other as before. The slab is held so near to
    its surface that its ends, ten thicknesses away, are not felt: the force stays the same.
    """
    h = 0.25
    slab = Body(lattice("quadrilateral", np.arange(-40, FACETS + 44) * h, np.linspace(-1, 0, 3)))
    block = Body(lattice("quadrilateral", np.linspace(0.1, 0.9, 5), np.linspace(0, 0.5, 3)))
    slab.hold(slab.at(1, -1.0))
    top = block.hold(block.at(1, 0.5))
    surfaces = [qs.Surface(b.V, facets=b.at(1, 0.0)) for b in (block, slab)]
    contact = qs.Contact(*surfaces, penalty=20.0, **kind._asdict())
    p = problem((slab, block), [contact])

    def drive(t, dt):
        top.value[:] = [h * max(t - 2, 0.0), -0.01]

    stepper = qs.TimeStepper(p, 1.0, drive, num_pairings=2)
    forces, iterations = [], 0
    for _ in range(FACETS + 2):
        stepper.step()
        iterations = max(iterations, stepper.num_iterations)
        forces.append(contact.force("slave"))
    p.destroy()
    forces = np.array(forces)[3:, 1]  # steady since then
    return np.ptp(forces) / abs(forces.mean()), iterations


# --- Rings


def ring(inner, outer, n, layers, turned=0.0):
    """A ring of quadrilaterals, n around."""
    angle = turned + 2 * math.pi * np.arange(n) / n
    radius = np.linspace(inner, outer, layers + 1)
    x = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)[None]
    i, j = (a.ravel() for a in np.meshgrid(np.arange(layers), np.arange(n), indexing="ij"))
    k = (j + 1) % n
    cells = np.stack([i * n + j, (i + 1) * n + j, i * n + k, (i + 1) * n + k], axis=1)
    return Body(make_mesh(COMM, Shape(x.reshape(-1, 2), cells, "quadrilateral"), n))


def around(radius):
    """Selects a circle, whose nodes facets do not leave by more than rounding."""
    return lambda x: np.abs(np.hypot(x[0], x[1]) - radius) < 1e-9


def lame(a, b, c, widening):
    """Pressure between two rings in plane strain, the inner widened at a, the outer held at c.

    u_r = A r + B / r in each.
    """
    mu, lmbda = 1 / 2 / (1 + NU), NU / (1 + NU) / (1 - 2 * NU)
    k, g = 2 * (lmbda + mu), 2 * mu  # σ_r = k A − g B / r²
    rows_ = [
        [a, 1 / a, 0, 0],
        [b, 1 / b, -b, -1 / b],
        [k, -g / b**2, -k, g / b**2],
        [0, 0, c, 1 / c],
    ]
    A, B, _, _ = np.linalg.solve(rows_, [widening, 0, 0, 0])
    return -(k * A - g * B / b**2)


def rings(kind, what):
    """A ring in a ring, closed surfaces that do not match, pressed together by its bore."""
    a, b, c, widening = 0.5, 1.0, 1.5, 0.02
    inner, outer = ring(a, b, 64, 8), ring(b, c, 80, 8, turned=0.01)
    contact = qs.Contact(
        *(qs.Surface(body.V, facets=body.facets(around(b))) for body in (inner, outer)),
        search_radius=0.2,
        **kind._asdict() | ({"penalty": 1e3} if kind.enforcement == "penalty" else {}),
    )
    outer.hold(outer.facets(around(c)))
    shift = fem.Function(inner.V)
    shift.interpolate(lambda x: widening * x[:2] / np.hypot(x[0], x[1]).clip(a / 2))
    facets = inner.facets(around(a))
    dofs = fem.locate_dofs_topological(inner.V, 1, facets)
    inner.bcs.append(fem.dirichletbc(shift, dofs))
    p = problem((outer, inner), [contact])
    iterations = solve(p)
    surface = contact.slave
    t = surface.node_values(contact.traction("slave"))
    x = surface.node_x[:, :2]
    outward = x / np.linalg.norm(x, axis=1, keepdims=True)
    size = COMM.allreduce(float(surface.node_area.sum()))
    pressure = COMM.allreduce(float(-np.sum(t * outward, axis=1) @ surface.node_area)) / size
    net = np.abs(contact.force("slave")).max(), np.abs(contact.moment("slave")).max()
    p.destroy()
    if what == "pressure":
        return abs(pressure / lame(a, b, c, widening) - 1), iterations
    return max(net) / (pressure * size), iterations


# --- Frames


def axis_rotation(gdim, degrees=30.0):
    """Rotation in the plane, or about an axis that is none of the frame's."""
    angle = math.radians(degrees)
    if gdim == 2:
        return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    n = np.array([1.0, 2.0, -0.5]) / math.sqrt(5.25)
    skew = np.array([[0, -n[2], n[1]], [n[2], 0, -n[0]], [-n[1], n[0], 0]])
    return np.eye(3) + math.sin(angle) * skew + (1 - math.cos(angle)) * skew @ skew


def punch(kind, cell, R):
    """Displacements and force of a curved punch on a block, in the frame before the rotation."""
    gdim = len(R)
    n, m = ((17, 10), (3, 2)) if gdim == 2 else ((7, 5), (2, 2))
    across = gdim - 1
    lower = Body(lattice(cell, *[np.linspace(-1, 1, n[0])] * across, np.linspace(-1, 0, m[0] + 1)))
    upper = Body(
        lattice(cell, *[np.linspace(-0.6, 0.63, n[1])] * across, np.linspace(0, 1, m[1] + 1))
    )
    lower.hold(lower.at(across, -1.0))
    press = np.zeros(gdim)
    press[0], press[-1] = 0.02, -0.1
    upper.hold(upper.at(across, 1.0), R @ press)
    faces = [body.at(across, 0.0) for body in (upper, lower)]
    x = upper.mesh.geometry.x
    x[:, across] += (1 - x[:, across]) * (
        0.15 * np.sum((x[:, :across] - 0.03) ** 2, axis=1) + 0.02 * np.sin(7 * x[:, 0] + 1)
    )
    for body in (upper, lower):
        x = body.mesh.geometry.x
        x[:, :gdim] = x[:, :gdim] @ R.T
    surfaces = [qs.Surface(b.V, facets=f) for b, f in zip((upper, lower), faces, strict=True)]
    contact = qs.Contact(*surfaces, search_radius=0.7, penalty=30.0, **kind._asdict())
    p = problem((lower, upper), [contact])
    iterations = solve(p)
    back = [b.u.x.array.reshape(-1, gdim) @ R for b in (lower, upper)]
    forces = [contact.force("slave") @ R]
    p.destroy()
    return back, forces, iterations


def rotated(kind, cell):
    """The punch in two frames: the same displacements and force."""
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    first = punch(kind, cell, np.eye(gdim))
    second = punch(kind, cell, axis_rotation(gdim))
    error = 0.0
    for a, b in zip(first[:2], second[:2], strict=True):
        error = max(error, largest(*(x - y for x, y in zip(a, b, strict=True))) / largest(*a))
    return error, max(first[2], second[2])


def checks(kind):
    """Case 9."""
    yield Check("9 motion", f"sliding over {FACETS} facets", "force", 1e-6, lambda: slide(kind))
    run = lambda what: lambda: rings(kind, what)  # noqa: E731
    yield Check("9 motion", "ring in ring, against Lamé", "mean pressure", 0.05, run("pressure"))
    yield Check("9 motion", "ring in ring", "net force and moment", 1e-3, run("net"))
    for cell in ("triangle", "quadrilateral", "tetrahedron", "hexahedron"):
        yield Check(
            "9 motion",
            f"both bodies turned by 30°, {cell}",
            "displacements, force",
            1e-10,
            lambda c=cell: rotated(kind, c),
        )
