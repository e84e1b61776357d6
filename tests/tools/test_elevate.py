"""Meshes of degree 2 that follow the curved boundary which the facets approximate."""

import numpy as np
import pytest
from curved_scenes import Shell
from scenes import WORLD, box, elevated, largest, plane, raises_everywhere

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs

RADII = 1.0, 2.0


def nodes_of(msh, facets):
    """Coordinates of the degree-2 nodes of boundary facets, (nodes, gdim)."""
    gdim = msh.geometry.dim
    surface = qs.Surface(fem.functionspace(msh, ("Lagrange", 2, (gdim,))), facets=facets)
    if surface.coordinates[2] is None:
        return np.zeros((0, gdim))
    return surface.coordinates[2].reshape(-1, 3)[:, :gdim]


def shell(n, **options):
    """A Shell without displacements of degree 2."""
    return Shell(n, RADII, **options)


def off(msh, facets, radius, axes=slice(None)):
    """Largest distance of nodes from a circle, cylinder or sphere."""
    r = np.linalg.norm(nodes_of(msh, facets)[:, axes], axis=1)
    return largest(r - radius)


@pytest.mark.parametrize("named", (False, True), ids=("turned", "named"))
@pytest.mark.parametrize("cell", ("triangle", "quadrilateral"))
def test_circles(cell, named):
    """Arcs of circles are exact, with uneven vertices and at their ends.

    This holds with and without a given shape.
    """
    ring = shell((9, 3), cell=cell, uneven=0.6, partition="scattered")
    msh = ring.mesh
    for facets, radius in ((ring.inner, 1.0), (ring.outer, 2.0)):
        shape = qs.smooth.Cylinder([0, 0], None, radius) if named else None
        msh = qs.elevate(msh, facets=facets, shape=shape)
    assert off(msh, ring.inner, 1.0) < 1e-12 and off(msh, ring.outer, 2.0) < 1e-12
    area = fem.assemble_scalar(fem.form(fem.Constant(msh, 1.0) * ufl.dx))
    assert abs(WORLD.allreduce(area) / (0.75 * np.pi) - 1) < 5e-5  # 5e-3 with chords


@pytest.mark.parametrize("cell", ("tetrahedron", "hexahedron"))
@pytest.mark.parametrize("sphere", (False, True), ids=("cylinder", "sphere"))
def test_3d(cell, sphere):
    """With a given shape nodes are exact; otherwise they have a part of the chord error.

    The part decreases for more even facets.
    """
    n = (6, 5, 2) if sphere else (8, 12, 2)
    body = shell(n, cell=cell, sphere=sphere, uneven=0.2, partition="last")
    axes = slice(None) if sphere else slice(2)
    x = qs.Surface(body.V, facets=body.outer).coordinates[0]
    middles = (x[:, :-1] + x[:, 1:]).reshape(-1, 3)[:, axes] / 2
    chord = largest(np.linalg.norm(middles, axis=1) - 2.0)
    named = (
        qs.smooth.Sphere([0, 0, 0], 2.0) if sphere else qs.smooth.Cylinder([0, 0, 0], [0, 0, 1], 2)
    )
    found = [
        off(qs.elevate(body.mesh, facets=body.outer, shape=shape), body.outer, 2.0, axes)
        for shape in (None, named)
    ]
    assert found[0] < 0.05 * chord and found[1] < 1e-12


def test_middle_of_bricks():
    """Middles of cells are half way between those of their faces on a straight line."""
    body = shell((4, 3, 2), cell="hexahedron")
    msh = qs.elevate(qs.elevate(body.mesh, facets=body.outer), facets=body.inner)
    x = msh.geometry.x[msh.geometry.dofmap]
    faces, middle = x[:, 20:26], x[:, 26]
    off = np.linalg.norm((faces[:, :3] + faces[:, :2:-1]) / 2 - middle[:, None], axis=2)
    assert largest(np.sort(off, axis=1)[:, :2]) < 1e-12  # along the axis and the radius
    assert largest(off) > 1e-3  # along the arc


def half_ball(size):
    """Tetrahedra of half a ball of radius 1, and tags: 1 on the round face, 2 on the flat face."""
    gmsh = pytest.importorskip("gmsh")
    gmsh.initialize(["", "-v", "0", "-clmax", str(size), "-clmin", str(size)])
    if WORLD.rank == 0:
        gmsh.model.occ.addSphere(0, 0, 0, 1, angle2=0)
        gmsh.model.occ.synchronize()
        for dim, tag in [(3, 1), *gmsh.model.getEntities(2)]:
            gmsh.model.addPhysicalGroup(dim, [tag], tag)
        gmsh.model.mesh.generate(3)
    msh, _, tags = qs.compat.model_to_mesh(gmsh.model, WORLD)
    gmsh.finalize()
    return msh, tags


def test_unstructured():
    """On uneven triangles nodes are on the sphere, and the flat face stays flat.

    This includes the nodes of its rim.
    """
    msh, tags = half_ball(0.4)
    new = qs.elevate(msh, tags, 1)
    named = qs.elevate(msh, tags, 1, shape=qs.smooth.Sphere([0, 0, 0], 1))
    V = fem.functionspace(named, ("Lagrange", 2, (3,)))
    chord = qs.Surface(V, tags, 1).largest_height
    assert off(new, tags.find(1), 1.0) < 0.03 * chord and off(named, tags.find(1), 1.0) < 1e-12
    assert largest(nodes_of(new, tags.find(2))[:, 2]) < 1e-14


def test_strip():
    """The error is reduced on a strip that is one cell wide.

    Its vertices are all on the rims, across which they have no information.
    """
    body = shell((10, 1, 1), cell="tetrahedron")
    chord = 2 * (1 - np.cos(np.pi / 40))
    assert off(qs.elevate(body.mesh, facets=body.outer), body.outer, 2.0, slice(2)) < 0.3 * chord


def disc(n, cell, height=1.0):
    """A disc around the axis, and the facets of its cylindrical wall."""
    msh = box(WORLD, (n, n, 2), cell, [-1.0, -1.0, 0.0], [1.0, 1.0, height])
    wall = [plane(msh, axis, value) for axis in (0, 1) for value in (-1.0, 1.0)]
    x = msh.geometry.x
    a, b = x[:, 0].copy(), x[:, 1].copy()
    x[:, 0], x[:, 1] = a * np.sqrt(1 - b**2 / 2), b * np.sqrt(1 - a**2 / 2)
    return msh, np.unique(np.concatenate(wall))


def test_creases():
    """At the sharp edge of a cylinder nodes are on both faces, and the end stays flat."""
    msh, wall = disc(8, "tetrahedron")
    ends = np.concatenate([plane(msh, 2, value) for value in (0.0, 1.0)])
    new = qs.elevate(msh, facets=np.concatenate([wall, ends]))
    assert off(new, wall, 1.0, slice(2)) < 1e-4  # 4e-3 with chords
    z = nodes_of(new, ends)[:, 2]
    assert largest(np.minimum(np.abs(z), np.abs(z - 1))) < 1e-14
    volume = WORLD.allreduce(fem.assemble_scalar(fem.form(fem.Constant(new, 1.0) * ufl.dx)))
    assert abs(volume / np.pi - 1) < 2e-4


def test_flat_beside_fillet():
    """Flat facets stay flat next to an arc, and the facets of the arc are curved."""
    msh = box(WORLD, (12, 2), "triangle", [0.0, 0.0], [3.0, 1.0])
    top = plane(msh, 1, 1.0)
    x = msh.geometry.x
    s, t = x[:, 0].copy(), 1.0 - x[:, 1].copy()
    angle = np.maximum(s - 1.5, 0.0) / 2  # an arc of radius 2 from x = 1.5 on
    x[:, 0] = np.minimum(s, 1.5) + (2 - t) * np.sin(angle)
    x[:, 1] = (2 - t) * np.cos(angle) - 2
    p = nodes_of(qs.elevate(msh, facets=top), top)
    level, r = p[:, 0] < 1.5, np.hypot(p[:, 0] - 1.5, p[:, 1] + 2)
    assert largest(np.where(level, p[:, 1], 0.0)) < 1e-14
    inside = p[:, 0] > 1.5 + 0.26  # beyond the first facet of the arc
    assert largest(np.where(inside, r - 2, 0.0)) < 1e-12


def test_same_numbers():
    """Tags, facets and vertices keep their numbers, and the given mesh does not change."""
    ring = shell((8, 2), cell="triangle")
    x = ring.mesh.geometry.x.copy()
    fdim = ring.gdim - 1
    tags = mesh.meshtags(ring.mesh, fdim, np.sort(ring.outer), np.full(len(ring.outer), 7, "i4"))
    new = qs.elevate(ring.mesh, tags, 7)
    assert np.array_equal(ring.mesh.geometry.x, x)
    V = fem.functionspace(new, ("Lagrange", 2, (2,)))
    surfaces = qs.Surface(V, tags, 7), qs.Surface(ring.V, tags, 7)
    assert np.array_equal(surfaces[0].coordinates[0], surfaces[1].coordinates[0])
    assert np.array_equal(surfaces[0].facet_numbers, surfaces[1].facet_numbers)
    ds = ufl.Measure("ds", domain=new, subdomain_data=tags)
    length = WORLD.allreduce(fem.assemble_scalar(fem.form(fem.Constant(new, 1.0) * ds(7))))
    assert abs(length / np.pi - 1) < 1e-5  # 1.6e-3 with chords


def test_refused():
    ring = shell((4, 80), cell="quadrilateral")
    thin = "cells would fold, as they are thinner than their facets bulge"
    raises_everywhere(WORLD, ValueError, thin, lambda: qs.elevate(ring.mesh, facets=ring.inner))
    circle = qs.smooth.Cylinder([0, 0], None, 1.1)
    message = "shape: vertices of the surface are up to 0.1 off the Cylinder"
    fine = shell((16, 2), cell="quadrilateral")
    raises_everywhere(
        WORLD, ValueError, message, lambda: qs.elevate(fine.mesh, facets=fine.inner, shape=circle)
    )
    raises_everywhere(
        WORLD,
        ValueError,
        "must be of degree 1 or 2, not 3",
        lambda: qs.elevate(elevated(fine.mesh, 3), facets=fine.inner),
    )
    raises_everywhere(
        WORLD, TypeError, "msh: must be a dolfinx.mesh.Mesh", lambda: qs.elevate(fine.V, facets=[0])
    )
    raises_everywhere(
        WORLD, TypeError, "shape: ", lambda: qs.elevate(fine.mesh, facets=[0], shape="round")
    )
