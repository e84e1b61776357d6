"""Contact surfaces: facets of a body's boundary, and the unknowns at their vertices."""

from __future__ import annotations

import functools

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from dolfinx import fem, la, mesh

import qsdolfinx._cpp as _cpp
from qsdolfinx.base.checks import FLAG, FUNCTION, check, check_array, instance, require
from qsdolfinx.base.collective import checked, collective_errors
from qsdolfinx.base.rounding import ROUNDING
from qsdolfinx.compat import collapse, is_sub_space
from qsdolfinx.surface.arguments import (
    FACET_VERTICES,
    check_space,
    facets_of_owned_cells,
    given_facets,
    is_same,
    trace_degree,
)
from qsdolfinx.surface.facets import FacetLayout
from qsdolfinx.surface.geometry import Axisymmetric, Cartesian
from qsdolfinx.surface.unknowns import block_of, first_vertex_unknowns, is_lagrange

#: Coordinates of the facets' vertices, of a point inside each facet's cell, and, with a mesh
#: geometry of degree 2, of the facets' nodes of degree 2.
Coordinates = tuple[
    npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64] | None
]

#: Attributes that are listed by ``dir`` and tab completion.
PUBLIC = (
    "V",
    "area",
    "axisymmetric",
    "center",
    "comm",
    "facet_size_range",
    "facets",
    "mesh",
    "node_area",
    "node_dofs",
    "node_normal",
    "node_values",
    "node_x",
    "update",
)


class Surface:
    """Contact surface: part of a body's boundary that may touch another body.

    Contact nodes are the vertices of the facets. Every facet belongs to the rank that owns its
    cell, every node to the rank that owns its unknowns; a rank may own no facets and no nodes. On a
    mesh of degree 2, areas and normals at nodes are those of the flat facets through the vertices.
    Contact corrects for the distance of the curved facets from the flat facets. Coordinates are
    read when the surface is made. If the mesh has moved, ``surface.update()`` and
    ``contact.update()`` read them again.

    Args:
        V: Blocked vector space of the body's displacement or velocity, one component per space
            dimension, or a scalar space, such as for its temperature. The trace on the facets must
            be continuous: Lagrange of degree 1 or 2, P1 with a cell bubble, or such a sub-space
            ``W.sub(i)`` of a mixed space.
        facet_tags: Tags of the facets of ``V.mesh``.
        tag: The tag of the contact facets.
        facets: Local indices of the facets, instead of ``facet_tags`` and ``tag``. Facets of ghost
            cells are optional.
        axisymmetric: Whether coordinates are (r, z), r ≥ 0. Facets are then rings, areas are 2πr
            times lengths, and forces are those on whole rings, as with
            :func:`qsdolfinx.materials.axisymmetric_weight` in the bulk form.

    Raises:
        ValueError: If the space is of another kind, of a degree above 2 or discontinuous; if the
            surface is empty or not on the boundary, or has coordinates that are not finite or
            facets without area.
        TypeError: If both or none of ``facet_tags`` and ``facets`` are given, or PETSc is complex.

    Attributes:
        mesh: The mesh of V.
        largest_height: Largest distance of curved facets from the flat facets through their
            vertices, over all ranks (length); 0 for straight facets.
        cpp_object: Surface object of the C++ extension.
    """

    def __init__(
        self,
        V: fem.FunctionSpace,
        facet_tags: mesh.MeshTags | None = None,
        tag: int | None = None,
        *,
        facets: npt.ArrayLike | None = None,
        axisymmetric: bool = False,
    ) -> None:
        check(instance(fem.FunctionSpace, "a dolfinx.fem.FunctionSpace"), V=V)
        comm, topology = V.mesh.comm, V.mesh.topology
        if topology.cell_type in FACET_VERTICES:
            topology.create_connectivity(topology.dim - 1, topology.dim)
            topology.create_connectivity(topology.dim, topology.dim - 1)
        with checked(comm) as same:
            same(FLAG, axisymmetric=axisymmetric)
            check_space(V, axisymmetric)
            given = given_facets(V.mesh, facet_tags, tag, facets)
        self.V = V
        self.axisymmetric = bool(axisymmetric)
        self.mesh = V.mesh
        self.facets = facets_of_owned_cells(V.mesh, given)
        self._linear: Surface | None = None
        #: Spaces of degree 1, by whether they are scalar; below, the last other space used in
        #: ``_node_unknowns``, with its unknowns at the nodes.
        self._vertex_spaces: dict[bool, fem.FunctionSpace] = {}
        self._unknowns_in: tuple[fem.FunctionSpace, npt.NDArray[np.int32]] | None = None
        self._key: npt.NDArray[np.float64] | None = None
        with collective_errors(comm):
            self._layout = FacetLayout.of(V, self.facets)
            self._coordinates = self._layout.checked_coordinates(V.mesh)
        self.cpp_object: _cpp.Surface = self.twin()
        self._read_heights()

    @property
    def coordinates(self) -> Coordinates:
        """Coordinates of the facets, of points inside their cells, and of curved facets' nodes.

        They are those of the last time that the mesh was read.
        """
        return self._coordinates

    @coordinates.setter
    def coordinates(self, value: Coordinates) -> None:
        self.cpp_object.move(*value[:2])
        self._coordinates = value
        self._linear = None
        self._read_heights()

    @property
    def present_vertices(self) -> npt.NDArray[np.float64]:
        """Vertices of the facets in the mesh now, not as read last, shape (facets, vertices, 3)."""
        return np.take(self.mesh.geometry.x, self._layout.points, axis=0)

    @property
    def facet_numbers(self) -> npt.NDArray[np.float64]:
        """A number for each facet between ½ and 2½, the same at any position and on any partition.

        It is computed from the input indices of the mesh's vertices; shape (facets,).
        """
        numbers = np.asarray(self.mesh.geometry.input_global_indices)[self._layout.points]
        return np.asarray(1.5 + np.sin(2.4 * numbers.sum(axis=1)))

    def twin(self, axisymmetric: bool | None = None) -> _cpp.Surface:
        """New independent object of the C++ extension with the same facets. Collective.

        Args:
            axisymmetric: Not used: see ``RigidSurface.twin``.
        """
        x, inside, _ = self._coordinates
        index_map = self.V.dofmap.index_map
        return _cpp.Surface(
            comm=self.comm.py2f(),
            gdim=self.gdim,
            block=self.block,
            num_vertices=self.num_facet_vertices,
            x=x,
            degree=self.degree,
            dofs=self._layout.dofs,
            owner=self._layout.owner,
            inside=inside,
            local_size=index_map.size_local * self.V.dofmap.index_map_bs,
            axisymmetric=self.axisymmetric,
            key=self._key,
        )

    def touch_itself(self, key: npt.NDArray[np.float64]) -> None:
        """Prepare the surface, the whole boundary of a body, for self-contact. Collective.

        Its nodes are then those of the facets that may be in contact.

        Args:
            key: Data of each facet of this rank, shape (facets, 7): its normal, its midpoint, and
                whether the space in front of it was free (1) or within the body (0); see key_size
                in cpp/surface/surface.h. NaN for facets that are not in contact.
        """
        self._key = np.ascontiguousarray(key)
        self.cpp_object = self.twin()

    @property
    def key(self) -> npt.NDArray[np.float64] | None:
        """Argument of :meth:`touch_itself`; None without self-contact."""
        return self._key

    def _read_heights(self) -> None:
        """Read the heights of curved facets over the flat facets. Collective."""
        nodes = self._coordinates[2]
        self._heights: npt.NDArray[np.float64] | None = None
        self.largest_height = 0.0
        if nodes is None:
            return
        over = nodes - np.asarray(_cpp.flat_nodes(self.cpp_object))
        heights = np.sum(over * np.asarray(_cpp.flat_normals(self.cpp_object)), axis=2)
        largest = self.comm.allreduce(np.max(np.abs(heights), initial=0.0), op=MPI.MAX)
        if largest > ROUNDING * self.facet_size_range[1]:
            self._heights, self.largest_height = heights, float(largest)

    @property
    def heights(self) -> npt.NDArray[np.float64] | None:
        """Distance of curved facets from the flat facets, along outward normals (length).

        Shape (facets, nodes of degree 2); None on all ranks if all facets are straight.
        """
        return self._heights

    def __dir__(self) -> list[str]:
        """Attributes for users; the others are for the library: docs/api/extending.md."""
        return list(PUBLIC)

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator of the mesh."""
        return self.mesh.comm

    @property
    def gdim(self) -> int:
        """Geometric dimension, 2 or 3."""
        return int(self.mesh.geometry.dim)

    @property
    def block(self) -> int:
        """Number of unknowns of a node: the geometric dimension, or 1 for a scalar field."""
        return block_of(self.V)

    @property
    def is_scalar(self) -> bool:
        """Whether the surface carries a scalar field, such as a temperature."""
        return self.block == 1

    @property
    def facet_size_range(self) -> tuple[float, float]:
        """Smallest and largest facet size (largest distance of two vertices). Collective."""
        low, high = self.cpp_object.facet_size_range
        return float(low), float(high)

    @property
    def degree(self) -> int:
        """Degree of the trace, 1 or 2."""
        degree = trace_degree(self.V)
        assert degree is not None
        return degree

    @property
    def num_facet_vertices(self) -> int:
        """Number of vertices of a facet."""
        return FACET_VERTICES[self.mesh.topology.cell_type]

    @property
    def node_dofs(self) -> npt.NDArray[np.int64]:
        """Global unknowns of the contact nodes this rank owns, shape (nodes, block)."""
        return np.asarray(self.cpp_object.node_dofs)

    @property
    def trace_dofs(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int32]]:
        """Global unknowns of the facets' nodes, shape (facets, nodes, block), and their owners."""
        return self._layout.dofs, self._layout.owner

    @functools.cached_property
    def own_trace(self) -> npt.NDArray[np.int64]:
        """Local unknowns of the trace that this rank owns, ascending. Collective at first call."""
        vec, dofs = self.create_vec(), self._layout.dofs.ravel().astype(PETSc.IntType)
        vec.setValues(dofs, np.ones(len(dofs)))
        vec.assemble()
        out = np.flatnonzero(vec.array_r)
        vec.destroy()
        return np.asarray(out)

    @property
    def node_x(self) -> npt.NDArray[np.float64]:
        """Positions in the mesh of the contact nodes this rank owns, shape (nodes, 3).

        They are those of the last time that the mesh was read, without displacements.
        """
        return np.asarray(self.cpp_object.node_x)

    @property
    def node_area(self) -> npt.NDArray[np.float64]:
        """Nodal areas S_k = ∫ N_k ds of the owned nodes, shape (nodes,).

        They are those of the mesh coordinates read last. Contact detection reads them at its
        positions: in time steps these are the predicted positions at the end of the step.
        Axisymmetric: ∫ N_k 2πr ds.
        """
        return np.asarray(self.cpp_object.node_area)

    @property
    def node_normal(self) -> npt.NDArray[np.float64]:
        """Averaged outward unit normals at the owned nodes, shape (nodes, 3)."""
        return np.asarray(self.cpp_object.node_normal)

    @property
    def node_size(self) -> npt.NDArray[np.float64]:
        """Size of the facets around the owned nodes (length), shape (nodes,). Collective."""
        if self.axisymmetric:  # a ring's area says nothing about the size of its facet
            return np.full(len(self.node_area), np.mean(self.facet_size_range))
        return np.asarray(self.node_area ** (1 / self.area_dim))

    @property
    def center(self) -> npt.NDArray[np.float64]:
        """Default reference point of moments: the origin, shape (gdim,)."""
        return np.zeros(self.gdim)

    def shape_degree(self, order: int) -> int:
        """Total polynomial degree of Lagrange functions of this order on affine facets."""
        return order * (2 if self.num_facet_vertices == 4 else 1)

    @property
    def area_degree(self) -> int:
        """Polynomial degree of the weight of areas: 1 for rings (2πr), otherwise 0."""
        return int(self.axisymmetric)

    @property
    def bodies(self) -> tuple[Surface, ...]:
        """The surface itself: surfaces with unknowns on this side, see :class:`qs.RigidSurface`."""
        return (self,)

    @property
    def tools(self) -> tuple[()]:
        """Empty: rigid tools on this side of a contact, see :class:`qs.RigidSurface`."""
        return ()

    @property
    def is_analytic(self) -> bool:
        """False: the surface consists of facets, see :class:`qs.RigidSurface`."""
        return False

    @property
    def motion(self) -> None:
        """None: only the unknowns of the body move the surface, see :class:`qs.RigidSurface`."""
        return None

    @property
    def version(self) -> int:
        """Always 0: there are no prescribed positions, see :class:`qs.RigidSurface`."""
        return 0

    def check_state(self) -> None:
        """Do nothing: there is no prescribed motion, see :class:`qs.RigidSurface`."""

    def check_partner(self, master: Surface) -> None:
        """Check that a deformable master can be in contact with this slave.

        Raises:
            ValueError: If only one of the two is axisymmetric, or if they share facets.
        """
        fields = self.is_scalar == master.is_scalar
        require(fields, "slave and master: both or none must be on scalar spaces")
        alike = self.axisymmetric == master.axisymmetric
        require(alike, "slave and master: both or none must be axisymmetric")
        if master is self:
            return
        share = self.mesh is master.mesh and np.intersect1d(self.facets, master.facets).size
        text = (
            "slave and master share facets: a facet cannot be in contact with itself; give the "
            "same Surface for both if parts of it may come to touch each other"
        )
        require(not share, text)

    def search_object(self, slave: Surface) -> _cpp.Surface:
        """Object of the C++ extension for contact detection from a slave."""
        return self.cpp_object

    def as_facets(self, axisymmetric: bool = False) -> Surface:
        """The surface itself, which consists of facets; see :class:`qs.RigidSurface`."""
        return self

    def facet_positions(self, position: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Nodes of this rank's facets, (facets, nodes, 3), which are the position of a body."""
        return position

    @property
    def geometry(self) -> Cartesian:
        """Kind of coordinates, Cartesian or axisymmetric."""
        return Axisymmetric() if self.axisymmetric else Cartesian()

    @property
    def area_dim(self) -> int:
        """Dimension of an area: 2, or 1 where it is a length (2D)."""
        return 2 if self.axisymmetric else self.gdim - 1

    @property
    def area(self) -> float:
        """Area (2D: length) of the whole surface. Collective."""
        return float(self.comm.allreduce(self.node_area.sum(), op=MPI.SUM))

    def create_vec(self) -> PETSc.Vec:
        """New zero vector with the layout of the body's unknowns. Collective."""
        index_map, bs = self.V.dofmap.index_map, self.V.dofmap.index_map_bs
        sizes = (index_map.size_local * bs, index_map.size_global * bs)
        return PETSc.Vec().createMPI(sizes, comm=self.comm)

    def function(self, values: npt.ArrayLike) -> fem.Function:
        """Function with given values at the contact nodes and zero elsewhere. Collective.

        Args:
            values: Values at the owned nodes, shape (nodes, block).

        Raises:
            ValueError: If ``values`` are not numbers, or of another shape.

        Returns:
            Function in V, collapsed if V is a sub-space.
        """
        with checked(self.comm):
            at_nodes = check_array("values", values, self.node_dofs.shape)
        index_map, bs = self.V.dofmap.index_map, self.V.dofmap.index_map_bs
        vector = la.vector(index_map, bs, dtype=np.float64)
        vector.array[:] = 0
        vector.array[self.node_dofs - index_map.local_range[0] * bs] = at_nodes
        vector.scatter_forward()
        if self._collapsed is None:
            out = fem.Function(self.V)
            out.x.array[:] = vector.array
        else:
            space, parent = self._collapsed
            out = fem.Function(space)
            out.x.array[:] = vector.array[parent]
        return out

    def vertex_function(self, values: npt.ArrayLike) -> fem.Function:
        """Function of degree 1 with given values at the contact nodes, zero at others. Collective.

        Args:
            values: Values at the owned nodes, shape (nodes,) for a scalar function, (nodes, gdim)
                for a vector function.

        Raises:
            ValueError: If ``values`` are not numbers, or of another shape.

        Returns:
            Lagrange function of degree 1; in V (collapsed if V is a sub-space) if V is a suitable
            space of degree 1, otherwise in a new space.
        """
        nodes = len(self.node_area)
        with checked(self.comm):
            shape = (nodes,) if np.ndim(values) == 1 else (nodes, self.gdim)
            at_nodes = check_array("values", values, shape)
        Q = self._vertex_space(at_nodes.ndim == 1)
        out = fem.Function(Q)
        block = block_of(Q)
        blocks = out.x.array.reshape(-1, block)
        blocks[self._node_unknowns(Q) // block] = at_nodes.reshape(nodes, block)
        out.x.scatter_forward()
        return out

    def _vertex_space(self, scalar: bool) -> fem.FunctionSpace:
        """Lagrange space of degree 1, scalar or of vectors. Collective at the first call."""
        if scalar == self.is_scalar and is_lagrange(self.collapsed_space, 1):
            return self.collapsed_space
        if scalar not in self._vertex_spaces:
            shape = () if scalar else (self.gdim,)
            self._vertex_spaces[scalar] = fem.functionspace(self.mesh, ("Lagrange", 1, shape))
        return self._vertex_spaces[scalar]

    def _node_unknowns(self, Q: fem.FunctionSpace) -> npt.NDArray[np.int32]:
        """First local unknowns of another space at the owned contact nodes."""
        known = self._unknowns_in
        if known is None or known[0] is not Q:
            index_map, bs = self.V.dofmap.index_map, self.V.dofmap.index_map_bs
            own = self.node_dofs[:, 0] - index_map.local_range[0] * bs
            self._unknowns_in = known = Q, first_vertex_unknowns(self.V, Q)[own]
        return known[1]

    def node_values(self, function: fem.Function) -> npt.NDArray[np.float64]:
        """Values at the owned contact nodes; the inverse of :meth:`function`.

        Args:
            function: Function in V (collapsed if V is a sub-space), or Lagrange function of degree
                1 on the same mesh: a vector such as ``Contact.traction`` or a scalar such as
                ``Contact.pressure``.

        Returns:
            Values of shape (nodes, block); shape (nodes,) for a scalar function on a surface with
            a vector space.

        Raises:
            TypeError: If ``function`` is not a Function.
            ValueError: If it is in another space.
        """
        check(FUNCTION, function=function)
        Q = function.function_space
        if self._is_own(Q):
            index_map, bs = self.V.dofmap.index_map, self.V.dofmap.index_map_bs
            values = function.x.array
            if self._collapsed is not None:
                values = np.zeros((index_map.size_local + index_map.num_ghosts) * bs)
                values[self._collapsed[1]] = function.x.array
            at_nodes = values[self.node_dofs - index_map.local_range[0] * bs]
            return np.asarray(at_nodes, dtype=np.float64)
        text = "function: must be in the space of the surface, or Lagrange of degree 1 on its mesh"
        block = block_of(Q)
        require(is_same(Q.mesh, self.mesh) and is_lagrange(Q, 1), text)
        require(block in ((1,) if self.is_scalar else (1, self.gdim)), text)
        at = self._node_unknowns(Q) // block
        out = np.asarray(function.x.array.reshape(-1, block)[at], dtype=np.float64)
        return out[:, 0] if block == 1 and not self.is_scalar else out

    def _is_own(self, Q: fem.FunctionSpace) -> bool:
        """Whether Q is V (collapsed if V is a sub-space), or has the same unknowns."""
        own = self.collapsed_space
        if trace_degree(Q) != self.degree:
            return False
        sizes = [(m.size_local, m.num_ghosts) for m in (Q.dofmap.index_map, own.dofmap.index_map)]
        return sizes[0] == sizes[1] and Q.dofmap.index_map_bs == self.block

    @functools.cached_property
    def _collapsed(self) -> tuple[fem.FunctionSpace, npt.NDArray[np.int64]] | None:
        """Collapsed space and its map if V is a sub-space. Collective at the first call."""
        if not is_sub_space(self.V):
            return None
        return collapse(self.V)

    @property
    def collapsed_space(self) -> fem.FunctionSpace:
        """V, or the collapsed space if V is a sub-space. Collective."""
        return self.V if self._collapsed is None else self._collapsed[0]

    def collapsed_vec(self, vec: PETSc.Vec) -> PETSc.Vec:
        """New vector of the collapsed space with the values of a vector of V. Collective."""
        if self._collapsed is None:
            return vec.copy()
        space, parent = self._collapsed
        index_map, bs = space.dofmap.index_map, space.dofmap.index_map_bs
        owned = index_map.size_local * bs
        out = PETSc.Vec().createMPI((owned, index_map.size_global * bs), comm=self.comm)
        out.array[:] = vec.array_r[parent[:owned]]
        return out

    def nodal_vec(self, values: npt.ArrayLike) -> PETSc.Vec:
        """New vector of the body with given values at the contact nodes. Collective.

        Args:
            values: Nodal values, shape (nodes, block); interpolated linearly between nodes if the
                trace has degree 2.
        """
        out = self.create_vec()
        if self.degree == 1:
            out.array[self.node_dofs - out.owner_range[0]] = values
            return out
        interpolated = fem.Function(self.collapsed_space)
        interpolated.interpolate(self.linear.function(values))
        index_map, bs = self.collapsed_space.dofmap.index_map, self.collapsed_space.dofmap.bs
        owned = index_map.size_local * bs
        to = slice(None) if self._collapsed is None else self._collapsed[1][:owned]
        out.array[to] = interpolated.x.array[:owned]
        return out

    @property
    def linear(self) -> Surface:
        """Surface of the same facets with a space of degree 1, perhaps this one. Collective."""
        if self.degree == 1:
            return self
        if self._linear is None:
            shape = () if self.is_scalar else (self.gdim,)
            V = fem.functionspace(self.mesh, ("Lagrange", 1, shape))
            self._linear = Surface(V, facets=self.facets, axisymmetric=self.axisymmetric)
            if self._key is not None:
                self._linear.touch_itself(self._key)
        return self._linear

    def update(self) -> None:
        """Read the mesh coordinates again, after the mesh has moved. Collective.

        Raises:
            ValueError: If coordinates are not finite or a facet has no area.
        """
        update_surfaces(self)


def update_surfaces(*surfaces: Surface) -> None:
    """Read the mesh coordinates of several surfaces again; on an error, of none. Collective.

    Raises:
        ValueError: If coordinates are not finite or a facet has no area.
    """
    new = []
    for surface in surfaces:
        with collective_errors(surface.comm):
            new.append(surface._layout.checked_coordinates(surface.mesh))
    for surface, coordinates in zip(surfaces, new, strict=True):
        surface.coordinates = coordinates
