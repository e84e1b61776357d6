"""Compute traction and error of the job "hertz" for every program in the same way.

Forces on the nodes of a contact surface follow from the displacements, as internal forces f_k = ∫
σ(u) : ∇N_k with 2 × 2 × 2 points in each cell. The pressure is lumped, |f_k,z| / S_k with S_k = ∫
N_k dx dy: the force on a surface without friction is p times the area projected on the plane. For
the total force F, Hertz's solution has the radius a = (3 F R / 4 E*)^⅓ and the peak 3 F / 2 π a².
"""

import numpy as np
import sphere

#: Corners of a cell, and quadrature points, two in each direction.
CORNERS = np.array([(x, y, z) for z in (-1, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
POINTS = CORNERS / np.sqrt(3)


def internal_forces(body, u, modulus, nu):
    """Return the internal forces of the nodes, shape (nodes, 3); u has the same shape."""
    mu, lame = modulus / (2 * (1 + nu)), modulus * nu / ((1 + nu) * (1 - 2 * nu))
    x, u = body.x[body.cells], u[body.cells]
    local = np.zeros_like(x)
    for point in POINTS:
        factors = 1 + CORNERS * point
        slope = np.stack(
            [CORNERS[:, i] * np.delete(factors, i, axis=1).prod(axis=1) / 8 for i in range(3)], 1
        )
        jacobian = np.einsum("cki,kj->cij", x, slope)
        gradient = slope @ np.linalg.inv(jacobian)
        du = np.einsum("cki,ckj->cij", u, gradient)
        stress = mu * (du + du.transpose(0, 2, 1))
        stress += lame * np.trace(du, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        volume = np.linalg.det(jacobian)[:, None, None]
        local += volume * np.einsum("cij,ckj->cki", stress, gradient)
    return gather(body.cells, local, len(body.x))


def gather(cells, local, count):
    """Sum over cells at each of `count` nodes."""
    flat = local.reshape(cells.size, -1).T
    return np.column_stack([np.bincount(cells.ravel(), part, count) for part in flat])


def areas(x, quads):
    """Return S_k of all nodes."""
    flat = x[quads][:, :, :2]
    local = np.zeros(quads.shape)
    for point in POINTS[:4, :2]:
        factors = 1 + CORNERS[:4, :2] * point
        slope = CORNERS[:4, :2] * factors[:, ::-1] / 4
        area = np.abs(np.linalg.det(np.einsum("cki,kj->cij", flat, slope)))
        local += area[:, None] * factors.prod(axis=1) / 4
    return gather(quads, local, len(x))[:, 0]


def hertz(force):
    """Return the radius of the contact and the peak pressure for a total force."""
    a = (3 * force * sphere.R / (4 * sphere.E_STAR)) ** (1 / 3)
    return a, 3 * force / (2 * np.pi * a**2)


def hertz_forces(x, quads, force, parts=24):
    """Return nodal forces of Hertz's pressure on a quarter, F_k = ∫ N_k p dx dy.

    Args:
        x: Coordinates of the nodes.
        quads: Nodes of the surface's faces; their projections are rectangles along the axes.
        force: Force on the whole contact.
        parts: Number of points of the midpoint rule in each direction of a face.
    """
    a, p0 = hertz(force)
    s = (np.arange(parts) + 0.5) * 2 / parts - 1
    points = np.stack(np.meshgrid(s, s), axis=-1).reshape(-1, 2)
    shapes = (1 + points[:, None] * CORNERS[:4, :2]).prod(axis=2) / 4
    flat = x[quads][:, :, :2]
    flat, quads = (array[np.linalg.norm(flat, axis=2).min(axis=1) < a] for array in (flat, quads))
    # The order of the corners is arbitrary, so each face has its own shape functions.
    low, size = flat.min(axis=1), np.ptp(flat, axis=1)
    corner = np.sign(flat - (low + size / 2)[:, None])
    which = np.argmax((corner[:, :, None] == CORNERS[:4, :2]).all(axis=3), axis=2)
    r2 = np.sum((low[:, None] + size[:, None] * (1 + points) / 2) ** 2, axis=2)
    pressure = p0 * np.sqrt(np.maximum(1 - r2 / a**2, 0))
    local = (pressure @ shapes) * size.prod(axis=1)[:, None] / parts**2
    return gather(quads, np.take_along_axis(local, which, axis=1), len(x))[:, 0]


def relative_errors(x, quads, forces, total):
    """Return relative L2 errors of the pressure on a surface, of a quarter.

    With p_k = f_k / S_k, both are (Σ S_k (p_k − q_k)² / Σ S_k q_k²)^½. In the first, q_k = F_k /
    S_k is Hertz's pressure lumped in the same way, so that Hertz's own forces have no error; in the
    second, q_k = p(x_k), for which these forces have an error.

    Args:
        x: Coordinates of the nodes.
        quads: Nodes of the surface's faces.
        forces: Contact forces on the nodes, vertical components.
        total: Force on the whole contact, which defines Hertz's solution.
    """
    nodes = np.unique(quads)
    area = areas(x, quads)[nodes]
    a, p0 = hertz(total)
    at_nodes = p0 * np.sqrt(np.maximum(1 - np.sum(x[nodes, :2] ** 2, axis=1) / a**2, 0))
    lumped = hertz_forces(x, quads, total)[nodes] / area
    errors = [(area * (forces[nodes] / area - q) ** 2, area * q**2) for q in (lumped, at_nodes)]
    return [float(np.sqrt(error.sum() / exact.sum())) for error, exact in errors]


def unbalanced(body, forces):
    """Return the norm of forces on nodes without conditions and contact: zero in equilibrium."""
    free = np.ones(forces.shape, dtype=bool)
    free[np.unique(body.low)] = free[np.unique(body.high)] = False
    for axis, quads in body.planes.items():
        free[np.unique(quads), axis] = False
    return float(np.linalg.norm(forces[free]))


def check_conditions(bodies, parts):
    """Check that held nodes are where they should be, to the digits that CalculiX prints.

    Raises:
        ValueError: If a held node is elsewhere, or if displacements are not numbers.
    """
    press = abs(sphere.PRESS)
    off = [0.0]
    for i, (body, u) in enumerate(zip(bodies, parts, strict=True)):
        held = np.unique(body.high if i else body.low)
        off.append(np.abs(u[held] - [0, 0, i * sphere.PRESS]).max())
        off += [np.abs(u[np.unique(quads), k]).max() for k, quads in body.planes.items()]
    if not max(off) <= 1e-5 * press or not all(np.isfinite(u).all() for u in parts):
        raise ValueError(f"boundary conditions are off by {max(off):.2g}")


def measure(sizes, u, loads=None, tractions=None):
    """Return a row of results for the whole, as if there were four quarters.

    Args:
        sizes: Numbers of cells along an edge of the lower and the upper body.
        u: Displacements of all nodes, shape (nodes, 3).
        loads: Nodal forces of the program's contact, if they extend beyond the surfaces, shape
            (nodes, 3).
        tractions: Nodal forces of the program's contact tractions, if they differ from the internal
            forces, shape (nodes, 3).

    Returns:
        The force, its Hertz radius, and for each body the two errors of the pressure and the
        unbalanced forces inside it, over the force.

    Raises:
        ValueError: If the displacements are not those of the job.
    """
    bodies = sphere.bodies(sizes)
    first = [len(bodies[0].x)]
    parts = np.split(u, first)
    check_conditions(bodies, parts)
    inside = [
        internal_forces(body, part, modulus, sphere.NU)
        for body, part, modulus in zip(bodies, parts, sphere.E, strict=True)
    ]
    forces = inside if tractions is None else np.split(tractions, first)
    rest = inside if loads is None else [f - g for f, g in zip(inside, np.split(loads, first))]
    surfaces = bodies[0].high, bodies[1].low
    total = -4 * forces[0][np.unique(surfaces[0]), 2].sum()
    if not total > 0:
        raise ValueError("no contact force")
    out = {"total": float(total), "radius": float(hertz(total)[0])}
    names = zip(("lower", "upper"), bodies, forces, rest, surfaces, (-1, 1), strict=True)
    for name, body, f, left, quads, sign in names:
        errors = relative_errors(body.x, quads, sign * f[:, 2], total)
        out[f"l2_{name}"], out[f"l2_nodes_{name}"] = errors
        out[f"unbalanced_{name}"] = 4 * unbalanced(body, left) / total
    return out
