"""Pressure is minus the normal part of the traction, whatever the rotation of the bodies."""

import numpy as np
import pytest
from following import Nested, rotation

from dolfinx import fem

import qsdolfinx as qs


def at_nodes(surface, pressure):
    """Return values at the owned contact nodes, ordered by their places."""
    V = pressure.function_space
    x = V.tabulate_dof_coordinates()[: V.dofmap.index_map.size_local]
    on = np.abs(pressure.x.array[: len(x)]) > 0
    return x[on], pressure.x.array[: len(x)][on]


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("mu", [0.0, 0.2])
def test_turned_disc(degree, mu):
    """Rotating a disc by 90° does not change the pressure at its nodes."""
    friction = qs.Coulomb(mu) if mu else None
    scene = Nested("quadrilateral", degree, n=(24, 31), friction=friction)
    held = []
    for body, far in zip(scene.bodies, scene.far, strict=True):
        held.append(fem.Function(body.V))
        body.bcs[:] = [fem.dirichletbc(held[-1], fem.locate_dofs_topological(body.V, 1, far))]
    problem, found = scene.problem(), []
    for angle in (0.0, np.pi / 2):
        R = rotation(angle)
        for body, values in zip(scene.bodies, held, strict=True):
            values.interpolate(lambda x, R=R: (R - np.eye(2)) @ x[:2])
            place = body.V.tabulate_dof_coordinates()[:, :2] + body.u.x.array.reshape(-1, 2)
            turned = place @ R.T - body.V.tabulate_dof_coordinates()[:, :2]
            body.u.x.array[:] = turned.ravel()
        problem.solve()
        found.append([at_nodes(s, scene.contact.pressure(side)) for s, side in (
            (scene.slave, "slave"), (scene.master, "master"))])  # fmt: skip
    for before, after in zip(*found, strict=True):
        assert np.all(before[1] > 0)
        np.testing.assert_allclose(after[1], before[1], rtol=1e-6)
    assert not scene.contact.slipping().any() or mu


def test_traction_of_degree_2_at_nodes():
    """The recipe of the reference page also works for displacements of degree 2."""
    scene = Nested("triangle", 2)
    scene.problem().solve()
    t = scene.slave.node_values(scene.contact.traction("slave"))
    assert t.shape == (len(scene.slave.node_area), 2)
    normal = scene.slave.node_normal[:, :2]
    assert np.all(np.sum(t * normal, axis=1) < 0)
    assert len(repr(scene.contact.pairing)) < 100
