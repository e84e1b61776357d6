"""Finite sliding: area of the other surface that covers each node."""

import pytest
from scenes import WORLD, box, clamp, elastic, largest, plane, vector_space

from dolfinx import fem

import qsdolfinx as qs


@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
@pytest.mark.parametrize("cell", ("quadrilateral", "tetrahedron", "hexahedron"))
def test_whole_faces_cover_whole_nodes(cell, formulation):
    """Where blocks meet with whole faces, each node is covered by its whole area."""
    gdim = 2 if cell == "quadrilateral" else 3
    up, F, u, bcs, surfaces = gdim - 1, [], [], [], []
    for low, n in ((0.0, 3), (1.0, 4)):
        corner = [*[0.0] * up, low]
        end = [*[1.0] * up, low + 1.0]
        msh = box(WORLD, [*[n] * up, 2], cell, corner, end, "scattered")
        V = vector_space(msh)
        u.append(fem.Function(V))
        F.append(elastic(u[-1]))
        bcs.append([clamp(V, plane(msh, up, 2 * low))])
        surfaces.append(qs.Surface(V, facets=plane(msh, up, 1.0)))
    contact = qs.Contact(*surfaces, sliding="finite", formulation=formulation)
    qs.ContactProblem(F, u, [contact], bcs).solve()
    cut = contact.model.gaps[0].cut
    assert largest(cut.found.cover.sum(axis=1) - cut.node_area) < 1e-12
