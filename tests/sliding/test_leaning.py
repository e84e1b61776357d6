"""Tools of facets whose walls face the body more and more as its facets lean on them."""

import pytest
from following import Dragged

import qsdolfinx as qs

ALONG = 0.05


@pytest.mark.parametrize("friction", (None, qs.Coulomb(0.3)))
@pytest.mark.parametrize("steep", (2.0, 3.0, 20.0))
def test_pressed_and_dragged(steep, friction):
    """A tool with a flat bottom and inclined walls is pressed down and dragged in whole steps.

    Facets at its corners lean by 10° to 20°. Where walls of 72° had no weight or all of it, there
    was no equilibrium, and no step of any size succeeded.
    """
    scene = Dragged((60, 12), steep, ALONG, friction)
    assert scene.most_iterations(4.0) <= 25
    assert scene.contact.force("slave")[1] < -1
