"""Strain-free adjustment of overclosure during sliding, and a warning where it is wrong."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.rounding import SINGLE, SOLVED
from qsdolfinx.contact.findings import tell
from qsdolfinx.contact.model import ContactModel, OverclosedStart, Paired
from qsdolfinx.contact.slid import NEARBY
from qsdolfinx.surface.facets import area_vectors
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface, is_shape

Array = npt.NDArray[np.float64]

#: Height range of the master over the depth range of the overclosure below which it is flat. With
#: less, rounding decides; with more, depths that are wrong by this part get no warning.
FLAT = 0.1


def read(model: ContactModel, paired: Paired) -> None:
    """Determine the overclosure at the first contact detection. Collective.

    Raises:
        ValueError: If there is overclosure, and it is to be refused.
    """
    overclosure = model.overclosure
    seen = _seen(model)
    overclosure.read(paired.gaps, seen, paired.facet_size)
    overclosure.follow(paired.gaps, seen)  # for sliding before pairs are updated
    overclosure.apply(paired.gaps)
    if overclosure.depth > SINGLE * paired.facet_size:
        nodes = overclosure.deep_nodes
        model.overclosed_from = OverclosedStart(
            nodes, seen[0][nodes], model.slave.node_normal[nodes]
        )


def follow(model: ContactModel, paired: Paired) -> None:
    """Set the allowed overclosure of updated contact pairs. Collective."""
    model.overclosure.follow(paired.gaps, _seen(model))
    model.overclosure.apply(paired.gaps)


def follow_bodies(model: ContactModel) -> bool:
    """Set the allowed overclosure at the last evaluation, for finite sliding. Collective.

    The contact pairs are not updated.

    Returns:
        Whether the allowed overclosure has changed at any node.
    """
    if not (model.follows and model.overclosure.allowed > 0):
        return False
    before = [gap.state.allowance for gap in model.gaps]
    follow(model, model.paired)
    pairs = zip(model.gaps, before, strict=True)
    changed = any(not np.array_equal(gap.state.allowance, known) for gap, known in pairs)
    return bool(model.comm.allreduce(changed, op=MPI.LOR))


def check_sliding(model: ContactModel) -> None:
    """Warn about adjusted overclosure if the bodies have slid since. Collective.

    Each depth belongs to a slave node. If depths differ between nodes, this is right as long as the
    master is flat: depths caused by the shape of the master would have to move with the master. The
    warning is given once for each contact.
    """
    overclosure, start = model.overclosure, model.overclosed_from
    if start is None or overclosure.allowed == 0:
        return
    way = _seen(model)[0][start.nodes] - start.x
    way = way - np.sum(way * start.normal, axis=1)[:, None] * start.normal
    mine = float(np.max(np.linalg.norm(way, axis=1), initial=0.0))
    slid = float(model.comm.allreduce(mine, op=MPI.MAX))
    if slid <= NEARBY * model.paired.facet_size:
        return
    strangers = model.comm.allreduce(int(overclosure.has_strangers), op=MPI.MAX)
    height = FLAT * (overclosure.depth - overclosure.least)
    if not strangers and (overclosure.is_even or _is_flat(model, start, height)):
        return
    model.overclosed_from = None
    tell(
        model,
        "ignored overclosure that has slid",
        f"initial_overclosure: the bodies have slid by {slid:.3g} since they were first paired, "
        f"where depths from {overclosure.least:.3g} to {overclosure.depth:.3g} are ignored; these "
        "belong to slave nodes, and are wrong where the master is not flat or where other nodes "
        "meet it: move a mesh so that nothing penetrates, resolve it (contact.allow_overclosure, "
        "gradually), or make the surface whose shape they are the slave",
    )


def _seen(model: ContactModel) -> list[Array]:
    """Positions of slave nodes in the frame of the master, for each gap. Collective."""
    settings = model.settings
    roles = [*settings.roles, *(role[:2] for role in settings.roles_of_vertices)]
    roles += [role[:2] for role in settings.roles_of_edges]
    return [_seen_by(model, *role) for role in roles]


def _seen_by(model: ContactModel, slave: Surface, master: AnySurface) -> Array:
    """Nodes in the frame of the other surface; a deformable body's translates. Collective."""
    x = _nodes(model, slave)
    for tool in master.tools:
        d = tool.gdim
        position = model.placement.master.positions() if _has_moved(model) else tool.position
        x[:, :d] = (x[:, :d] - position[:, d]) @ position[:, :d]
    for body in master.bodies:
        there = _nodes(model, body)
        sums = np.append(there.sum(axis=0), len(there))
        sums = slave.comm.allreduce(sums, op=MPI.SUM)
        x -= sums[:3] / sums[3]
    return x


def _has_moved(model: ContactModel) -> bool:
    """Whether the bodies may have moved since the coordinates of the surfaces were read."""
    return model.num_pairings > 0 and model.follows


def _nodes(model: ContactModel, surface: Surface) -> Array:
    """Positions of owned nodes; with finite sliding those of the last evaluation. Collective."""
    x: Array = np.array(surface.node_x)
    if _has_moved(model):
        vec = model.placement.bodies[0 if surface is model.slave else 1].vec()
        first = vec.owner_range[0]
        x[:, : surface.gdim] += vec.array_r[surface.node_dofs - first]
        vec.destroy()
    return x


def _is_flat(model: ContactModel, start: OverclosedStart, allowed: float) -> bool:
    """Whether the master is flat, up to a height, where the slave penetrates. Collective."""
    x = model.slave.node_x[start.nodes]
    if is_shape(model.master):
        normal = model.master.distance(x)[1]
        low, high = _range(model.comm, normal)
        return bool(np.all(high - low <= SOLVED))
    facets = model.master.search_object(model.slave).facet_x
    low, high = _range(model.comm, x)
    margin = model.overclosure.depth
    near = np.all((facets.max(axis=1) >= low - margin) & (facets.min(axis=1) <= high + margin), 1)
    normal = model.comm.allreduce(area_vectors(facets[near]).sum(axis=0), op=MPI.SUM)
    heights = facets[near].reshape(-1, 3) @ (normal / max(float(np.linalg.norm(normal)), 1e-300))
    low, high = _range(model.comm, np.repeat(heights[:, None], 3, axis=1))
    return not bool(np.any(high - low > allowed))


def _range(comm: MPI.Intracomm, x: Array) -> tuple[Array, Array]:
    """Minimum and maximum of each column over all ranks, x of shape (n, 3). Collective."""
    corners = np.concatenate(
        [-np.min(x, axis=0, initial=np.inf), np.max(x, axis=0, initial=-np.inf)]
    )
    comm.Allreduce(MPI.IN_PLACE, corners, op=MPI.MAX)
    return -corners[:3], corners[3:]
