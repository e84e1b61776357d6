"""Soft penalties of quasi-symmetric contact at the nodes of a slave that is the finer side."""

from __future__ import annotations

import math

from qsdolfinx.contact.advice import local_sizes
from qsdolfinx.contact.findings import Check
from qsdolfinx.contact.model import ContactModel

#: Facet size of the slave over the master's below which the master's nodes stand for the area of
#: several nodes of the slave. Three quarters do no harm, a half does.
COARSE_MASTER = 0.6

#: Penalty over the stiffness of the softer side from which on gaps are too small for it to matter.
STIFF = 10.0


def find_spikes(model: ContactModel) -> str | None:
    """What to say of spikes that a soft penalty will leave. Collective.

    A node of a coarse master adds the gap of all the area that it stands for to the few slave nodes
    of the facet that it is on, and nothing to those around: their gaps, and pressures and friction
    by a penalty, are too large or too small by the ratio of the areas. What makes the gaps small,
    a stiff penalty or an augmented Lagrangian, makes up for it.
    """
    settings, penalty = model.settings, model.penalty
    nodal = settings.sampling.quadrature == "nodal"
    if not nodal or model.is_scalar or model.augmented or settings.formulation != "quasi-symmetric":
        return None
    stiffness = min(penalty.stiffness)
    if penalty.eps >= STIFF * stiffness or not math.isfinite(stiffness):
        return None
    sizes = local_sizes(model)
    if sizes is None or sizes[0] >= COARSE_MASTER * sizes[1]:
        return None
    return (
        f"quadrature: where they meet the slave's facets ({sizes[0]:.3g}) are smaller than the "
        f"master's ({sizes[1]:.3g}); at nodes a penalty of {penalty.eps / stiffness:.2g} times the "
        "stiffness of the softer side then leaves spikes of pressure and friction on the slave: "
        'use quadrature="overlay", or penalty="auto", or swap slave and master'
    )


#: The check, made when the bodies' stiffness is known.
SPIKES = Check("soft penalty at nodes", find_spikes)
