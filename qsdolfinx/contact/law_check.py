"""Check signs and slopes of a user's law once, before the first solve."""

from __future__ import annotations

from qsdolfinx.contact.findings import tell
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.gap import law_samples
from qsdolfinx.gap.laws import BUILT_IN


def check_law(model: ContactModel) -> None:
    """Warn if signs or slopes of a user's law are wrong, the first time. Collective.

    Args:
        model: The contact; its penalty is known.
    """
    if model.is_law_checked or type(model.law) in BUILT_IN:
        return
    model.is_law_checked = True
    size, eps = model.settings.largest_facet, model.penalty.eps
    samples = law_samples.sampled(model.law, eps, size, model.slave.gdim)
    found = None if samples is None else law_samples.fault(model.law, samples)
    for text in model.comm.allgather(found):
        if text is not None:
            tell(model, "wrong law", f"law: {text}")
            return
