"""A line of the table of docs/verified.md: a quantity, what others give for it, and ours."""

import dataclasses


@dataclasses.dataclass(frozen=True)
class Row:
    """One quantity of a case.

    Attributes:
        quantity: What it is, with its unit.
        reference: Value given by others.
        ours: Value computed here.
        scatter: How far apart the reference's own sources are, or its tolerance, relative; 0 of
            closed forms.
        source: Where the reference is from: "closed form", a test's number, a paper.
        of: What differences are relative to, by default the reference.
    """

    quantity: str
    reference: float
    ours: float
    scatter: float
    source: str
    of: float | None = None

    @property
    def difference(self) -> float:
        """Ours less the reference, relative."""
        return (self.ours - self.reference) / abs(self.of or self.reference)
