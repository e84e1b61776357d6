"""Check for soft penalties of quasi-symmetric contact with nodal quadrature on a fine slave."""

from __future__ import annotations

import math

from qsdolfinx.contact.advice import local_sizes
from qsdolfinx.contact.contact_type import ContactType
from qsdolfinx.contact.findings import Check
from qsdolfinx.contact.model import ContactModel

#: Facet size of the slave over that of the master below which each master node has the area of
#: several slave nodes. A ratio of three quarters does no harm, a half does.
COARSE_MASTER = 0.6

#: Penalty over the stiffness of the softer side above which gaps are too small for spikes to
#: matter. With a tenth, tractions have spikes.
STIFF = 10.0


def find_spikes(model: ContactModel) -> str | None:
    """Warning about spikes that a soft penalty will leave, or None. Collective.

    A node of a coarse master adds the gap of its whole area to the few slave nodes of the facet
    opposite to it, and nothing to the nodes around. The gaps of slave nodes, and with a penalty
    their pressures and friction, are therefore too large or too small by the ratio of the areas. A
    stiff penalty or an augmented Lagrangian compensates for this by making the gaps small.
    """
    settings, penalty = model.settings, model.penalty
    nodal = settings.sampling.quadrature == "nodal"
    if not nodal or model.augmented or settings.formulation != "quasi-symmetric":
        return None
    stiffness = min(penalty.stiffness)
    if penalty.eps >= STIFF * stiffness or not math.isfinite(stiffness):
        return None
    sizes = local_sizes(model)
    if sizes is None or sizes[0] >= COARSE_MASTER * sizes[1]:
        return None
    return (
        f"quadrature: in the contact zone the slave's facets ({sizes[0]:.3g}) are smaller than the "
        f"master's ({sizes[1]:.3g}); with nodal quadrature, a penalty of "
        f"{penalty.eps / stiffness:.2g} times the stiffness of the softer side then causes spikes "
        "of pressure and friction on the slave: "
        'use quadrature="overlay", or penalty="auto", or swap slave and master'
    )


#: The check, run when the stiffness of the bodies is known.
SPIKES = Check("soft penalty at nodes", find_spikes, ContactType.BODIES)
