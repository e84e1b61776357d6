"""Choose which cases of a test run after each change, and with how many ranks."""

import itertools
import pathlib
import zlib


def indices(item):
    """Return the index of each parameter's value in a case, by the name of the parameter."""
    return item.callspec.indices if hasattr(item, "callspec") else {}


def chosen(cases):
    """Return the indices of the cases of one test that run after each change.

    For a product of two lists of parameters, every value occurs; for three and more lists, every
    pair of values occurs. A single list runs completely.

    Args:
        cases: Results of ``indices`` for each case.
    """
    columns = {tuple(case[name] for case in cases) for name in cases[0]}
    columns = sorted(column for column in columns if len(set(column)) > 1)
    if len(columns) < 2:
        return range(len(cases))
    places = list(itertools.combinations(range(len(columns)), min(2, len(columns) - 1)))
    has = [{(c, tuple(columns[k][i] for k in c)) for c in places} for i in range(len(cases))]
    left, kept = set().union(*has), []
    while left:
        best = max(range(len(cases)), key=lambda i: len(has[i] & left))
        kept.append(best)
        left -= has[best]
    return sorted(kept)


#: Slow tests, or cases of tests, whose behaviour quicker tests check too: marked ``long`` as well.
SLOW = (
    "base/test_reliability.py::test_full_disk",
    "base/test_reliability.py::test_no_communicator_on_one_rank[no_unknowns-2]",
    "friction/test_dissipation.py::test_energy_balance_of_sliding[penalty]",
    "linear/test_inexact_solves.py::test_active_sets_that_change",
    "linear/test_rescue.py::test_rotation_of_a_quadratic_block",
    "linear/test_soft_motions.py::test_blocks[fieldsplit]",
    "problems/test_engineering_1.py::test_limits[gear_pair]",
    "problems/test_engineering_2.py::test_stl_forging",
    "problems/test_forging.py::test_every_formulation",
    "problems/test_hertz.py::test_cylinders",
    "problems/test_plots.py::test_forging_animated",
    "problems/test_plots.py::test_picture[ironing]",
    "problems/test_plots.py::test_picture[sliding_wedge]",
    "problems/test_shaft.py::test_direction",
    "problems/test_upsetting.py",
    "sliding/test_finite_steps.py::test_bodies_in_velocities[True]",
    "solve/test_lost.py::test_ring_between_blocks_stays",
    "solve/test_press_again.py::test_billet[augmented-lagrangian-0.2",
    "steps/test_friction_restart.py::test_goes_on_as_if_uninterrupted[corner",
    "test_plasticity.py::test_energy[3D]",
    "test_plasticity.py::test_from_the_deformed_mesh[3D]",
    "test_plasticity.py::test_goes_on_from_a_checkpoint[True]",
)

#: Folders of tests that need one rank: they read files, run scripts of one rank, or start programs.
ALONE = ("bench", "project")
#: Out of forty tests, numbers that `make test` runs with 1, 2 and 3 ranks. A test with 2 ranks
#: takes some four times as long as with 1, where two tests run at a time.
DEAL = (36, 3, 1)
#: The same out of five tests that only several ranks can fail.
SEVERAL = (0, 3, 2)


def is_slow(item):
    """Return whether a test is in SLOW."""
    return item.nodeid.removeprefix("tests/").startswith(SLOW)


def needs_several(item):
    """Return whether a test is marked for several ranks."""
    return any(item.get_closest_marker(mark) for mark in ("several_ranks", "parallel"))


def ranks_of(item):
    """Return the number of ranks with which `make test` runs a test; only its name decides."""
    folder, name = pathlib.Path(item.path).parent.name, item.name.partition("[")[0]
    if folder in ALONE or item.get_closest_marker("one_rank"):
        return 1
    several = needs_several(item) or "ranks" in name
    if folder == "problems":  # demos, which take long
        return 2 if several else 1
    shares = SEVERAL if several else DEAL
    place = zlib.crc32(item.nodeid.encode()) % sum(shares)
    return next(n for n, end in enumerate(itertools.accumulate(shares), 1) if place < end)
