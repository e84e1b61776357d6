"""Public face of a contact: results, deprecated names, and the contact's name in messages."""

import re
import warnings

import numpy as np
import pytest
from scenes import WORLD, Pair, box, clamp, elastic, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.contact.moved import MOVED


@pytest.mark.parallel
def test_results_of_one_object():
    """Results are also methods of the contact; they are functions of the last solve."""
    pair = Pair("quadrilateral", law=qs.Unilateral())
    contact = pair.contact
    assert not np.any(contact.results.force("slave"))
    pair.problem().solve()
    assert contact.results.force("slave")[1] > 0
    np.testing.assert_array_equal(contact.multiplier(), contact.results.multiplier())
    np.testing.assert_array_equal(contact.force("master"), contact.results.force("master"))
    before = contact.results.force("slave")
    contact.reset()
    np.testing.assert_array_equal(contact.results.force("slave"), before)


def test_completion():
    """Completion lists the attributes that users need, and all of them exist."""
    contact = Pair("quadrilateral").contact
    shown = [name for name in dir(contact) if not name.startswith("_")]
    assert len(shown) <= 30 and {"force", "results", "settings", "report"} <= set(shown)
    shown = dir(contact.slave)
    assert len(shown) <= 15
    for name in shown:
        getattr(contact.slave, name)


def test_names_of_before():
    """Deprecated names work and warn with the new place; unknown names raise an error."""
    contact = Pair("quadrilateral", law=qs.Unilateral()).contact
    for name, (place, _) in MOVED.items():
        if name in ("eps", "tangential_penalty"):  # unknown before a solve, or without friction
            continue
        if name in type(contact).__dict__:  # both contacts and settings have this name
            continue
        place = place if place.startswith("motion.") else f"contact.{place}"
        text = re.escape(f"contact.{name} is {place} now")
        with pytest.warns(DeprecationWarning, match=text):
            getattr(contact, name)
    with pytest.raises(AttributeError, match="Contact has no attribute 'forces'"):
        contact.forces
    assert contact.settings.formulation == "quasi-symmetric"


def test_arguments_by_name():
    """All arguments except the two surfaces must be given by name."""
    pair = Pair("quadrilateral")
    with pytest.raises(TypeError, match="positional"):
        qs.Contact(pair.slave, pair.master, "master-slave")
    with pytest.raises(TypeError, match="name: must be a string that is not empty"):
        qs.Contact(pair.slave, pair.master, name=3)


@pytest.mark.parallel
def test_name_and_step_in_messages():
    """A corner that meets a body in the second step: the message has contact name and step."""
    msh = box(WORLD, (8, 4), "quadrilateral", [-1.0, -1.0], [1.0, 0.0])
    V = vector_space(msh)
    u = fem.Function(V)
    x = np.array([[-0.6, 0.7], [0.1, 0.1], [0.6, 0.7]])
    tool = qs.RigidSurface.triangulated(WORLD, x, [[0, 1], [1, 2]])
    top = qs.Surface(V, facets=plane(msh, 1, 0.0))
    contact = qs.Contact(top, tool, sliding="finite", name="wedge")
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [[clamp(V, plane(msh, 1, -1.0))]])

    def drive(t, dt):
        tool.displacement = [0.0, -0.12 if t > 0.75 else 0.0]

    stepper = qs.TimeStepper(problem, 0.5, drive)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for _ in stepper.run(1.0):
            pass
    texts = [str(w.message) for w in caught if issubclass(w.category, qs.ContactWarning)]
    assert texts and all(text.startswith("step 2, t = 1: contact 'wedge': ") for text in texts), (
        texts
    )
    assert contact.name == "wedge"


def test_what_cannot_be_set():
    """Setting an attribute without effect is refused; the message names the method to call."""
    contact = Pair("quadrilateral").contact
    with pytest.raises(AttributeError, match=re.escape("cannot be set; call set_penalty(ε)")):
        contact.penalty = 3.0
    with pytest.raises(AttributeError, match="formulation: cannot be set; make another contact"):
        contact.formulation = "master-slave"
    assert repr(contact) == "<Contact: quasi-symmetric, with Surface>"
    assert contact.settings.sliding == "small" and contact.settings.penalty == 30.0
