"""A contact that has been reset is as a new one."""

import numpy as np
import pytest
from scenes import WORLD, Pair, box, elastic, plane, vector_space
from system.test_compiling import neo_hooke

import ufl
from dolfinx import fem

import qsdolfinx as qs

LAWS = {"coulomb": lambda: qs.Coulomb(0.3), "norton": lambda: qs.Norton(0.5, 1.0, 0.3)}


class Press:
    """A block, or two, pressed and dragged; the second solve is from the undeformed bodies."""

    def __init__(self, law, sliding, tool):
        options = {"friction": LAWS[law](), "sliding": sliding}
        options |= {"dt": 0.1} if law == "norton" else {}
        if tool:
            msh = box(WORLD, [4, 4], "quadrilateral", [0, 0], [1, 1])
            V = vector_space(msh)
            self.u, self.shift = [fem.Function(V)], fem.Constant(msh, (0.0, 0.0))
            dofs = fem.locate_dofs_topological(V, 1, plane(msh, 1, 1.0))
            floor = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
            self.contact = qs.Contact(qs.Surface(V, facets=plane(msh, 1, 0.0)), floor, **options)
            F, bcs = [elastic(self.u[0])], [[fem.dirichletbc(self.shift, dofs, V)]]
        else:
            pair = Pair("quadrilateral", load=0.0, contact_options=options)
            dx = ufl.dx(metadata={"quadrature_degree": 3})
            self.u, self.contact = pair.u, pair.contact
            V = pair.V[1]
            self.shift = fem.Constant(V.mesh, (0.0, 0.0))
            dofs = fem.locate_dofs_topological(V, 1, plane(V.mesh, 1, 1.0))
            F = [neo_hooke(u, dx) for u in pair.u]
            bcs = [pair.bcs[0], [fem.dirichletbc(self.shift, dofs, V)]]
        self.problem = qs.ContactProblem(F, self.u, self.contact, bcs)

    def solve(self, across):
        """Press, and drag; return what the contact says of it."""
        self.shift.value = across, -0.05
        self.problem.solve()
        found = self.contact
        return np.array(
            [*found.force("slave"), found.step_dissipation(), found.dissipated_energy()]
        )

    def begin_again(self, updated):
        """Undeformed bodies, and a contact without history."""
        for u in self.u:
            u.x.array[:] = 0.0
        if updated:
            self.contact.update()
        self.contact.reset()


@pytest.mark.parallel
@pytest.mark.parametrize("tool", (True, False))
@pytest.mark.parametrize("sliding", ("small", "finite"))
@pytest.mark.parametrize("law", LAWS)
def test_as_a_new_one(law, sliding, tool):
    """Forces, the energy of this solve and of all solves, after a solve with slip."""
    case, fresh = Press(law, sliding, tool), Press(law, sliding, tool)
    expected = fresh.solve(0.1)
    assert expected[3] > 1e-7
    for updated in (False, True) if sliding == "small" else (True,):
        case.solve(0.15)
        case.begin_again(updated)
        np.testing.assert_allclose(case.solve(0.1), expected, rtol=1e-6, atol=1e-12)
