"""Planted faults change one line each, which exists, and name tests that exist."""

import pathlib

from planted_faults import FAULTS

ROOT = pathlib.Path(__file__).resolve().parents[2]


def test_lines_and_tests():
    wrong = []
    for fault in FAULTS:
        count = (ROOT / fault.file).read_text().count(fault.old)
        wrong += [f"{fault.name}: {count} lines"] * (count != 1)
        for test in fault.tests:
            path, _, name = test.partition("::")
            there = (ROOT / path).is_file() and f"def {name}" in (ROOT / path).read_text()
            wrong += [f"{fault.name}: no {test}"] * (not there)
    assert not wrong
