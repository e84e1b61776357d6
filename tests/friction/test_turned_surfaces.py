"""Friction continued on a rotated surface: τ̂ is rotated into the new tangent plane."""

import numpy as np
import pytest
from rigid_scenes import TOOLS
from scenes import WORLD, box, clamp, elastic, largest, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs

PRESS, DRAG, MU = 0.05, 0.036, 0.3


def rotation(gdim, angle):
    """Return a rotation in the plane, or in 3D about y."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]] if gdim == 2 else [[c, 0, s], [0, 1, 0], [-s, 0, c]])


class Sheared:
    """Block held at its bottom, pressed on its top and dragged along x; the whole can be rotated.

    Args:
        kind: Kind of tool on its top, or "body" for another block.
    """

    def __init__(self, cell, kind, **options):
        self.gdim = gdim = 2 if cell in ("triangle", "quadrilateral") else 3
        self.R, axis = np.eye(gdim), gdim - 1
        n, high = [3] * axis + [2], [1.0] * gdim
        self.meshes = [box(WORLD, n, cell, [0.0] * gdim, high, "forward")]
        far = [plane(self.meshes[0], axis, 0.0)]
        V = [vector_space(self.meshes[0])]
        slave = qs.Surface(V[0], facets=plane(self.meshes[0], axis, 1.0))
        if kind == "body":
            low, high = [-0.5, 0.0, 1.0], [1.5, 1.0, 1.5]
            low, high = ([x[0], *x[3 - axis :]] for x in (low, high))
            self.meshes.append(box(WORLD, [5] * axis + [1], cell, low, high, "backward"))
            far.append(plane(self.meshes[1], axis, 1.5))
            V.append(vector_space(self.meshes[1]))
            self.tool = None
            master = qs.Surface(V[1], facets=plane(self.meshes[1], axis, 1.0))
        else:
            master = self.tool = TOOLS[kind](WORLD, gdim)
        self.u = [fem.Function(space) for space in V]
        self.shift = fem.Constant(self.meshes[-1], np.zeros(gdim))
        bcs = [[clamp(V[0], far[0])]]
        if kind == "body":
            dofs = fem.locate_dofs_topological(V[1], axis, far[1])
            bcs.append([fem.dirichletbc(self.shift, dofs, V[1])])
        options = {"quadrature": "overlay", "friction": qs.Coulomb(MU), "penalty": 30.0} | options
        self.contact = qs.Contact(slave, master, formulation="quasi-symmetric", **options)
        F = [elastic(u_i, nu=0.0) for u_i in self.u]  # nothing moves along y
        self.problem = qs.ContactProblem(F, self.u, [self.contact], bcs)

    def drag(self, drag):
        """Solve at a total displacement of the tool or of the upper block's top."""
        motion = np.zeros(self.gdim)
        motion[0], motion[-1] = drag, -PRESS
        if self.tool is None:
            self.shift.value = self.R @ motion
        else:
            self.tool.displacement = self.R @ motion
        self.problem.solve()

    def turn(self, angle):
        """Rotate meshes, displacements and tool; then update the contact pairs, without strain."""
        R = rotation(self.gdim, angle)
        for msh, u in zip(self.meshes, self.u, strict=True):
            msh.geometry.x[:, : self.gdim] = msh.geometry.x[:, : self.gdim] @ R.T
            u.x.array[:] = (u.x.array.reshape(-1, self.gdim) @ R.T).ravel()
        if self.tool is not None:
            self.tool.position = R @ self.tool.position
            self.tool.displacement = R @ self.tool.displacement
        self.R = R @ self.R
        self.contact.update()

    def friction(self):
        """Return τ and the pressure at the nodes, in the frame of the block."""
        return self.contact.tangential_multiplier() @ self.R, self.contact.multiplier()


@pytest.mark.parametrize("enforcement, angle", (("penalty", 0.6), ("augmented-lagrangian", -1.0)))
@pytest.mark.parametrize("constraints", ("nodes", "points"))
@pytest.mark.parametrize("kind", (*TOOLS, "body"))
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_friction_turns_along(cell, kind, constraints, enforcement, angle):
    """A partly sticking block that is rotated with its tool remains in equilibrium."""
    scene = Sheared(cell, kind, enforcement=enforcement, constraints=constraints)
    for drag in (0.0, DRAG):
        scene.drag(drag)
    (tau, pressure), force = scene.friction(), scene.contact.force("slave")
    u = [u_i.x.array.copy() for u_i in scene.u]
    state = scene.contact.model.slips[0].state
    slips, closed = (
        WORLD.allreduce(np.count_nonzero(rows)) for rows in (state.response.slipping, state.closed)
    )
    slip, energy = largest(scene.contact.slip()), scene.contact.dissipated_energy()
    assert 0 < slips < closed
    assert largest(tau[:, 0]) > 0.2 * MU * largest(pressure)

    same = 1e-7
    scene.turn(angle)
    for _ in range(2):  # and nothing moves in the next step
        scene.drag(DRAG)
        turned = scene.friction()
        assert largest(turned[0] - tau) < same * largest(tau)
        assert largest(turned[1] - pressure) < same * largest(pressure)
        np.testing.assert_allclose(scene.contact.force("slave") @ scene.R, force, atol=1e-8)
        for u_i, before in zip(scene.u, u, strict=True):
            back = (u_i.x.array.reshape(-1, scene.gdim) @ scene.R).ravel()
            assert largest(back - before) < same * largest(before)
        assert scene.contact.dissipated_energy() - energy < 1e-6 * PRESS * slip
        assert scene.problem.num_iterations <= 1 or scene.contact.model.augmented
