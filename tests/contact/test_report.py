"""Report of a contact, log lines of a solve, and the progress bar."""

import io
import logging
import sys
import warnings

import numpy as np
import pytest
from scenes import CELLS, WORLD, Pair, raises_everywhere
from step_scenes import Upset

import qsdolfinx as qs
from qsdolfinx.base import messages


def report_of(pair):
    """Return the report; it is the same on all ranks, and its table fits a screen."""
    report = pair.contact.report()
    same = WORLD.allgather(report) == [report] * WORLD.size
    lines = str(report).splitlines()
    assert same and len(lines) <= 20 and max(map(len, lines)) < 130
    return report


@pytest.mark.parametrize("cell", CELLS)
def test_geometry(cell):
    """The report has nodes, facets and areas of two blocks with 6 and 4 cells along an edge."""
    pair = Pair(cell, n=(6, 4), gap=0.02, contact_options={"quadrature": "nodal"})
    report, dim = report_of(pair), pair.gdim - 1
    diagonal = 2**0.5 if dim == 2 else 1
    for side, n in ((report.slave, 4), (report.master, 6)):
        assert (side.nodes, side.found, side.missed) == ((n + 1) ** dim, (n + 1) ** dim, 0)
        assert np.allclose([*side.facet_sizes, side.area], [diagonal / n, diagonal / n, 1])
    assert report.points == 5**dim + 7**dim and report.rows == 5**dim
    assert np.isclose(report.covered, 1) and report.missed_facets == 0
    gap = pair.contact.weighted_gap()
    assert report.gap == (-largest_of(-gap), largest_of(gap)) and report.overclosure == 0
    assert -0.024 < report.gap[0] < -0.02 < report.gap[1] < -0.016  # see (12): not Σ w_p N_k
    assert report.search_radius == max(report.slave.facet_sizes)


def test_what_is_missed():
    """The upper block overhangs by half: its nodes and facets there find no partner."""
    for quadrature, formulation in (
        ("nodal", "master-slave"),
        ("nodal", "double-pass"),
        ("overlay", "master-slave"),
        ("overlay", "quasi-symmetric"),
    ):
        pair = Pair("quadrilateral", formulation, n=(8, 4))
        pair.meshes[1].geometry.x[:, 0] += 0.5
        pair.contact = qs.Contact(
            pair.slave, pair.master, formulation=formulation, penalty=3.0, quadrature=quadrature
        )
        pair.contact.update()
        report = report_of(pair)
        # Nodes at 0.5, 0.75, 1 and their neighbours: on the overlay only nodes that share a facet.
        assert (report.slave.found, report.slave.missed) == (3, 2)
        both = {"double-pass": (5, 4)}.get(formulation)
        assert (report.master.found, report.master.missed) == (both or (None, None))
        # With nodal quadrature the node at the rim stands for half a facet beyond it.
        assert np.isclose(report.covered, 0.5 if quadrature == "overlay" else 0.625)
        missed = {"master-slave": 2, "quasi-symmetric": 2 + 4}.get(formulation, 0)
        assert report.missed_facets == (missed if quadrature == "overlay" else 0)


@pytest.mark.filterwarnings("ignore:quadrature")
def test_unloaded_nodes():
    """Unloaded, or unpaired, are nodes of a finer master without a slave node nearby.

    On the overlay there are none.
    """
    for formulation, quadrature, n, expected in (
        ("master-slave", "nodal", (12, 4), 8),
        ("master-slave", "nodal", (4, 12), 0),
        ("master-slave", "overlay", (12, 4), 0),
        ("quasi-symmetric", "nodal", (12, 4), 0),
        ("double-pass", "nodal", (12, 4), 0),
    ):
        options = {"contact_options": {"quadrature": quadrature}}
        pair = Pair("triangle", formulation, n=n, **options)
        pair.problem().solve()
        report = report_of(pair)
        force = np.linalg.norm(pair.master.node_values(pair.contact.traction("master")), axis=1)
        bare = WORLD.allreduce(int(np.count_nonzero(force < 1e-12)))
        status = pair.contact.status("master")
        owned = status.function_space.dofmap.index_map.size_local
        on_surface = np.isclose(status.function_space.tabulate_dof_coordinates()[:owned, 1], 0.0)
        unpaired = np.count_nonzero(status.x.array[:owned][on_surface] == qs.Status.UNPAIRED)
        assert report.unloaded == expected == bare == WORLD.allreduce(unpaired)
        assert ("swap" in str(report)) == (expected > 0)


@pytest.mark.parametrize("enforcement", ("penalty", "augmented-lagrangian"))
@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
def test_after_a_solve(quadrature, enforcement):
    """The report has the gaps, active and slipping constraints of the contact, and its penalty."""
    more = {"quadrature": quadrature, "enforcement": enforcement, "friction": qs.Coulomb(0.1)}
    more["constraints"] = "nodes"
    pair = Pair("triangle", penalty="auto", n=(6, 4), wave=0.05, load=-0.005, contact_options=more)
    before = report_of(pair)
    assert before.penalty is None and before.active is None and before.stiffness_ratio is None
    assert "first solve" in before.penalty_source
    pair.problem().solve()
    report, contact = report_of(pair), pair.contact
    gap = contact.weighted_gap()
    low, high = largest_of(-gap), largest_of(gap)
    states = contact.active(), contact.slipping()
    active, slipping = (WORLD.allreduce(int(x.sum())) for x in states)
    assert report.gap == (-low, high)
    assert (report.active, report.slipping, report.rows) == (active, slipping, before.rows)
    assert 0 < active < report.rows
    assert report.penalty == contact.penalty
    if enforcement == "penalty":
        factor = {"nodal": 100, "overlay": 5}[quadrature]
        assert np.isclose(report.stiffness_ratio, factor)
        assert f"automatic: {factor} x stiffness" in report.penalty_source
    else:
        assert "automatic: 10 x modulus" in report.penalty_source
    assert "Coulomb(mu=0.1)" in report.law and enforcement in report.law
    contact.set_penalty(2 * report.penalty)
    given = report_of(pair)
    assert given.penalty_source == "given"
    assert np.isclose(given.stiffness_ratio, 2 * report.stiffness_ratio)


def largest_of(values):
    values = WORLD.allgather(float(np.max(values[np.isfinite(values)], initial=-np.inf)))
    return max(values)


def with_ratio(ratio, solver, n=(8, 6), **options_of_petsc):
    """Solve with this ratio of penalty to stiffness."""
    options = {"contact_options": {"enforcement": "penalty"}}
    pair = Pair("hexahedron", n=n, wave=0.02, penalty=30.0, **options)
    probe = pair.problem()
    probe.set_up()
    pair.contact.set_penalty(ratio * min(pair.contact.model.penalty.stiffness))
    probe.destroy()
    problem = pair.problem(solver=solver, petsc_options=options_of_petsc)
    problem.solve()
    return problem, report_of(pair), pair.contact.force("slave")[2]


def test_conditioning_of_iterative_solvers():
    """Multigrid costs little at a "moderate" ratio, and not much more at a "stiff" one."""
    per_step = {}
    for ratio, word in ((0.3, "soft"), (1.0, "moderate"), (29.0, "moderate"), (3e3, "stiff")):
        problem, report, _ = with_ratio(ratio, "amg", ksp_rtol=1e-8)
        assert np.isclose(report.stiffness_ratio, ratio) and word in report.conditioning
        per_step[ratio] = problem.num_linear_iterations / problem.num_iterations
    assert per_step[29.0] < 3.5 * per_step[1.0]
    assert per_step[3e3] < 6 * per_step[1.0]


def test_conditioning_of_direct_solvers():
    """Errors stay close to the reported value: 1e-15 of the ratio."""
    expected = with_ratio(1e7 / 2, "direct")[2]
    for ratio in (1e8, 1e10):
        _, report, force = with_ratio(ratio, "direct")
        assert f"errors of direct solvers up to {1e-15 * ratio:.0e}" in report.conditioning
        assert abs(force / expected - 1) < 100 * 1e-15 * ratio


def test_overclosure_and_tools():
    pair = Pair("triangle", law=qs.Tied(), gap=-0.05)
    assert np.isclose(report_of(pair).overclosure, 0.05) and "tie" in str(report_of(pair))
    tools = {
        "shape": qs.RigidSurface.plane(WORLD, [0.0, 0.01], [0.0, 1.0]),
        "facets": qs.RigidSurface.triangulated(
            WORLD, [[-1.0, 0.01], [0.5, 0.01], [2.0, 0.01]], [[1, 0], [2, 1]]
        ),
    }
    for kind, tool in tools.items():
        pair.contact = qs.Contact(
            pair.slave,
            tool,
            formulation="master-slave",
            penalty=3.0,
            initial_overclosure="ignore",
            constraints="nodes",
        )
        report = report_of(pair)
        assert np.isclose(report.overclosure, 0.06) and "100 %" in report.treatment
        assert (report.slave.found, report.rows, report.unloaded) == (4, 4, 0)
        assert (report.master is None) == (kind == "shape")
        if report.master is not None:
            assert report.master.nodes == 3 and report.master.area is None


# --- Messages


def lines(caplog):
    return [r.getMessage() for r in caplog.records if r.name == "qsdolfinx"]


def test_a_line_per_solve(caplog):
    """One line per solve on rank 0 with the numbers of the problem, only on request."""
    pair = Pair("triangle", contact_options={"enforcement": "augmented-lagrangian"})
    quiet = pair.problem()
    quiet.solve()
    assert lines(caplog) == []
    quiet.destroy()
    problem = pair.problem(verbose=True)
    for _ in range(2):
        pair.contact.reset()
        problem.solve()
    active = pair.contact.report().active
    force = np.linalg.norm(pair.contact.force("slave"))
    gap = pair.contact.weighted_penetration()
    said = lines(caplog)
    assert len(said) == (2 if WORLD.rank == 0 else 0)
    for line in said[-1:]:
        assert f"{problem.num_iterations} Newton" in line
        assert f"{problem.num_linear_iterations} linear" in line
        assert f"active constraints {active} of " in line and f"force {force:.6g}" in line
        assert f"violation {gap:.3g}" in line and " s;" in line


def test_failed_solve(caplog):
    # Constraints at nodes become inactive: at least two steps.
    nodes = {"constraints": "nodes"}
    pair = Pair("triangle", n=(6, 4), wave=0.05, load=-0.005, contact_options=nodes)
    options = {"snes_max_it": 1, "snes_linesearch_type": "basic"}
    problem = pair.problem(verbose=True, petsc_options=options)
    raises_everywhere(WORLD, qs.ConvergenceError, "MAX_IT", problem.solve)
    said = lines(caplog)
    assert len(said) == (WORLD.rank == 0)
    assert all("failed: DIVERGED_MAX_IT" in line for line in said)


def test_printed_unless_logging_is_set_up(monkeypatch, capfd):
    """Log lines go to the terminal, or to an existing handler."""
    root, logger = logging.getLogger(), logging.getLogger("qsdolfinx")
    pair = Pair("triangle")
    problem = pair.problem(verbose=True)
    monkeypatch.setattr(root, "handlers", [])
    problem.solve()
    assert capfd.readouterr().out.count("qsdolfinx: solve: ") == (WORLD.rank == 0)
    for place in (root, logger):
        stream = io.StringIO()
        handler = logging.StreamHandler(stream)
        monkeypatch.setattr(place, "handlers", [*place.handlers, handler])
        problem.solve()
        monkeypatch.undo() if place is logger else place.handlers.remove(handler)
        assert stream.getvalue().count("solve: ") == (WORLD.rank == 0)
        assert "solve" not in capfd.readouterr().out


@pytest.mark.parametrize("category", (qs.ContactWarning, qs.ReachWarning))
def test_warnings_are_seen(monkeypatch, capfd, category):
    """Warnings of this library are shown although FFCx redirects warnings to logging."""
    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        logging.captureWarnings(False)  # pytest has redirected them again
        logging.captureWarnings(True)
        messages.warn("what to do", category)
        warnings.warn("of another library", UserWarning, stacklevel=1)
    said = capfd.readouterr().err
    assert said.count(f"{category.__name__}: what to do") == (WORLD.rank == 0)
    assert "another" not in said
    assert issubclass(category, qs.ContactWarning) and issubclass(category, UserWarning)


def test_progress(monkeypatch, capfd):
    """On request, rank 0 shows a progress bar up to the end of the run."""
    pytest.importorskip("tqdm")
    case = Upset()
    for wanted in (False, True):
        stepper = qs.TimeStepper(case.problem, 0.05, case.stepper.drive, progress=wanted)
        times = list(stepper.run(0.1))
        sys.stderr.flush()
        said = capfd.readouterr().err
        assert len(times) >= 2
        assert ("t = 0.1 of 0.1" in said) == (wanted and WORLD.rank == 0)
    raises_everywhere(
        WORLD, TypeError, "progress", lambda: qs.TimeStepper(case.problem, 0.1, progress=3)
    )
    pair = Pair("triangle")
    raises_everywhere(WORLD, TypeError, "verbose", lambda: pair.problem(verbose="yes"))
