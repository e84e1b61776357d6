"""Detect time steps that oscillate because of contact detection at predicted positions.

Contact detection uses the positions predicted by the last step's rate, and the solution depends on
these positions, mainly through the normals. A change e of the predicted position may change the
solution by s e, s < 0, since rotated normals push surfaces back. From step to step, the errors then
obey

    e_{n+1} = s (2 e_n - e_{n-1}),

and grow with alternating signs if s < -1/3, however small the steps are. If the contact pairs are
updated once more at the solution, the errors are multiplied by s once more.
"""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.base.rounding import SOLVED
from qsdolfinx.steps.mesh_motion import MeshMotion
from qsdolfinx.steps.prediction import NOTHING

Array = npt.NDArray[np.float64]


def swings(
    motions: typing.Sequence[MeshMotion],
    missed: typing.Sequence[Array],
    before: typing.Sequence[Array],
    moved: typing.Sequence[Array],
) -> bool:
    """Whether the error of the predicted position has changed its sign. Collective.

    Args:
        motions: Mesh motions of the bodies.
        missed: Difference between the unknowns and the predicted positions.
        before: The same difference in the step before.
        moved: Motion in this step, in the same unit.
    """
    products = np.zeros(4)
    for motion, now, last, way in zip(motions, missed, before, moved, strict=True):
        owned = motion.mesh.geometry.index_map().size_local
        a, b, c = (motion.values(x)[:owned] for x in (now, last, way))
        products += np.sum(a * b), np.sum(a * a), np.sum(b * b), np.sum(c * c)
    motions[0].mesh.comm.Allreduce(MPI.IN_PLACE, products, op=MPI.SUM)
    both, now_, last_, way_ = products
    if not (now_ > NOTHING**2 * way_ and last_ > SOLVED**2 * way_):
        return False
    return bool(both < -0.5 * np.sqrt(now_ * last_))
