"""Run hard cases with every variant: some after each change, the rest with ``-m long``."""

import collections
import zlib

import pytest
from hard import lost_and_found, motion
from hard.cases import SHORT, Variant, run
from hard.table import cases
from scenes import WORLD, spread_cells

#: One out of this many short cases runs after each change: each case with some of its variants.
EVERY = 4


def parameters():
    """Yield all cases."""
    counts = collections.Counter()
    for case, variant in cases():
        name = f"{case.name}, {case.label}"
        order = counts[name] + zlib.crc32(name.encode())  # cases begin with different variants
        counts[name] += case.short
        runs = case.short and order % EVERY == 0
        yield pytest.param(
            case, variant, id=f"{name}, {variant}", marks=[] if runs else [pytest.mark.long]
        )


@pytest.fixture(autouse=True)
def scattered(monkeypatch):
    """Both sides of a pair are on all ranks, in small parts."""
    with spread_cells(monkeypatch, "scattered"):
        yield


@pytest.mark.parametrize(("case", "variant"), parameters())
def test_case(case, variant):
    """The result is right, or refused as required, or its failure is known."""
    result = run(case, variant)
    assert result.expected != bool(case.known), result


@pytest.mark.parametrize("variant", SHORT, ids=str)
def test_cycles(variant):
    """Run five of the hundred load cycles."""
    assert lost_and_found.cycles(variant, 5) < 1e-8


def test_sliding():
    """Run 8 facets of the 50."""
    assert max(WORLD.allgather(motion.slide(Variant(), 8))) < 1e-6
