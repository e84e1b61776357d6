"""What a scalar field takes from the contact of the bodies that it is a field of."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.checks import require
from qsdolfinx.base.handles import handle_of
from qsdolfinx.contact import results
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.contact.placement import Place, ToolPlace
from qsdolfinx.surface.affine import affine_vec
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import AnySurface, as_tool, deformable

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]


def check_of(of: ContactModel, slave: Surface, master: AnySurface) -> None:
    """Refuse a contact that has nothing to give to these surfaces.

    Raises:
        ValueError: If it is of other facets, or keeps no pairing points.
    """
    text = "of: must be a contact of displacements or velocities"
    require(not of.is_scalar, f"{text}, not of scalar fields")
    require(
        of.settings.sliding == "small" and not of.with_itself,
        'of: sliding="finite" and contact with itself keep no pairing points; use small sliding, '
        "in time steps",
    )
    require(len(of.gaps) == 1, 'of: "double-pass" contact pairs twice; use "quasi-symmetric"')
    require(_same_facets(of.slave, slave), "of, slave: must be on the same facets of one mesh")
    other, there = deformable(of.master), deformable(master)
    if other is not None:
        fits = there is not None and _same_facets(other, there)
        require(fits, "of, master: must be on the same facets of one mesh")


def _same_facets(one: Surface, other: Surface) -> bool:
    return one.mesh is other.mesh and np.array_equal(one.facets, other.facets)


def _at_nodes(source: Surface, target: Surface, values: Array) -> Array:
    """Values at the owned contact nodes of one surface, (nodes,), at those of another. Collective.

    Both are on the same facets.
    """
    there = _look_up(target, source, target.node_dofs[:, 0])
    vec = source.create_vec()
    vec.array[source.node_dofs[:, 0] - vec.owner_range[0]] = values
    return _read(vec, there)


def _look_up(source: Surface, target: Surface, wanted: Numbers) -> Numbers:
    """First unknowns of the target at the nodes with these first ones of the source. Collective.

    Args:
        source: A surface.
        target: Another one on the same facets.
        wanted: Global unknowns; −1 stays.
    """
    count = min(surface.trace_dofs[0].shape[1] for surface in (source, target))
    own, other = (surface.trace_dofs[0][:, :count, 0].ravel() for surface in (source, target))
    vec = source.create_vec()
    vec.setValues(own.astype(PETSc.IntType), other.astype(np.float64))
    vec.assemble()
    out = np.full(wanted.shape, -1, dtype=np.int64)
    used = wanted >= 0
    out[used] = np.rint(_read(vec, wanted[used])).astype(np.int64)
    return out


def _read(vec: PETSc.Vec, wanted: Numbers) -> Array:
    """Entries of a vector on any rank; it is destroyed. Collective."""
    local = PETSc.Vec().createSeq(wanted.size, comm=PETSc.COMM_SELF)
    places = PETSc.IS().createGeneral(wanted.astype(PETSc.IntType), comm=PETSc.COMM_SELF)
    scatter = PETSc.Scatter().create(vec, places, local, None)
    scatter.scatter(vec, local)
    out: Array = local.array_r.copy()
    for thing in (scatter, places, local, vec):
        thing.destroy()
    return out


class Mechanics:
    """Pairs, pressures, distances and friction of the bodies' contact, for a field on them.

    Pairs are those of the bodies, unless their master is a rigid tool that has a mesh of its own
    for the field: then the field is paired by itself, where the meshes are.

    Args:
        of: The bodies' contact.
        slave: Surface of the field on the slave's facets.
        master: The same of the master, or the rigid tool.
    """

    def __init__(self, of: ContactModel, slave: Surface, master: AnySurface) -> None:
        self.of, self._slave, self._master = of, slave, master
        #: Whether the field has the bodies' pairs.
        self.shares_pairs = (as_tool(of.master) is None) == (as_tool(master) is None)
        self._taken: _cpp.PairingPoints | None = None
        if self.shares_pairs:
            same = of.slave.degree == slave.degree and _degree(of.master) == _degree(master)
            require(same, "of: the field's degree on the facets must be that of the displacement")

    @property
    def is_stale(self) -> bool:
        """Whether the bodies have been paired anew since :meth:`points`."""
        return self.shares_pairs and self.of.gaps[0].points is not self._taken

    def points(self) -> _cpp.PairingPoints:
        """The bodies' pairing points with the unknowns of the field. Collective."""
        self._taken = points = self.of.gaps[0].points
        sides: list[tuple[Numbers, npt.NDArray[np.int32]]] = []
        pairs = ((self.of.slave, self._slave, points.slave), (self.of.master, self._master, points.master))
        for body, field, found in pairs:
            source, target = deformable(body), deformable(field)
            if source is None or target is None:
                sides.append((np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int32)))
                continue
            unknowns = _look_up(source, target, np.asarray(found["dofs"])[..., 0])
            sides.append((unknowns, _owners(target, unknowns)))
        return _cpp.with_unknowns(points, 1, *sides[0], *sides[1])

    def pressure(self) -> Array:
        """Contact pressure (stress) at the field's nodes on the slave, not negative. Collective."""
        found = results.pressure_at_vertices(self.of, "slave")
        return np.maximum(_at_nodes(self.of.slave.linear, self._slave, found), 0.0)

    def distance(self) -> Array:
        """Distance (length) of the bodies at their pairing points, 0 in contact. Collective."""
        slave, master = self.of.slave, self.of.master
        operator = _cpp.GapOperator(
            slave.cpp_object, master.cpp_object, self.of.gaps[0].points, jump=False, rows=2
        )
        placement = self.of.placement
        vecs = [placement.slave.vec()]
        if isinstance(placement.master, Place):
            vecs.append(placement.master.vec())
        depth = operator.apply(*(handle_of(v) for v in (vecs + [None])[:2]))[:, 0]
        if isinstance(placement.master, ToolPlace) and placement.master.motion is not None:
            vecs.append(affine_vec(slave, placement.master.motion))
            depth = depth - operator.apply(vecs[-1].handle, 0)[:, 0]
        for vec in vecs:
            vec.destroy()
        return np.maximum(np.asarray(operator.initial_gap) - depth, 0.0)

    def dissipation(self) -> Array:
        """Energy that friction took in the last step, at the field's nodes. Collective."""
        found = np.zeros(len(self.of.slave.node_area))
        for slip in self.of.slips:
            found = slip.dissipation_at_nodes()
        return _at_nodes(self.of.slave, self._slave, found)


def _degree(surface: AnySurface) -> int:
    return 1 if as_tool(surface) is not None else surface.degree


def _owners(surface: Surface, unknowns: Numbers) -> npt.NDArray[np.int32]:
    """Ranks that own unknowns of a surface's body; −1 of none. Collective."""
    vec = surface.create_vec()
    ends = np.asarray(vec.owner_ranges)[1:]
    vec.destroy()
    owners = np.searchsorted(ends, unknowns, side="right").astype(np.int32)
    return np.where(unknowns >= 0, owners, np.int32(-1))
