"""How accurate linear solves are, how long they may take, and when solvers are given up."""

import itertools
import math
import types

import pytest

from qsdolfinx.base import interrupt
from qsdolfinx.linear import presets
from qsdolfinx.linear.krylov import Krylov
from qsdolfinx.linear.presets import patience
from qsdolfinx.linear.solver import GivenUp, LinearSolver
from qsdolfinx.linear.stop import Stop


class Recorded:
    """A linear solver that records the tolerances that it gets."""

    def setTolerances(self, rtol=None, max_it=None):
        self.rtol, self.max_it = rtol, max_it


def tolerance(norms, until, changed=True, linear=False, slips=False, moves=False, is_flow=False):
    """Relative tolerance after these norms of the residual."""
    ksp = Recorded()
    Krylov(ksp, (), linear, slips, is_flow).set_tolerance(norms, until, changed, moves)
    return ksp.rtol


@pytest.mark.parametrize("until", (1e-2, 1e-4))
def test_the_last_solve_ends_newtons_method(until):
    """What a linear solve leaves is below the norm of the end, and not much below."""
    assert 0.1 < tolerance([1.0], until) / until < 0.8
    assert 0.6 < tolerance([1.0], until, changed=False, linear=True) / until < 1.0


def test_solves_before_the_last_one():
    """A few digits are enough; fewer for linear bodies, and more for flow."""
    assert 2e-4 < tolerance([1.0], 1e-9) < 5e-3
    assert 1e-2 < tolerance([1.0], 1e-9, linear=True) < 0.09
    assert 1e-7 < tolerance([1.0], 1e-9, is_flow=True) < 1e-5


def test_ties_that_move():
    """Their residual is not linear: two solves share the digits, which one of them would double."""
    told = {"changed": False, "linear": True, "moves": True}
    assert 2e-5 < tolerance([1.0], 1e-9, **told) < 5e-4
    assert 0.2 < tolerance([1.0, 1e-4], 1e-9, **told) * 1e-4 / 1e-9 < 0.5
    assert 2e-7 < tolerance([1.0, 1e-3], 1e-12, **told) < 5e-6


def test_one_solve_where_two_take_longer():
    """Five digits are solved at once, and eight in two parts."""
    assert tolerance([1.0], 1e-4) < 1e-4 < 1e-4 / 0.3 < tolerance([1.0], 1e-7) < 1


def test_bounds():
    """No solve is so loose that it does nothing, or as accurate as rounding does not allow."""
    ksp = Recorded()
    krylov = Krylov(ksp, (), False, False)
    krylov.set_tolerance([1.0], 10.0, True)
    assert 0.02 < ksp.rtol < 0.5
    krylov.set(1e-20)
    assert 1e-13 < ksp.rtol < 1e-11
    assert 1e-9 < presets.KRYLOV["ksp_rtol"] < 1e-7


def test_residuals_that_stall():
    """Each iteration without a decrease is followed by a solve with one more digit."""
    found = [tolerance([1.0] * n, 1e-12, linear=True) for n in (2, 3, 4)]
    ratios = [after / before for before, after in itertools.pairwise(found)]
    assert all(0.02 < ratio < 0.5 for ratio in ratios)


def test_numbers_of_iterations():
    """They grow with the digits and the third root of the size, and are never too few."""
    assert (patience(1000), patience(5000), patience(8 * 5000)) == (100, 100, 200)
    krylov = Krylov(Recorded(), (), False, False, patience=100)
    digits = [krylov.longest(10.0**-k, 0) for k in (4, 8)]
    assert digits[1] == 2 * digits[0] == 100
    assert 15 < krylov.longest(0.5) < 100


def test_a_direct_solver_takes_over_for_a_while():
    """Its duration doubles with each failure, up to some ten updates of the contact pairs."""
    given_up = GivenUp()
    updates = []
    for _ in range(20):
        given_up.begin()
        count = 0
        while given_up.is_now:
            given_up.pair()
            count += 1
        updates.append(count)
    assert updates[:4] == [1, 2, 4, 8] and 20 < updates[-1] < 200
    assert math.log2(updates[-1]) % 1 == 0


def test_which_solver():
    """Multigrid is chosen where it is faster: in 3D from some thousand unknowns on."""
    chosen = [
        [presets.pick(n, dim, True, "mpi")[0] for n in (500, 20_000, 10**7)] for dim in (2, 3)
    ]
    assert chosen == [["direct", "direct", "amg"], ["direct", "amg", "amg"]]
    flow = [
        [presets.pick(n, dim, False, "mpi", True)[0] for n in (2000, 10**5, 10**7)]
        for dim in (2, 3)
    ]
    assert flow == [["direct", "direct", "schur"], ["direct", "schur", "schur"]]


def factored(unknowns, dim):
    """Whether a problem of this size may be solved by a direct solver."""
    geometry = types.SimpleNamespace(dim=dim)
    body = types.SimpleNamespace(
        V=types.SimpleNamespace(mesh=types.SimpleNamespace(geometry=geometry))
    )
    x = types.SimpleNamespace(getSize=lambda: unknowns)
    inside = {"_system": types.SimpleNamespace(bodies=[body], x=x)}
    return LinearSolver.may_be_factored.fget(types.SimpleNamespace(**inside))


def test_factors_that_fit_into_memory():
    assert [factored(n, 2) for n in (10**6, 10**7)] == [True, False]
    assert [factored(n, 3) for n in (10**5, 10**6)] == [True, False]


def test_inner_solver():
    """An inner solver gives some digits, and GMRES does not restart at once."""
    fake = types.SimpleNamespace(ksp=Recorded(), **{"_is_named": False})
    assert 30 < LinearSolver.loosen_inner(fake, 1e-9) < 300
    assert 1e-3 < fake.ksp.rtol < 0.1


def test_interrupts_are_looked_for(monkeypatch):
    """Often enough for users who wait, and not in each iteration, in which all ranks would wait."""
    asked = []
    monkeypatch.setattr(interrupt, "requested", lambda comm: asked.append(comm))
    ksp = types.SimpleNamespace(setMonitor=lambda monitor: None)
    stop = Stop(ksp, None)
    for iteration in range(100):
        stop.monitor(ksp, iteration, 1.0)
    assert 5 < len(asked) < 50


def test_memory_for_factors():
    """More than MUMPS' own margin of a fifth, and not many times as much."""
    assert 30 < presets.PRESETS["direct"]["mat_mumps_icntl_14"] < 500
