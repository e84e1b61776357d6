"""Multipliers of nodes that the other surface covers by less than half of their area."""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

import qsdolfinx._cpp as _cpp
from qsdolfinx.surface.patches import patches_of_facets
from qsdolfinx.surface.surface import Surface

Array = npt.NDArray[np.float64]

#: Part l of the area of a node's smooth patch. If less of it is covered, the multiplier is
#: regularised by the area that is missing. With a tenth, multipliers at the end of the other
#: surface grow to twenty times the mean pressure; with the whole, nodes there bear too little.
ENOUGH = 0.5
#: Part of the means by which they are too small, so that multipliers fall to 0 far from covered
#: nodes: if nothing is covered, they are determined.
DECAY = 1e-9


class NeighbourMeans:
    """Means M λ of multipliers over the other vertices of the facets at each node.

    With the covered area c_k of a node's smooth patch and a part l of its area S_k,

        (R_λ)_k ← (R_λ)_k − a s_k (λ_k − (M λ)_k)/γ,   s_k = [l S_k − c_k]₊,

    where s_k is the area that is missing. The multiplier of a node that is hardly covered
    approaches the mean of its neighbours as its cover vanishes. Those of nodes that are not covered
    continue the others. All terms change continuously as bodies slide.

    Collective.

    Args:
        slave: Surface that carries the multipliers.
    """

    def __init__(self, slave: Surface) -> None:
        self._slave = slave
        corners = patches_of_facets(slave)
        here, there = np.nonzero(~np.eye(corners.shape[1], dtype=bool))
        ones, scale = slave.create_vec(), slave.create_vec()
        num = ones.getLocalSize()
        #: M on the unknowns of the slave that represent patches.
        self.matrix = PETSc.Mat().create(comm=slave.comm)
        self.matrix.setSizes(((num, PETSc.DETERMINE),) * 2)
        self.matrix.setType(PETSc.Mat.Type.AIJ)
        places = (np.ascontiguousarray(corners[:, i].ravel()) for i in (here, there))
        _cpp.set_places(self.matrix.handle, *places)
        _cpp.set_values(self.matrix.handle, np.ones(len(corners) * len(here)))
        ones.set(1.0)
        self.matrix.mult(ones, scale)
        counts = scale.array_r.copy()
        part = 1 - DECAY
        scale.array[:] = np.divide(part, counts, out=np.zeros_like(counts), where=counts > 0)
        self.matrix.diagonalScale(scale)
        for vec in (ones, scale):
            vec.destroy()

    def of(self, values: Array) -> Array:
        """M times values of the patches of owned nodes, (nodes, block). Collective."""
        vec, out = self._slave.create_vec(), self._slave.create_vec()
        at = self._slave.node_dofs - vec.owner_range[0]
        vec.array[at] = values
        self.matrix.mult(vec, out)
        means: Array = out.array_r[at].copy()
        for thing in (vec, out):
            thing.destroy()
        return means
