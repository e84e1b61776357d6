"""Warnings about probable mistakes at the first contact detection, with remedies."""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.rounding import SINGLE
from qsdolfinx.contact.contact_type import ContactType
from qsdolfinx.contact.findings import Check
from qsdolfinx.contact.model import ContactModel, Settings, radius_of
from qsdolfinx.contact.orientation import find_turned
from qsdolfinx.pairing.pair import degree_of_rule, find_conforming
from qsdolfinx.tools.rigid_surface import AnySurface, RigidSurface, is_shape

Array = npt.NDArray[np.float64]

#: Kind of the finding about facets that approximate curved surfaces.
CHORDS = "chord errors"

#: Part of the slave's nodes near the master that are paired at least in any valid model. With more,
#: bodies that meet with a part of their surfaces would get a warning.
FEW = 0.1

#: Facet size of the master over that of the slave below which nodal quadrature leaves spikes in the
#: traction. A ratio of one half gives no warning, to allow for rounding and graded meshes.
FINER = 0.45

#: Initial penetration over the smallest facet that is probably not meant to be resolved at once.
#: Less is what meshes of one geometry differ by; with more, a mistake in a position is not seen.
DEEP = 0.25

#: Chord error of facets over the clearance or interference, above which results change. With less,
#: every curved fit would get a warning; with more, pressures that are wrong by some tens of per
#: cent would not.
COARSE = 0.1

#: Clearance or interference, in units of the largest facet, below which chord errors change
#: pressures even if they are small beside it. Pressing a facet's chord error h²/8R flat takes a
#: pressure of some E h/8R, beside E δ/R of the interference δ. In rings of two meshes pressures are
#: wrong by 10 % (root mean square) there: ``tests/contact/test_chord_errors.py``.
THIN = 0.4

# --- Few or no nodes are paired


class Candidates(typing.NamedTuple):
    """Numbers of slave nodes of all ranks, for the case that few or none are paired.

    Attributes:
        near: Nodes within the search distance of the master's bounding box.
        turned: Nodes that would be paired if the normals were reversed.
        facing: Nodes that face the master beyond the search distance.
        away: The smallest distance of these nodes (length).
    """

    near: int
    turned: int
    facing: int
    away: float


def find_unpaired(model: ContactModel) -> str:
    """Warning if few or no nodes are paired; otherwise empty. Collective."""
    rows = _total(model, len(model.gaps[0].rows.reached))
    if is_shape(model.master):
        found = _of_shape(model, model.master)
    else:
        corners = _box(model.comm, model.master.search_object(model.slave).facet_x)
        low, high = corners[0] - model.paired.search_radius, corners[1] + model.paired.search_radius
        nodes = model.slave.node_x
        near = _total(model, np.count_nonzero(np.all((nodes >= low) & (nodes <= high), axis=1)))
        if rows > 0 and rows >= FEW * near:
            return ""
        found = _of_facets(model, near, corners)
    if rows > 0 and rows >= FEW * found.near:
        return ""
    paired = f"only {rows} of {found.near} slave nodes near the master" if rows else "no slave node"
    if found.turned > max(2 * rows, FEW * found.near):
        return (
            f"normals: {paired} found a partner, since the outward normals of the surfaces point "
            "in the same direction where they meet, as if one body were inside the other: check "
            "the chosen facets or tags, and a rigid tool's normal or the orientation of its facets"
        )
    if found.facing <= max(rows, FEW * found.near):
        return ""  # for example a free side at right angles to the die onto which it will fold
    return (
        f"search_radius: {paired} found a partner within {model.paired.search_radius:.3g}, but "
        f"{found.facing} others face the master at distances from {found.away:.3g} on, which a "
        "single solve does not see: give a larger search_radius, or check the positions of the "
        "meshes; if time steps, which update the contact pairs, are to bring them together, there "
        "is nothing to do"
    )


def find_no_flow(model: ContactModel) -> str:
    """Warning if nothing conducts between two surfaces; otherwise empty. Collective."""
    if _total(model, len(model.gaps[0].rows.reached)) > 0:
        return ""
    return "slave, master: nothing is opposite to each other; nothing flows"


def _of_shape(model: ContactModel, tool: RigidSurface) -> Candidates:
    distance, normal = tool.distance(model.slave.node_x)
    cosine = np.sum(normal * model.slave.node_normal, axis=1)
    close = np.abs(distance) <= model.paired.search_radius
    facing = ~close & (cosine < _cpp.facing_cosine)
    away = float(np.min(np.abs(distance[facing]), initial=np.inf))
    masks = close, close & (-cosine < _cpp.facing_cosine), facing
    near, turned, faces = (_total(model, np.count_nonzero(mask)) for mask in masks)
    return Candidates(near, turned, faces, model.comm.allreduce(away, op=MPI.MIN))


def _of_facets(model: ContactModel, near: int, corners: tuple[Array, Array]) -> Candidates:
    """Count nodes that are paired with reversed normals, and beyond the search distance."""
    slave = model.slave.linear
    other = model.master.linear.search_object(slave)
    x, inside, _ = slave.coordinates
    slave.cpp_object.move(x, 2 * x.mean(axis=1) - inside)
    turned = _cpp.pair_surfaces(slave.cpp_object, other, False, model.paired.radius, 0)
    slave.cpp_object.move(x, inside)
    low, high = _box(model.comm, np.concatenate([slave.node_x, *(c[None] for c in corners)]))
    anywhere = float(np.linalg.norm(high - low))
    faced = _cpp.pair_surfaces(slave.cpp_object, other, False, _cpp.SearchRadius(anywhere), 0)
    beyond = np.abs(faced.gap)[np.abs(faced.gap) > model.paired.search_radius]
    away = float(np.min(beyond, initial=np.inf))
    return Candidates(
        near,
        _total(model, turned.size),
        _total(model, len(beyond)),
        model.comm.allreduce(away, op=MPI.MIN),
    )


def _box(comm: MPI.Intracomm, x: Array) -> tuple[Array, Array]:
    """Corners of the smallest box around points of all ranks. Collective."""
    x = x.reshape(-1, 3)
    low, high = np.min(x, axis=0, initial=np.inf), np.max(x, axis=0, initial=-np.inf)
    corners = np.concatenate([-low, high])
    comm.Allreduce(MPI.IN_PLACE, corners, op=MPI.MAX)
    return -corners[:3], corners[3:]


def _total(model: ContactModel, count: int) -> int:
    """Sum over the ranks. Collective."""
    return int(model.comm.allreduce(int(count), op=MPI.SUM))


# --- Facets


def find_finer_master(model: ContactModel) -> str:
    """Warning if nodal quadrature meets a much finer master; otherwise empty. Collective."""
    if model.settings.sampling.quadrature != "nodal" or len(model.of_sides) > 1:
        return ""
    sizes = local_sizes(model)
    if sizes is None or sizes[1] >= FINER * sizes[0]:
        return ""
    return (
        f"quadrature: in the contact zone the master's facets ({sizes[1]:.3g}) are much smaller "
        f"than the slave's ({sizes[0]:.3g}); nodal quadrature then gives spikes of traction, and "
        'with master-slave contact nodes without force: use quadrature="overlay", or swap slave '
        "and master"
    )


def local_sizes(model: ContactModel) -> tuple[float, float] | None:
    """Mean facet size of slave and master where they are paired. Collective.

    None if nothing is paired, or the master has no relevant facets.
    """
    if len(model.bodies) < 2:
        return None
    points = model.gaps[0].points
    low, high = _box(model.comm, points.slave["x"])
    if not np.all(low <= high):
        return None
    sizes = []
    for surface in model.bodies:
        x = surface.coordinates[0]
        middle, size = x.mean(axis=1), facet_sizes(x)
        reach = size[:, None]
        here = np.all((middle >= low - reach) & (middle <= high + reach), axis=1)
        sums = np.array([size[here].sum(), np.count_nonzero(here)])
        total, count = model.comm.allreduce(sums, op=MPI.SUM)
        if count == 0:
            return None
        sizes.append(float(total / count))
    return sizes[0], sizes[1]


def facet_sizes(x: Array) -> Array:
    """Largest distance of two vertices of each facet, x of shape (facets, vertices, 3)."""
    sides = np.linalg.norm(x[:, :, None] - x[:, None], axis=-1)
    return np.max(sides, axis=(1, 2), initial=0.0)


# --- Penetration


def find_overclosure(model: ContactModel) -> str:
    """Warning about deep penetration that the next solve resolves at once; otherwise empty."""
    overclosure = model.overclosure
    size = model.paired.facet_size
    if overclosure.treatment != "resolve" or overclosure.depth <= DEEP * size:
        return ""
    return (
        f"initial_overclosure: the surfaces penetrate each other by {overclosure.depth:.3g}, "
        f"{overclosure.depth / size:.2g} of the smallest facet, and the next solve presses them "
        'apart: move a mesh, choose initial_overclosure="ignore", or, for an interference fit, '
        "resolve it gradually with contact.allow_overclosure"
    )


# --- Facets of curved surfaces


class ChordErrors(typing.NamedTuple):
    """Effect of chord errors of facets on the gap between surfaces that are curved alike.

    Attributes:
        of_sides: Largest chord error of slave and master (length); 0 for a side that is treated as
            curved.
        error: Largest change of the gap by chord errors (length).
        gap: Largest clearance or interference of these surfaces (length).
    """

    of_sides: Array
    error: float
    gap: float


def chord_errors(settings: Settings) -> ChordErrors | None:
    """Chord errors that change gaps significantly at the first contact detection, or None.

    Collective.

    Args:
        settings: A contact with normal gaps.
    """
    slave, sampling, master = settings.slave, settings.sampling, settings.master
    exact = master.is_analytic and sampling.quadrature == "nodal"
    if exact or not any(flat_sides(settings)):
        return None
    degree = degree_of_rule(slave, master, follows=False)
    found = find_conforming(slave, master, degree, radius_of(settings), sampling.follows)
    if found.part < FEW:
        return None
    bulges = found.bulges
    local = bulges[:, 0], bulges[:, 1], bulges[:, 0] - bulges[:, 1], found.gap
    largest = np.array([np.max(np.abs(values), initial=0.0) for values in local])
    slave.comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
    error, gap = map(float, largest[2:])
    if error <= SINGLE * settings.facet_size:
        return None
    if gap >= error / COARSE:
        return None
    if not _vary_with(slave.comm, found.gap, bulges[:, 0] - bulges[:, 1]):
        return None
    return ChordErrors(largest[:2], error, gap)


def flat_sides(settings: Settings) -> list[bool]:
    """Whether contact treats the facets of slave and master, as far as they have some, as flat."""
    return [settings.sampling.heights(side) is None for side in _with_facets(settings)]


def _with_facets(settings: Settings) -> tuple[AnySurface, ...]:
    slave, master = settings.slave, settings.master
    return (slave,) if master.is_analytic else (slave, master)


def chords(model: ContactModel) -> str:
    """Warning about chord errors that change the gap significantly; otherwise empty. Collective."""
    settings = model.settings
    found = chord_errors(settings)
    if found is None:
        return ""
    finer = _finer(model, found)
    cures = [bent(settings), finer]
    return f"{_text(settings, found)}: take {', or '.join(filter(None, cures))}"


def _text(settings: Settings, found: ChordErrors) -> str:
    """Describe the effect of chord errors on the gap."""
    (slave, master), error, gap = found.of_sides, found.error, found.gap
    beside = "; there is no clearance or interference beside it"
    if gap > SINGLE * error:
        beside = f", {error / gap:.2g} of the clearance or interference ({gap:.3g})"
    chords = (
        f"chord error of the slave's facets ({slave:.2g}) changes"
        if settings.master.is_analytic
        else "chord errors of the slave's and the master's facets "
        f"({slave:.2g}, {master:.2g}) change"
    )
    return (
        f"facets: where the surfaces are curved the same way, the {chords} the gap by up to "
        f"{error:.2g}{beside}"
    )


def _vary_with(comm: MPI.Intracomm, gap: Array, error: Array) -> bool:
    """Whether facets approximate a curved surface, and are not the surface itself. Collective.

    For curved bodies, the gap between facets contains the chord errors and varies with them. A
    pyramid, in contrast, is as flat as its facets, and a body that lies on it has no such gap. The
    slope of the line that fits gaps over chord errors best distinguishes the two cases: it is 1 or
    0.

    Args:
        comm: Communicator of the surfaces.
        gap: Gap between the curved surfaces at points (length).
        error: Contribution of chord errors to the gap at these points (length).
    """
    measured = gap + error
    sums = np.array([len(gap), error.sum(), measured.sum(), error @ error, error @ measured])
    n, e, g, ee, eg = comm.allreduce(sums, op=MPI.SUM)
    return bool(n * eg - e * g > 0.5 * (n * ee - e * e))


def bent(settings: Settings) -> str:
    """Text of the remedy by which contact is between curved facets, for a warning."""
    sides = _with_facets(settings)
    flat = [side for side, is_flat in zip(sides, flat_sides(settings), strict=True) if is_flat]
    bodies, cures = [body for side in flat for body in side.bodies], []
    if any(body.heights is None for body in bodies):
        cure = (
            "meshes of degree 2, msh = qs.elevate(msh, facet_tags, tag) before the function space"
        )
        linear = any(body.degree < 2 for body in bodies)
        cure += ", and displacements of degree 2" * (settings.sampling.follows and linear)
        cures = [cure + ' with quadrature="overlay"' * (settings.sampling.quadrature != "overlay")]
    elif bodies:
        cures = [
            'displacements of degree 2, since sliding="finite" treats facets as flat if '
            'displacements are of degree 1, or sliding="small"'
        ]
    if len(flat) > len(bodies):
        cures.append("finer facets of the tool")
    return ", and ".join(cures)


def _finer(model: ContactModel, found: ChordErrors) -> str:
    """Text of the facet size at which chord errors change nothing, for a warning."""
    errors, allowed = found.of_sides, COARSE * found.gap
    analytic = model.master.is_analytic
    sizes = (sum(model.slave.facet_size_range) / 2,) if analytic else local_sizes(model)
    coarser = int(np.argmax(errors))
    if sizes is None or allowed <= SINGLE * errors[coarser]:
        return ""
    size = min(sizes[coarser] * np.sqrt(allowed / errors[coarser]), found.gap / THIN)
    return f"facets of size {size:.2g}"


#: Checks after the first contact detection, in the order in which they are made. Most of a surface
#: in contact with itself faces nothing.
AT_FIRST = (
    Check("side of facets", find_turned, ContactType.NORMAL | ContactType.TIE),
    Check("finer master", find_finer_master, ContactType.NORMAL | ContactType.TIE),
    Check(CHORDS, chords, ContactType.NORMAL),
    Check("pairs", find_unpaired, ~ContactType.ITSELF, unless="side of facets"),
    Check("pairs", find_no_flow, ContactType.FIELD),
    Check("initial overclosure", find_overclosure, ContactType.GAPS, unless="side of facets"),
)
