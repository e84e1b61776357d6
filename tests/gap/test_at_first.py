"""Gaps at the first contact detection: surfaces that just touch, and allowed overclosure."""

import numpy as np
import pytest
from scenes import WORLD, Pair, box, plane, vector_space

import qsdolfinx as qs


@pytest.mark.parametrize("open_by, closed", ((0.0, True), (1e-16, True), (1e-6, False)))
@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_touching(cell, quadrature, open_by, closed):
    """A gap of rounding size counts as closed; otherwise touching bodies would fall through."""
    pair = Pair(cell, gap=open_by, contact_options={"quadrature": quadrature})
    active = pair.contact.active()
    counts = WORLD.allreduce(np.array([np.count_nonzero(active), len(active)]))
    assert counts[0] == (counts[1] if closed else 0)


def sloped(initial_overclosure, radius=0.25):
    """Make a slave face from 0.4 above a tool to 0.4 below it: nodes at its ends are unpaired."""
    msh = box(WORLD, (10, 2), "quadrilateral", [0.0, 0.0], [1.0, 1.0], "backward")
    V, facets = vector_space(msh), plane(msh, 1, 0.0)
    x = msh.geometry.x
    x[:, 1] += 0.8 * (0.5 - x[:, 0])
    slave = qs.Surface(V, facets=facets)
    tool = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    options = {"search_radius": radius, "initial_overclosure": initial_overclosure}
    contact = qs.Contact(slave, tool, formulation="master-slave", quadrature="nodal", **options)
    height = slave.node_x[:, 1]
    paired = np.abs(height) <= radius
    counts = [WORLD.allreduce(np.count_nonzero(rows)) for rows in (paired, ~paired)]
    assert min(counts) > 0
    return contact, np.where(paired, -height, np.nan)


@pytest.mark.filterwarnings("ignore::qsdolfinx.ContactWarning")  # surfaces penetrate deeply
def test_overclosure_belongs_to_nodes():
    """Ignored overclosure is the depth of each paired node; open gaps do not change."""
    contact, gap = sloped("ignore")
    np.testing.assert_allclose(contact.weighted_gap(), np.minimum(gap, 0), atol=1e-15)
    for part in (0.25, 0.0, 1.0):
        contact.allow_overclosure(part)
        expected = np.where(gap > 0, (1 - part) * gap, gap)
        np.testing.assert_allclose(contact.weighted_gap(), expected, atol=1e-15)
    resolved, gap = sloped("resolve")
    np.testing.assert_allclose(resolved.weighted_gap(), gap, atol=1e-15)


@pytest.mark.filterwarnings("ignore::qsdolfinx.ContactWarning")
def test_overclosure_goes_along():
    """After a contact update with other nodes in reach, each node keeps its initial depth."""
    contact, before = sloped("ignore")
    contact.master.displacement = [0.0, 0.1]
    contact.master.advance()
    contact.update()
    height = contact.slave.node_x[:, 1] - 0.1
    paired = np.abs(height) <= contact.settings.search_radius
    kept = np.where(before > 0, before, 0.0)  # zero at nodes that were out of reach
    expected = np.where(paired, -height - kept, np.nan)
    np.testing.assert_allclose(contact.weighted_gap(), expected, atol=1e-15)
