"""Arguments are checked once, on entry: one reduction and one error for all of them."""

import collections
import sys
import typing

from mpi4py import MPI

import numpy as np
import pytest
from base.malformed_scene import GOOD, Scene
from scenes import WORLD, Pair, raises_everywhere

import qsdolfinx as qs
from qsdolfinx.base import collective
from qsdolfinx.base.checks import COUNT, FLAG, FRACTION, POSITIVE, check, either, one_of
from qsdolfinx.base.collective import checked, collective_errors

FIRST, LAST = WORLD.rank == 0, WORLD.rank == WORLD.size - 1
several = pytest.mark.several_ranks


class Counting(MPI.Intracomm):
    """A communicator that counts collective calls by their names."""

    calls: typing.ClassVar = collections.Counter()


def counted(name):
    def call(self, *args, **kwargs):
        self.calls[name] += 1
        return getattr(MPI.Intracomm, name)(self, *args, **kwargs)

    return call


for _name in ("allreduce", "Allreduce", "bcast", "Bcast", "allgather", "Allgather", "barrier"):
    setattr(Counting, _name, counted(_name))


@pytest.fixture
def calls(monkeypatch):
    """Counter of the collective calls of all checks from here on."""
    for module in [m for name, m in sys.modules.items() if name.startswith("qsdolfinx.")]:
        for door in (checked, collective_errors):
            if module is not collective and vars(module).get(door.__name__) is door:
                monkeypatch.setattr(module, door.__name__, lambda c, d=door: d(Counting(c)))
    Counting.calls.clear()
    return Counting.calls


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    scene = Scene(WORLD.bcast(tmp_path_factory.mktemp("checked"), root=0))
    yield scene
    scene.close()


#: Calls with checked arguments, and their reductions; more than one if the state is checked, too.
REDUCTIONS = {
    "Surface": 2,  # coordinates are finite
    "Surface.function": 1,
    "Contact": 1,
    "Contact with friction": 1,
    "Contact.set_penalty": 1,
    "Contact.set_dt": 1,
    "Contact.set_offset": 1,
    "Contact.moment": 1,
    "ContactProblem": 1,
    "TimeStepper": 1,
    "RigidSurface.plane": 1,
    "RigidSurface.cylinder": 1,
    "RigidSurface.sphere": 1,
    "RigidSurface.triangulated": 2,  # and neighbours agree
    "FieldWriter": 1,
    "History": 1,
}


@pytest.mark.parametrize("target", REDUCTIONS)
def test_one_reduction(scene, calls, target):
    good = GOOD[target](scene)
    calls.clear()
    made = good.call(**good.arguments)
    assert calls == {"Allreduce": REDUCTIONS[target]}
    if isinstance(made, qs.ContactProblem):
        made.destroy()
    if isinstance(made, qs.FieldWriter):
        made.close()


def test_as_many_as_there_are(calls):
    with checked(Counting(WORLD)) as same:
        for i in range(100):
            same(POSITIVE, **{f"a{i}": 1.0 + i})
    assert calls == {"Allreduce": 1}


# --- Ranks with different arguments


def refused(error, text, block):
    """Assert that a block of checks raises this error on all ranks, and no reduction is pending."""

    def call():
        with checked(WORLD) as same:
            block(same)

    raises_everywhere(WORLD, error, text, call)
    assert WORLD.allreduce(1) == WORLD.size


@pytest.mark.parallel
@several
def test_one_rank_fails_and_others_disagree():
    """An error on one rank has priority over disagreement of ranks.

    With several errors, that of the lowest rank is raised.
    """

    def block(same):
        same(POSITIVE, radius=1.0 + FIRST)  # differs on the first rank
        check(FLAG, inside="yes" if LAST else True)
        same(more=1)  # not reached on the last rank

    refused(TypeError, "inside: must be True or False, not 'yes'", block)

    def each_for_itself(same):
        if WORLD.rank % 2:
            raise KeyError(WORLD.rank)
        same(POSITIVE, radius=-1.0 - WORLD.rank)

    refused(ValueError, "radius: must be a positive, finite number, not -1.0", each_for_itself)


@several
def test_other_numbers_of_arguments():
    more = {"a": 1, "b": 2} if LAST else {"a": 1}
    refused(ValueError, "b: must be the same", lambda same: same(**more))


@several
def test_other_order_of_arguments():
    """Another order of the arguments is not a difference in itself."""
    names, values = ("b", "a") if LAST else ("a", "b"), {"a": 1, "b": int(LAST)}
    with checked(WORLD) as same:
        same(**{name: name for name in names})
    refused(ValueError, "b: must be the same", lambda same: same(**{n: values[n] for n in names}))


@several
def test_an_argument_that_cannot_be_printed():
    class Odd:
        def __repr__(self):
            raise RuntimeError("no text")

    refused(RuntimeError, "no text", lambda same: same(value=Odd() if LAST else 1))


@several
def test_a_contact_of_ranks_that_do_not_agree():
    """With different errors on ranks, the wrong penalty of the last rank is reported.

    The first rank has another tolerance, and a friction law.
    """
    pair = Pair("triangle")
    mine = {"gap_tolerance": 1e-7, "friction": qs.Coulomb(0.1)} if FIRST else {}
    mine |= {"penalty": -1.0} if LAST else {}
    raises_everywhere(
        WORLD, ValueError, "penalty", lambda: qs.Contact(pair.slave, pair.master, **mine)
    )
    assert WORLD.allreduce(1) == WORLD.size


# --- Allowed arguments


@pytest.mark.parametrize(
    "kind, good, bad",
    (
        (
            POSITIVE,
            (1, 0.5, np.float32(2)),
            (0, -1.0, np.nan, np.inf, 10**400, True, "1", None, [1.0]),
        ),
        (FRACTION, (0, 1, 0.5), (-1e-9, 1.1, np.nan, False, np.array([0.5, 0.5]))),
        (COUNT, (1, 2.0, np.int32(3)), (0, 1.5, np.inf, True)),
        (either(POSITIVE, "auto"), (1.0, "auto"), ("Auto", None, 0)),
        (either(POSITIVE, None), (1.0, None), ("None", "", 0, np.array([1.0, 2.0]))),
        (one_of(("a", "b", "c")), ("a", "c"), ("d", "", None, ("a",), np.array(["a", "b"]))),
    ),
)
def test_kinds(kind, good, bad):
    for value in good:
        check(kind, value=value)
    for value in bad:
        with pytest.raises(ValueError, match="value: must be"):
            check(kind, value=value)


def test_messages():
    """A message has name, requirement and value.

    It has the type if the value would be long or an address.
    """

    def says(kind, value):
        with pytest.raises((TypeError, ValueError)) as found:
            check(kind, name=value)
        return str(found.value)

    assert says(either(POSITIVE, "auto"), -1) == (
        'name: must be a positive, finite number, or "auto", not -1'
    )
    assert says(one_of(("a", "b", "c")), None) == "name: must be one of a, b, c, not None"
    assert says(FLAG, object()) == "name: must be True or False, not object"
    assert says(FLAG, list(range(1000))) == "name: must be True or False, not list"
