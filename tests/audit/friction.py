"""Audit Coulomb's law over a step: slip is opposite to friction, and sticking nodes do not move."""

import dataclasses

import numpy as np

#: Fraction of μ N below which a node sticks for certain.
STICKS = 0.9


@dataclasses.dataclass
class Memory:
    """State at the slave's vertices after a step.

    Attributes:
        jump: Displacement relative to the opposite surface, shape (vertices, 3).
        friction: Tangential force, shape (vertices, 3).
        pushed: Normal force, positive if it pushes.
    """

    jump: np.ndarray
    friction: np.ndarray
    pushed: np.ndarray


def read_memory(sides):
    """Return the state at the end of a step."""
    side = sides[0]
    n = side.num_vertices
    return Memory(side.jump[:n], side.tangential, -side.pull)


def faults(joint, sides, before, now, tolerance, angle=0.0):
    """Return check, excess and text of each fault in the direction of friction on the slave.

    The slip of a step is the relative motion without the elastic stick of a penalty. Gaps and slips
    are means over a node's facets, so that they are known only up to their variation over these
    facets. A node that comes into contact in the step slips from then on.

    Args:
        joint: The contact.
        sides: Sides of the contact, slave first.
        before: State after the previous step.
        now: State after this step.
        tolerance: Largest force that counts as zero.
        angle: Angle of rotation of tangent planes, and of the friction in them, between the two
            states (radians).
    """
    side = sides[0]
    if before is None:
        before = Memory(0 * now.jump, 0 * now.friction, 0 * now.pushed)
    moved = now.jump - before.jump
    moved = moved - np.sum(moved * side.normal, axis=1, keepdims=True) * side.normal
    turned = 0.0
    if joint.penalty and not joint.viscous:
        change = now.friction - before.friction
        moved = moved + change / (joint.penalty * side.area)[:, None]
        # Elastic deformation of the penalty, normal and tangential, rotates with the bodies.
        force = np.hypot(np.linalg.norm(before.friction, axis=1), before.pushed)
        turned = angle * force / (joint.penalty * side.area)
    x = side.points[: side.num_vertices]
    # Nodes that are covered in part have means over the covered part, and a separate stiffness.
    patch = np.linalg.norm(x[:, None] - side.points, axis=2) <= side.size
    facing = np.all(side.rest.facing | ~patch, axis=1)
    reach = 0.0 if joint.node_by_node else 2 * sum(s.size for s in sides)
    near = np.linalg.norm(x[:, None] - x, axis=2) <= reach
    apart = np.linalg.norm(moved[:, None] - moved, axis=2)
    spread = np.where(near, apart, 0.0).max(axis=1)
    # Error of the means over surfaces at a distance whose normals are not parallel.
    spread = spread + side.turn * np.linalg.norm(now.jump - before.jump, axis=1)
    spread = spread + turned + 1e-6 * np.abs(now.jump).max(initial=0.0)
    closing = near_closing(side, before, now, near, tolerance)
    held = np.any(side.held[:, : side.gdim], axis=1)
    free = side.normal_free & ~held & facing & ~closing
    tilt = side.tilt_at_rest * now.pushed
    big = np.linalg.norm(now.friction, axis=1) > 1e3 * tolerance
    load = now.pushed > 1e4 * tolerance
    size, limit = np.linalg.norm(now.friction, axis=1), joint.friction_limit(side.area, now.pushed)
    slip = np.linalg.norm(moved, axis=1)
    out = []
    moves = slip > 1e-6 * side.size
    # Friction at a vertex may be the normal force of an adjacent facet.
    slipping = free & big & load & (size > 1.2 * tilt) & moves & (slip > 3 * spread)
    work = np.sum(now.friction * moved, axis=1)
    wrong = slipping & (work > -0.5 * size * slip)
    if np.any(wrong):
        worst = np.max((work / (size * slip))[wrong])
        out.append(("direction", 1 + float(worst), f"{wrong.sum()} nodes slip along friction"))
    below = size + tilt < STICKS * limit
    # Tresca's friction acts where neighbours press, and is lost where it does not stop a node.
    below = below & load & big if joint.shear else below | ~load
    sticking = free & load & np.all(below | ~near, axis=1) & below & (not joint.viscous)
    wrong = sticking & moves & (slip > 2 * spread)
    if np.any(wrong):
        excess = float(np.max((slip / np.maximum(spread, 1e-300))[wrong]))
        out.append(("stick", excess, f"{wrong.sum()} nodes move below the limit"))
    return out


def near_closing(side, before, now, near, tolerance):
    """Return vertices near a new contact: in this step, their slip began only at contact onset."""
    n = side.num_vertices
    gap = side.rest.distance[:n] - np.sum(before.jump * side.normal, axis=1)
    was_open = (before.pushed <= 1e4 * tolerance) & (gap > 1e-6 * side.size)
    return np.any(near & was_open & (now.pushed > tolerance), axis=1)


def energy(joint, sides, before, now, tolerance, means=False):
    """Return check, excess and text of each fault in the frictional energy of a step.

    The energy is the work Σ F · Δx of the tangential forces. For displacement-based bodies, F is
    between the forces at the start and at the end of the step. Slips are means over a node's
    facets, so that the energy is known up to their variation there. For nodes that conditions hold,
    or that come into contact or separate in the step, only an upper bound is known: the largest
    force over the whole path. Forces of velocity-based bodies are means over the step (``means``).
    They also act on the path before nodes come into contact, which may have the opposite direction.
    """
    side = sides[0]
    moved = now.jump - before.jump
    moved = moved - np.sum(moved * side.normal, axis=1, keepdims=True) * side.normal
    x = side.points[: side.num_vertices]
    near = np.linalg.norm(x[:, None] - x, axis=2) <= 2 * sum(s.size for s in sides)
    way = np.linalg.norm(moved, axis=1)
    spread = np.where(near, np.linalg.norm(moved[:, None] - moved, axis=2), 0.0).max(axis=1)
    at_end, at_start = (np.linalg.norm(m.friction, axis=1) for m in (now, before))
    elastic = 0.0
    if joint.penalty:
        elastic = np.linalg.norm(now.friction - before.friction, axis=1)
        elastic = elastic / (joint.penalty * side.area)
    reach = way + 2 * spread + elastic + 1e-6 * np.abs(now.jump).max(initial=0.0)
    force = np.where(near, np.maximum(at_end, at_start), 0.0).max(axis=1)
    most = float(np.sum((force + tolerance) * reach))
    taken = joint.dissipated()
    out = []
    if taken > 1.01 * most:
        out.append(("energy", taken / most, f"friction took {taken:.3g}, at most {most:.3g}"))
    held = np.any(side.held[:, : side.gdim], axis=1)
    slips = at_end > 0.999 * joint.friction_limit(side.area, now.pushed)
    sure = slips & (at_start > 0) & ~held & (now.pushed > 1e4 * tolerance)
    limit = joint.friction_limit(side.area, np.minimum(now.pushed, before.pushed))
    # Without the normal force of adjacent facets, which may contribute as much when pushed.
    least = np.minimum(np.minimum(at_end, at_start), limit) - side.tilt_at_rest * now.pushed
    least = np.where(sure, np.maximum(least, 0.0) * (way - 2 * spread - elastic), 0.0)
    least = float(np.sum(np.maximum(least, 0.0)))
    rounding = most if means and least == 0 else 1e-9 * most
    if taken < 0.99 * least - rounding:
        out.append(("energy", least / max(taken, 1e-300), f"{taken:.3g}, at least {least:.3g}"))
    return out


def held_faults(joint, sides, reading, area, before, tolerance):
    """Return check, excess and text of wrong friction at slave nodes with Dirichlet conditions.

    There, the bodies' own forces include reactions, so that friction is taken from the library.
    That its traction is the complete force is checked at the other nodes.

    Args:
        joint: The contact, with Coulomb's friction.
        sides: Sides of the contact, slave first.
        reading: Results of the library on the slave.
        area: Areas of its vertices for the tractions.
        before: State after the previous step.
        tolerance: Largest force that counts as zero.
    """
    side = sides[0]
    now = read_memory(sides)
    if before is None:
        before = Memory(0 * now.jump, 0 * now.friction, 0 * now.pushed)
    x = side.points[: side.num_vertices]
    held = np.any(side.held[:, : side.gdim], axis=1) & side.normal_free
    held &= side.rest.facing[: side.num_vertices]
    force = reading.tangential * area[:, None]
    pushed = -np.sum(reading.normal * side.normal, axis=1) * area
    moved = now.jump - before.jump
    moved = moved - np.sum(moved * side.normal, axis=1, keepdims=True) * side.normal
    near = np.linalg.norm(x[:, None] - x, axis=2) <= 2 * sum(s.size for s in sides)
    spread = np.where(near, np.linalg.norm(moved[:, None] - moved, axis=2), 0.0).max(axis=1)
    limit = joint.friction_limit(side.area, pushed)
    elastic = 2 * limit / (joint.penalty * side.area) if joint.penalty else 0.0
    way, size = np.linalg.norm(moved, axis=1), np.linalg.norm(force, axis=1)
    tilt = side.tilt_at_rest * np.abs(pushed)
    sure = held & (pushed > 1e4 * tolerance) & (way > 3 * spread + elastic + 1e-6 * side.size)
    sure &= ~near_closing(side, before, now, near, tolerance)
    along = np.sum(force * moved, axis=1) > -0.5 * size * way
    # Limits at quadrature points, and at nodes of the other side, come from pressures nearby.
    alone = joint.node_by_node or (joint.formulation == "master-slave" and not joint.at_points)
    little = (size < STICKS * limit - tilt) if alone else size < 1e3 * tolerance
    wrong = sure & (along | little)
    out = []
    if np.any(wrong):
        out.append(("held", 2.0, f"{wrong.sum()} nodes that are moved slip without their friction"))
    # A component that has never moved has no friction of its own: a plane of symmetry.
    rests = np.abs(now.jump).max(axis=1) <= 1e-9 * side.size
    fixed = np.where(side.held & rests[:, None] & held[:, None], np.abs(force), 0.0)
    fixed[:, side.gdim :] = 0.0
    excess = fixed.max(initial=0.0) / (1e3 * tolerance)
    if excess > 1 and joint.node_by_node:
        out.append(("held", float(excess), "friction at nodes that do not move"))
    return out
