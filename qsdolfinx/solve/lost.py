"""Detect bodies supported by contact alone that have lost contact during a solve.

Such a body is in equilibrium at any place: Newton's method ends there with a residual of zero.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.rounding import ROUNDING, SOLVED
from qsdolfinx.contact import active_set
from qsdolfinx.surface.unknowns import owned_vertices
from qsdolfinx.system.rigid_modes import displacement_space
from qsdolfinx.system.system import ContactSystem

Array = npt.NDArray[np.float64]

#: Number of translations by number of rigid modes. Translations come first; an axisymmetric body
#: has one mode.
_TRANSLATIONS = {1: 1, 3: 2, 6: 3}


def is_a_body_lost(system: ContactSystem, start: Array) -> bool:
    """Whether a body has moved further than everything it was in contact with. Collective.

    If it still touches something, the limit is the search radius, since contact detection does not
    search further. If it has lost all contact, the limit is one facet from its initial position: a
    body that tools release and that springs back moves less.

    Args:
        system: System at the solution.
        start: Unknowns at the start of the solve.
    """
    modes, motions = system.made.rigid.modes, system.made.rigid.free_motions
    if motions.shape[1] == 0:
        return False
    first = np.cumsum([0, *(len(of_body) for of_body in modes)])
    changes = system.parts(system.x.array_r - start)
    moved = [_moved(system, i, change) for i, change in enumerate(changes)]
    means, most = (np.array(each) for each in zip(*moved, strict=True))
    for i in range(len(changes)):
        free = np.abs(motions[first[i] : first[i + 1]]).max(initial=0.0) > SOLVED
        if free and _contacts(system, i) and not _is_tied(system, i):
            far = means[i] > _room(system, i, most)
            if far and _is_at_home_anywhere(system, i, changes[i]):
                return True
    return False


def _contacts(system: ContactSystem, i: int) -> list[int]:
    return [j for j, sides in enumerate(system.sides) if i in sides]


def _is_at_home_anywhere(system: ContactSystem, i: int, change: Array) -> bool:
    """Whether the body's own forces did not change: no springs hold it. Collective."""
    body, modes = system.bodies[i], system.made.rigid.modes[i]
    back, free = np.zeros_like(change), _free_translations(system, i)
    for direction in free.T:
        motion = sum(c * modes[k].array_r for k, c in enumerate(direction))
        back += motion * system.comm.allreduce(motion @ change, op=MPI.SUM)
    x = np.array(system.parts(system.x.array_r)[i])
    forces = body.residual(x - back)
    found = np.array([
        np.abs(each).max(initial=0.0) for each in (forces - body.residual(x), body.diagonal, back)
    ])  # fmt: skip
    system.comm.Allreduce(MPI.IN_PLACE, found, op=MPI.MAX)
    force, stiffness, size = found
    return bool(force <= ROUNDING * stiffness * size)


def _free_translations(system: ContactSystem, i: int) -> Array:
    """Translations of a body that conditions leave free, (translations, directions)."""
    rigid = system.made.rigid
    first, count = sum(len(of_body) for of_body in rigid.modes[:i]), len(rigid.modes[i])
    num = _TRANSLATIONS.get(count, 0)
    motions = rigid.free_motions[first : first + count]
    # Motions without a rotation.
    _, size, across = np.linalg.svd(motions[num:], full_matrices=True)
    turning = np.count_nonzero(size > SOLVED)
    directions, size, _ = np.linalg.svd(motions[:num] @ across[turning:].T, full_matrices=False)
    return np.asarray(directions[:, size > SOLVED])


def _room(system: ContactSystem, i: int, moved: Array) -> float:
    """How far a body may move: with the bodies that it touches, or about a facet without contact.

    Collective.
    """
    numbers = _contacts(system, i)
    contacts = [system.contacts[j] for j in numbers]
    closed = any([active_set.closed(c, gap).any() for c in contacts for gap in c.gaps])
    if not system.comm.allreduce(closed, op=MPI.LOR):
        return min(c.paired.facet_size for c in contacts)
    pushed = max(_moved_partner(system, j, i, moved) for j in numbers)
    return max(c.paired.search_radius for c in contacts) + pushed


def _is_tied(system: ContactSystem, i: int) -> bool:
    return any(system.contacts[j].law.linear for j in _contacts(system, i))


def _moved_partner(system: ContactSystem, j: int, i: int, moved: Array) -> float:
    """Displacement of the body or tool that a body touches; infinite for a rotated tool."""
    of_bodies = [float(moved[k]) for k in system.sides[j] if k not in (i, None)]
    of_tools = [
        np.inf if tool.rotation.any() else float(np.linalg.norm(tool.displacement))
        for tool in system.contacts[j].master.tools
    ]
    return max((*of_bodies, *of_tools), default=0.0)


def _moved(system: ContactSystem, i: int, change: Array) -> tuple[float, float]:
    """Size of the mean displacement of a body's vertices, and of the largest one. Collective."""
    V = displacement_space(system.bodies[i].V)
    if V is None or not _contacts(system, i):
        return 0.0, 0.0
    j = _contacts(system, i)[0]
    scale = system.contacts[j].kinematics.scale[system.sides[j].index(i)]
    u = scale * change[owned_vertices(V)[0]]
    total = system.comm.allreduce(np.append(u.sum(axis=0), len(u)), op=MPI.SUM)
    largest = np.max(np.linalg.norm(u, axis=1), initial=0.0)
    mean = np.linalg.norm(total[:-1]) / total[-1]
    return float(mean), float(system.comm.allreduce(largest, op=MPI.MAX))
