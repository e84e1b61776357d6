"""Groups of residual rows with the same unit: forces, and constraints such as ∇·v = 0."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dolfinx import fem

from qsdolfinx.surface.unknowns import is_vertex_vector

Indices = npt.NDArray[np.int32]


def groups(V: fem.FunctionSpace) -> list[Indices]:
    """Owned unknowns of each part of a mixed space, displacements first.

    In a space that is not mixed, all unknowns are in one group.
    """
    owned = V.dofmap.index_map.size_local * V.dofmap.index_map_bs
    if V.num_sub_spaces == 0 or V.dofmap.bs > 1:
        return [np.arange(owned, dtype=np.int32)]
    parts = [V.sub(i) for i in range(V.num_sub_spaces)]
    if not any(map(is_vertex_vector, parts)):
        return [np.arange(owned, dtype=np.int32)]
    parts.sort(key=lambda part: not is_vertex_vector(part))
    dofs = [np.unique(part.dofmap.list).astype(np.int32) for part in parts]
    return [one[one < owned] for one in dofs]
