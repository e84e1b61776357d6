"""Transfer values at the nodes of an old contact surface to a new surface."""

from __future__ import annotations

import typing

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.gap.weighted_gap import KINDS
from qsdolfinx.pairing.pair import NORMALS, overlay_rules
from qsdolfinx.surface.surface import Coordinates, Surface

Array = npt.NDArray[np.float64]


class SurfaceValues(typing.NamedTuple):
    """Nodal values of a surface, with the position of the surface when they were read.

    Attributes:
        surface: The surface, of degree 1.
        coordinates: Its position.
        values: At the owned nodes, shape (nodes, n).
    """

    surface: Surface
    coordinates: Coordinates
    values: Array

    @classmethod
    def of(cls, surface: Surface, values: Array) -> SurfaceValues:
        """Values of a surface at the position where it was read last. Collective at first."""
        linear = surface.linear
        return cls(linear, linear.coordinates, values)

    def on(self, new: Surface) -> Array:
        """Means of the values, weighted by the shape functions N_k of another surface. Collective.

        v_k = ∫ N_k v / ∫ N_k over the common part of both surfaces, on the overlay of their facets.
        This keeps ∫ v up to rounding errors if the whole new surface lies on the old one. Nodes
        without any part of the old surface have 0.

        Args:
            new: The surface.

        Returns:
            At the owned nodes, shape (nodes, n).
        """
        new = new.linear
        if self._is(new):
            return self.values.copy()
        mirror = self._mirror()
        size = max(self.surface.facet_size_range[1], new.facet_size_range[1])
        degree = 2 * new.shape_degree(1) + new.area_degree
        points = _cpp.overlay_surfaces(
            new.cpp_object,
            mirror,
            False,
            _cpp.SearchRadius(size),
            NORMALS.index("facet"),
            *overlay_rules(new.gdim, degree),
        )
        operator = _cpp.GapOperator(
            new.cpp_object, mirror, points, jump=True, rows=KINDS.index("cover")
        )
        block, count = new.block, self.values.shape[1]
        out = np.zeros((len(new.node_area), count))
        nothing = new.create_vec()
        for first in range(0, count, block):
            columns = self.values[:, first : first + block]
            width = columns.shape[1]
            vec = self.surface.nodal_vec(np.pad(columns, ((0, 0), (0, block - width))))
            means = -operator.apply(nothing.handle, vec.handle)
            out[operator.row_node, first : first + width] = means[:, :width]
            vec.destroy()
        nothing.destroy()
        return out

    def _is(self, new: Surface) -> bool:
        """Whether the other surface is made of the same facets, on all ranks. Collective."""
        old = self.surface
        same = old.mesh is new.mesh and np.array_equal(old.facets, new.facets)
        same = same and len(new.node_area) == len(self.values)
        return bool(min(new.comm.allgather(same)))

    def _mirror(self) -> _cpp.Surface:
        """The old facets with reversed orientation, so that they face the new ones. Collective."""
        old = self.surface
        x, inside, _ = self.coordinates
        dofs, owner = old.trace_dofs
        index_map, bs = old.V.dofmap.index_map, old.V.dofmap.index_map_bs
        return _cpp.Surface(
            comm=old.comm.py2f(),
            gdim=old.gdim,
            block=old.block,
            num_vertices=old.num_facet_vertices,
            x=x,
            degree=1,
            dofs=dofs,
            owner=owner,
            inside=np.ascontiguousarray(2 * x.mean(axis=1) - inside),
            local_size=index_map.size_local * bs,
            axisymmetric=old.axisymmetric,
            key=None,
        )
