"""Running a check, and the table of what came out."""

import dataclasses
import gc
import typing
import warnings

from petsc4py import PETSc

from hard.scenes import Check, Variant, Wrong

import qsdolfinx as qs

TWO_PASSES = ("double-pass", "two-half-pass")


@dataclasses.dataclass
class Row:
    """What came out of a check with a variant.

    Attributes:
        status: ``"right"``; ``"refused"``: an error was raised and the state is that before;
            ``"warned"``: the forces of the two sides differ, and a warning says so; or ``"wrong"``:
            an answer is off by more than is allowed.
    """

    STATUSES: typing.ClassVar = ("right", "refused", "warned", "wrong")

    check: Check
    variant: Variant
    status: str
    error: float | None
    iterations: int | None
    message: str

    def line(self):
        error = "" if self.error is None else f"{self.error:.1e}"
        iterations = "" if self.iterations is None else self.iterations
        case = f"{self.check.case}: {self.check.label}"
        found = f"{self.status:8}{iterations:>5} {error:>8} {self.check.what}"
        return f"{case:58} {self.variant!s:48} {found} {self.message[:90]}"

    @property
    def expected(self):
        """Whether this is what has to come out."""
        return self.status == ("refused" if self.check.refusal else "right")

    def as_dict(self):
        check = self.check
        found = {"case": check.case, "label": check.label, **self.variant._asdict()}
        found |= {"converged": self.error is not None, "iterations": self.iterations}
        found |= {"what": check.what, "error": self.error, "allowed": check.allowed}
        return found | {"status": self.status, "message": self.message}


def run(check, variant):
    """Run a check; what it raises goes into the row, unless it is not qsdolfinx's to raise."""
    error = iterations = None
    message = ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", qs.BalanceWarning)
            error, iterations = check.run()
        status = "right" if error <= check.allowed and not check.refusal else "wrong"
        if check.refusal:
            message = "should have been refused"
    except qs.BalanceWarning as raised:
        status, message = "warned", str(raised)
    except (qs.ConvergenceError, qs.StepError, ValueError, RuntimeError) as raised:
        status, message = "refused", str(raised)
        if check.refusal and check.refusal not in message:
            status = "wrong"
    except (Wrong, AssertionError) as raised:
        status, message = "wrong", str(raised)
    gc.collect()
    PETSc.garbage_cleanup()
    return Row(check, variant, status, error, iterations, message)


def write(rows):
    """The Markdown of the results: a line for each check, then what is not as it should be."""
    lines = [
        "",
        "Written by `python3 tests/hard/run.py --markdown docs/hard-cases.md`. A line stands for",
        f"{len({row.variant for row in rows})} variants, formulation × quadrature × enforcement:",
        "how many give the right answer, the largest error (and what it may be) over these, and",
        "their most Newton iterations, over all solves of a case. Variants that are refused, with",
        "the unknowns as they were before, or wrong, are listed below the table.",
        "",
        "| case | | right | error | allowed | Newton |",
        "|---|---|---|---|---|---|",
    ]
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.check.case, row.check.label), []).append(row)
    last = None
    for (case, label), group in groups.items():
        lines.append(_line(case if case != last else "", label, group))
        last = case
    lines += ["", "### Not as they should be", ""]
    lines += _warned(rows)
    lines += [line for group in groups.values() for line in _exceptions(group)]
    return "\n".join(lines) + "\n"


def _line(case, label, group):
    good = [row for row in group if row.expected]
    errors = [row.error for row in good if row.error is not None]
    counts = [row.iterations for row in good if row.iterations is not None]
    what = sorted({row.check.what for row in group}, key=lambda w: -len(w))[0]
    error = f"{max(errors):.1e} ({what})" if errors else ""
    allowed = f"{max(row.check.allowed for row in group):.0e}" if errors else ""
    verb = " refused" if group[0].check.refusal else ""
    count = f"{len(good)} of {len(group)}{verb}"
    return f"| {case} | {label} | {count} | {error} | {allowed} | {max(counts, default='')} |"


def _warned(rows):
    """A line for the cases in which the forces of the two sides differ."""
    cases: dict[str, int] = {}
    for row in rows:
        if row.status == "warned":
            name = f"{row.check.case}, {row.check.label}"
            cases[name] = cases.get(name, 0) + 1
    if cases:
        count = len({row.variant for row in rows if row.variant.formulation == "two-half-pass"})
        yield (
            "- **two-half-pass** does not balance the forces of both sides; where they differ by "
            "more than a tenth, `BalanceWarning` says so. Here, in so many of its "
            f"{count} variants: " + "; ".join(f"{name} ({n})" for name, n in cases.items()) + "."
        )


def _exceptions(group):
    """Lines for the variants of a check that are not as they should be, alike ones together."""
    found: dict[str, list[Row]] = {}
    for row in group:
        if not row.expected and row.status != "warned":
            found.setdefault(f"{row.status}: {_short(row)}", []).append(row)
    for text, rows in found.items():
        check, variants = rows[0].check, "; ".join(str(row.variant) for row in rows)
        errors = [row.error for row in rows if row.error is not None]
        worst = f" {max(errors):.1e} ({check.what})" if errors else ""
        why = "".join(sorted({f" {reason(row)}" for row in rows if reason(row)}))
        yield f"- **{check.case}, {check.label}** ({variants}): {text}{worst}.{why}"


def _short(row):
    return row.message.split("; residuals")[0].removesuffix(".")


def reason(row):
    """Why, where it is known."""
    if "GAP_NOT_CLOSED" in row.message and row.variant.formulation in TWO_PASSES:
        return (
            "Multipliers on both sides cannot close every gap between meshes that do not match, "
            "see [method.md](method.md): use a penalty, or a moderate `gap_tolerance`."
        )
    if row.variant.quadrature == "nodal" and row.check.case == "2 meshes":
        return (
            "A master that is much finer than the slave is dented between the slave's nodes, where "
            "nothing presses on it: use the overlay, or make the finer body the slave."
        )
    if row.variant.formulation == "double-pass" and row.variant.augmented:
        return "Multipliers on both sides of an edge are not determined: use a penalty."
    if row.variant.formulation == "master-slave" and row.check.case == "8 edges":
        return "It is right with bisectors, the overlay's default normals."
    if row.variant.formulation == "master-slave" and row.check.case == "9 motion":
        return (
            "Small; probably the choice between the two facets beside a vertex on which a node "
            "comes to lie."
        )
    if row.variant.formulation == "two-half-pass":
        return "Each side has multipliers of its own: forces agree as far as gaps do."
    return ""
