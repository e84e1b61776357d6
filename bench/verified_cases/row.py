"""Define a row of the tables of docs/verified.md: a quantity, its reference and our value."""

import dataclasses


@dataclasses.dataclass(frozen=True)
class Row:
    """One quantity of a case.

    Attributes:
        quantity: Name of the quantity, with its unit.
        reference: Value given by the source.
        ours: Value computed here.
        scatter: Relative scatter of the sources of the reference, or its tolerance; 0 for closed
            forms.
        source: Source of the reference: "closed form", the number of a test, a paper.
        of: Value that differences are relative to, by default the reference.
    """

    quantity: str
    reference: float
    ours: float
    scatter: float
    source: str
    of: float | None = None

    @property
    def difference(self) -> float:
        """Relative difference of our value from the reference."""
        return (self.ours - self.reference) / abs(self.of or self.reference)
