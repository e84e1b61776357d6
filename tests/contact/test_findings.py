"""Checks are made for the types of contacts for which they are meant, and warn once."""

import warnings

import pytest
from scenes import Pair, plane

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.contact.contact_type import ContactType
from qsdolfinx.contact.findings import Check, look

TYPES = ContactType.NORMAL, ContactType.ITSELF, ContactType.TIE, ContactType.FIELD
ALL = ContactType.BODIES | ContactType.FIELD


@pytest.fixture(scope="module")
def models():
    """Make a contact of each type."""
    pair, tied = Pair("triangle"), Pair("triangle", law=qs.Tied())
    fields = [fem.functionspace(V.mesh, ("Lagrange", 1)) for V in pair.V]
    of_field = [qs.Surface(V, facets=plane(V.mesh, 1, 0.0)) for V in fields]
    return {
        ContactType.NORMAL: pair.contact.model,
        ContactType.ITSELF: qs.Contact(pair.slave, pair.slave).model,
        ContactType.TIE: tied.contact.model,
        ContactType.FIELD: qs.Contact(*of_field).model,
    }


def warned(model, *checks):
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        look(model, checks)
    return [str(warning.message) for warning in found]


def test_each_contact_has_one_type(models):
    assert set(models) == set(TYPES)
    for known, model in models.items():
        assert model.type is known
        assert model.has_gaps == (known in ContactType.GAPS)
        assert model.is_scalar == (known not in ContactType.BODIES)


@pytest.mark.parametrize("meant_for", [*TYPES, ContactType.GAPS, ContactType.BODIES, ALL])
def test_a_check_is_made_for_its_types_alone(models, meant_for):
    asked = []
    check = Check("asked", asked.append, meant_for)
    for model in models.values():
        look(model, [check])
    assert asked == [model for known, model in models.items() if known in meant_for]


def test_a_finding_is_reported_once_and_explains_others(models):
    first = Check("first", lambda model: "the cause", ContactType.GAPS)
    second = Check("second", lambda model: "a consequence", ALL, unless="first")
    texts = {known: warned(model, first, second) for known, model in models.items()}
    for known, text in texts.items():
        assert text == ["the cause" if known in ContactType.GAPS else "a consequence"]
    assert not any(warned(model, first, second) for model in models.values())
