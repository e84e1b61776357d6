"""Whether steps swing: contact pairs where bodies are expected, and answers by missing that place.

Contact pairs where the last step's rate leads to, and the solution depends on where that is: on the
normals there, above all. A change e of the expected place may change the solution by s e, s < 0,
since turned normals push surfaces back. From step to step, errors then obey

    e_{n+1} = s (2 e_n - e_{n-1}),

and grow with changing signs where s < -1/3, however small the steps are. Paired once more where the
solution is, they are multiplied by s once more.
"""

from __future__ import annotations

import typing

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from qsdolfinx.steps.mesh_motion import MeshMotion

Array = npt.NDArray[np.float64]

#: Least part of a step's motion that counts, that of the step before which is no rounding, and
#: largest cosine of what has changed its sign.
NOTICED, NO_ROUNDING, TURNED = 1e-3, 1e-8, -0.5


def swings(
    motions: typing.Sequence[MeshMotion],
    missed: typing.Sequence[Array],
    before: typing.Sequence[Array],
    moved: typing.Sequence[Array],
) -> bool:
    """Whether the place that was expected was missed to the other side this time. Collective.

    Args:
        motions: Of the bodies.
        missed: By how much their unknowns have missed it.
        before: The same of the step before.
        moved: Change of place in this step, in the same unit.
    """
    products = np.zeros(4)
    for motion, now, last, way in zip(motions, missed, before, moved, strict=True):
        owned = motion.mesh.geometry.index_map().size_local
        a, b, c = (motion.values(x)[:owned] for x in (now, last, way))
        products += np.sum(a * b), np.sum(a * a), np.sum(b * b), np.sum(c * c)
    motions[0].mesh.comm.Allreduce(MPI.IN_PLACE, products, op=MPI.SUM)
    both, now_, last_, way_ = products
    if not (now_ > NOTICED**2 * way_ and last_ > NO_ROUNDING**2 * way_):
        return False
    return bool(both < TURNED * np.sqrt(now_ * last_))
