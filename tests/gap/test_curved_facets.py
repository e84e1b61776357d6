"""Contact between the curved facets of meshes of degree 2, and fits of named surfaces."""

import numpy as np
import pytest
from curved_scenes import LoadedRings, Shell, ShrinkFit, exact_pressure
from hertz import errors
from hertz_bodies import Body, Hertz, create_mesh
from output.test_output import stored
from scenes import WORLD, box, elevated, largest, plane, raises_everywhere, vector_space
from tangents import direction, near_solution, tangent_errors

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.steps.mesh_motion import MeshMotion
from qsdolfinx.surface.affine import Affine, affine_vec

RINGS = (16, 5), (22, 7)
SHELLS = (12, 3, 4), (17, 4, 5)
#: Degrees of geometry and displacements.
KINDS = {
    "curved P1": {"degrees": (2, 1)},
    "curved P2": {"degrees": (2, 2)},
    "elevated P1": {"degrees": ("elevated", 1)},
    "elevated P2": {"degrees": ("elevated", 2)},
    "named P1": {"degrees": ("named", 1)},
}
LAGRANGE = {"enforcement": "augmented-lagrangian"}

kinds = pytest.mark.parametrize("kind", KINDS)
both_ways = pytest.mark.parametrize("swap", (False, True))


# --- Gaps and pressures of conforming surfaces


@kinds
@both_ways
@pytest.mark.parametrize(
    ("n", "cell", "within"),
    [
        (RINGS, "triangle", 0.001),
        (RINGS[::-1], "quadrilateral", 0.002),
        (SHELLS, "hexahedron", 0.006),
        (SHELLS, "tetrahedron", 0.006),
    ],
)
def test_gap_of_concentric_surfaces(n, cell, within, swap, kind):
    """The gap is the misfit at every point; chord errors are more than half of it."""
    gap = ShrinkFit(n, swap, cell=cell, **KINDS[kind]).contact.pairing.gap
    assert largest(gap / 0.01 + 1) < within
    if kind == "curved P1":
        assert largest(ShrinkFit(n, swap, cell=cell).contact.pairing.gap / 0.01 + 1) > 0.5


@both_ways
@pytest.mark.parametrize(
    "cell, n, within",
    (("triangle", RINGS, 0.001), ("hexahedron", SHELLS, 0.06), ("tetrahedron", SHELLS, 0.03)),
)
def test_uneven_facets(cell, n, within, swap):
    """The same holds on meshes made by qs.elevate from facets of different sizes.

    In 3D the chord errors are twice the misfit.
    """
    scene = ShrinkFit(n, swap, cell=cell, uneven=0.2, degrees=("elevated", 1))
    assert largest(scene.contact.pairing.gap / 0.01 + 1) < within


@kinds
@both_ways
@pytest.mark.parametrize("n", (RINGS, RINGS[::-1]), ids=("coarse inside", "coarse outside"))
def test_shrink_fit(n, swap, kind):
    """Lamé's pressure is found within 1 %; with chords it is wrong by a third."""
    scene = ShrinkFit(n, swap, **KINDS[kind], **LAGRANGE)
    scene.problem().solve()
    for side in ("slave", "master"):
        mean, scatter = scene.pressure(side)
        assert abs(mean / exact_pressure() - 1) < 0.005 and scatter / exact_pressure() < 0.008


@both_ways
@pytest.mark.parametrize("formulation", ("master-slave", "double-pass"))
def test_formulations(formulation, swap):
    """Lamé's pressure is found within 1 % in the other formulations."""
    exact, options = exact_pressure(), LAGRANGE
    if formulation == "double-pass":
        options = {"enforcement": "penalty", "penalty": 1e3 * exact / 0.01}
    scene = ShrinkFit(RINGS, swap, degrees=("elevated", 1), formulation=formulation, **options)
    scene.problem().solve()
    for side in ("slave", "master"):
        mean, scatter = scene.pressure(side)
        assert abs(mean / exact - 1) < 0.01 and scatter / exact < 0.015


@pytest.mark.parametrize("cell", ("hexahedron", "tetrahedron"))
@pytest.mark.parametrize("kind", ("curved P1", "curved P2", "elevated P1"))
def test_shrink_fit_3d(cell, kind):
    """Lamé's pressure is found in 3D; with chords it is wrong by 70 %."""
    scene = ShrinkFit(SHELLS, cell=cell, **KINDS[kind], **LAGRANGE)
    scene.problem().solve()
    for side in ("slave", "master"):
        mean, scatter = scene.pressure(side)
        errors = abs(mean / exact_pressure() - 1), scatter / exact_pressure()
        assert errors[0] < 0.012 and errors[1] < 0.03


@pytest.mark.parametrize(("cell", "n"), [("triangle", RINGS), ("quadrilateral", RINGS[::-1])])
def test_shrink_fit_that_follows(cell, n):
    """The same holds with updated segmentation on meshes made by qs.elevate; chords fail."""
    found = []
    for degrees in ((1, 2), ("elevated", 2)):
        scene = ShrinkFit(n, cell=cell, degrees=degrees, sliding="finite")
        scene.problem().solve()
        mean, scatter = scene.pressure("slave")
        found.append(np.hypot(mean / exact_pressure() - 1, scatter / exact_pressure()))
    assert found[0] > 0.2 and found[1] < 0.008


@pytest.mark.parametrize(
    "n, cell",
    ((((24, 4), (31, 4)), "quadrilateral"), (((6, 2, 2), (8, 3, 2)), "tetrahedron")),
    ids=("2D", "3D"),
)
def test_closing_is_no_slip(n, cell):
    """Facets of degree 2 that close along their normals have no friction, with finite sliding."""
    scene = ShrinkFit(
        n, cell=cell, degrees=("elevated", 2), sliding="finite", friction=qs.Coulomb(0.3)
    )
    scene.problem().solve()
    for slip in scene.contact.model.slips:
        traction = np.linalg.norm(slip.state.response.traction, axis=1)
        assert largest(traction) < (0.03 if cell == "tetrahedron" else 3e-4) * exact_pressure()
        assert largest(slip.state.pressure) > 0.9 * exact_pressure()


@kinds
@both_ways
@pytest.mark.parametrize("n", (((31, 10), (52, 17)), ((52, 17), (31, 10))), ids=("fine", "coarse"))
def test_loaded_rings(n, swap, kind):
    """The pressure p + q cos 2θ is right within 1.2 % in L2, also with the finer side as slave."""
    scene = LoadedRings(n, swap, **KINDS[kind], **LAGRANGE)
    scene.problem().solve()
    assert max(scene.error(side) for side in ("slave", "master")) < 0.012
    if kind == "curved P1" and not swap:
        chords = LoadedRings(n, swap, **LAGRANGE)
        chords.problem().solve()
        assert chords.error("slave") > 0.1


# --- On a rigid cylinder


class OnCylinder:
    """A quarter of a ring from 9.995 to 15 on a cylinder of radius 10.005."""

    def __init__(self, n, degrees=(1, 1), cell="quadrilateral", **options):
        dim = len(n)
        center, axis = [0.0] * dim, None if dim == 2 else [0.0, 0.0, 1.0]
        self.ring = ring = Shell(n, (9.995, 15.0), cell, degrees=degrees)
        tool = qs.RigidSurface.cylinder(WORLD, center, axis, 10.005)
        options = {"quadrature": "overlay"} | options
        self.contact = qs.Contact(ring.surface(ring.inner), tool, **options)

    def error(self):
        """Return the L2 error of the pressure over Lamé's pressure. Collective."""
        ring = self.ring
        qs.ContactProblem([ring.F], [ring.u], [self.contact], [ring.symmetry()]).solve()
        E, nu = 200e3 / (1 - 0.3**2), 0.3 / 0.7
        exact = 0.01 * E / 10 / ((15**2 + 10**2) / (15**2 - 10**2) + nu)
        surface = self.contact.slave.linear
        t = surface.node_values(self.contact.traction("slave"))[:, :2]
        off = np.linalg.norm(t, axis=1) / exact - 1
        w = surface.node_area
        return np.sqrt(np.divide(*WORLD.allreduce(np.array([w @ off**2, w.sum()]))))


@pytest.mark.parametrize("n", ((22, 7), (16, 5), (17, 4, 5)))
@kinds
def test_ring_on_a_cylinder(n, kind):
    """Lamé's pressure is found; between facets it is wrong by 40 % and more."""
    options = KINDS[kind]
    cell = "quadrilateral" if len(n) == 2 else "hexahedron"
    scene = OnCylinder(n, cell=cell, **options, **LAGRANGE)
    assert largest(scene.contact.pairing.gap / 0.01 + 1) < 5e-4
    assert scene.error() < 0.01
    if kind == "curved P1" and len(n) == 2:
        assert OnCylinder(n, cell=cell, **LAGRANGE).error() > 0.4


def test_tool_of_fine_facets():
    """A ring on a rigid core of facets a tenth of its own has the misfit as its gap.

    A tool has no curved facets, and its facets cost no unknowns.
    """
    p = np.linspace(-0.1, np.pi / 2 + 0.1, 250)
    x = 10.005 * np.column_stack([np.cos(p), np.sin(p)])
    segments = np.column_stack([np.arange(249), np.arange(1, 250)])
    core = qs.RigidSurface.triangulated(WORLD, x, segments)
    ring = Shell((22, 7), (9.995, 15.0), degrees=("elevated", 1))
    gap = qs.Contact(ring.surface(ring.inner), core).pairing.gap
    assert WORLD.allreduce(len(gap)) > 20 and largest(gap / 0.01 + 1) < 0.01


# --- Surfaces that do not conform


@pytest.mark.parametrize("swap", (False, True))
def test_hertz(swap):
    """Curved facets, which displacements of degree 1 cannot flatten, keep the pressures of Hertz.

    Two cylinders: errors on both sides are those of flat facets.
    """
    hertz, found = Hertz(2, "cylinders"), []
    for curved in (False, True):
        bodies = []
        for sign, h in ((1, 0.1), (-1, 0.13)):
            msh = create_mesh(WORLD, "round", sign, 2, h, hertz.a)
            if curved:
                msh = qs.elevate(msh, facets=Body(msh, "round", sign).surface.facets)
            bodies.append(Body(msh, "round", sign))
            bodies[-1].press(sign)
        bodies[1].pin(1, 0.0, -8.0)
        slave, master = bodies[::-1] if swap else bodies
        contact = qs.Contact(slave.surface, master.surface, enforcement="penalty", sliding="small")
        problem = [[getattr(body, name) for body in (slave, master)] for name in ("F", "u", "bcs")]
        qs.ContactProblem(*problem[:2], [contact], problem[2]).solve()
        found.append(
            [
                errors(hertz, b, contact.traction(s))
                for b, s in ((slave, "slave"), (master, "master"))
            ]
        )
    np.testing.assert_allclose(found[1], found[0], atol=0.002)


# --- Meshes of degree 2


@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_straight_mesh_of_degree_2(cell):
    """On a straight mesh of degree 2 contact is the same as on the mesh of degree 1."""
    found = []
    for raise_degree in (lambda msh: msh, elevated):
        n, high = ((3, 2), [1.0, 1.0]) if cell == "triangle" else ((3, 2, 2), [1.0] * 3)
        msh = raise_degree(box(WORLD, n, cell, [0.0] * len(n), high))
        surface = qs.Surface(vector_space(msh), facets=plane(msh, len(n) - 1, 0.0))
        assert surface.heights is None
        tool = qs.RigidSurface.sphere(WORLD, [0.5] * (len(n) - 1) + [-3.0], 2.9)
        for quadrature in ("nodal", "overlay"):
            contact = qs.Contact(surface, tool, quadrature=quadrature, search_radius=1.0)
            gap, w = contact.pairing.gap, contact.pairing.weight
            found.append(WORLD.allreduce(np.array([w @ gap, w @ gap**2, surface.node_area.sum()])))
    np.testing.assert_allclose(found[:2], found[2:], rtol=1e-12)


@pytest.mark.parametrize("cell", ("triangle", "quadrilateral", "tetrahedron", "hexahedron"))
@pytest.mark.parametrize("degree", (1, 2))
def test_mesh_follows_displacements(cell, degree):
    """All mesh nodes move: a quadratic field of P2, a linear field on straight cells of P1."""
    gdim = 2 if cell in ("triangle", "quadrilateral") else 3
    msh = elevated(box(WORLD, (2,) * gdim, cell, [0.0] * gdim, [1.0] * gdim))
    u = fem.Function(fem.functionspace(msh, ("Lagrange", degree, (gdim,))))
    field = lambda x: np.stack([x[1] ** degree, x[0] * (2 if degree == 1 else x[1]), -x[2]])  # noqa: E731
    u.interpolate(lambda x: field(x)[:gdim])
    x = msh.geometry.x.copy()
    motion = MeshMotion(u)
    assert motion.quality() > 0.2
    expected = field(x.T).T
    expected[:, gdim:] = 0
    np.testing.assert_allclose(motion.values(), expected, atol=1e-14)
    motion.move(motion.values())
    np.testing.assert_allclose(msh.geometry.x, x + expected, atol=1e-14)


def test_quality_sees_nodes_inside_out():
    """A node beside an edge makes the Jacobian negative although all vertices stay in place."""
    msh = elevated(box(WORLD, (1, 1), "quadrilateral", [0.0, 0.0], [1.0, 1.0]))
    motion = MeshMotion(fem.Function(fem.functionspace(msh, ("Lagrange", 2, (2,)))))
    x = msh.geometry.x.copy()
    assert motion.quality(x) == pytest.approx(1.0)
    x[np.all(np.isclose(x, [0.5, 0.0, 0.0]), axis=1), 0] += 0.3
    assert motion.quality(x) < 0


@pytest.mark.parametrize("cell", ("quadrilateral", "tetrahedron"))
def test_rigid_fields(cell):
    """On curved facets A x + b is a field of degree 2."""
    n = (5, 2) if cell == "quadrilateral" else (4, 2, 2)
    shell = Shell(n, (5.0, 10.0), cell, degrees=(2, 2))
    surface, gdim = shell.surface(shell.outer), len(n)
    A, b = np.arange(9.0).reshape(3, 3)[:gdim, :gdim] / 7, np.arange(gdim) + 0.3
    u = fem.Function(shell.V)
    u.interpolate(lambda x: A @ x[:gdim] + b[:, None])
    dofs = fem.locate_dofs_topological(shell.V, gdim - 1, shell.outer)
    vec = affine_vec(surface, Affine(A, b))
    owned = dofs[dofs < shell.V.dofmap.index_map.size_local]
    rows = (owned[:, None] * gdim + np.arange(gdim)).ravel()
    np.testing.assert_allclose(vec.array_r[rows], u.x.array[rows], atol=1e-12)
    vec.destroy()


@pytest.mark.parametrize("kind", ("curved P2", "curved P1"))
def test_paired_anew(kind):
    """After a contact update on the deformed meshes the gap is the one left by the solve."""
    scene = ShrinkFit(RINGS, **KINDS[kind], **LAGRANGE)
    scene.problem().solve()
    for part in (scene.inner, scene.outer):
        motion = MeshMotion(part.u)
        motion.move(motion.values())
    scene.contact.update()
    assert largest(scene.contact.pairing.gap) < 0.01 * 0.01


@pytest.mark.parametrize("kind", ("curved P1", "curved P2"))
def test_true_gaps(kind):
    """After a solve surfaces touch: neither chords nor the flat parts of P2 facets add depth."""
    scene = ShrinkFit(RINGS, **KINDS[kind], **LAGRANGE)
    scene.problem().solve()
    assert scene.contact.penetration() < 0.02 * 0.01
    on_tool = OnCylinder((16, 5), **KINDS[kind], **LAGRANGE)
    on_tool.error()
    assert on_tool.contact.penetration() < 0.02 * 0.01


def test_heights_of_moved_meshes():
    """Bodies of twice the size have twice the gaps; the curved facets are evaluated again."""
    scene = ShrinkFit(RINGS, degrees=(2, 2))
    gap = scene.contact.pairing.gap
    for part in (scene.inner, scene.outer):
        part.mesh.geometry.x[:] *= 2
    scene.contact.update()
    np.testing.assert_allclose(scene.contact.pairing.gap, 2 * gap, rtol=1e-9)


@pytest.mark.parametrize("kind", ("curved P2", "curved P1"))
def test_balance_and_tangent(kind):
    """Forces of both sides cancel; the tangent is symmetric and the derivative of the residual."""
    scene = ShrinkFit(((6, 2), (8, 3)), cell="triangle", **KINDS[kind])
    problem = scene.problem()
    problem.solve()
    slave, master = (scene.contact.force(side) for side in ("slave", "master"))
    np.testing.assert_allclose(slave, -master, rtol=1e-9)
    rng = np.random.default_rng(3)
    x, d = near_solution(problem, rng, 1e-4), direction(problem, rng)
    errors = tangent_errors(problem, x, d, 1e-7)
    assert errors.difference < 1e-6 and errors.asymmetry < 1e-12
    x.destroy()
    d.destroy()


def test_time_steps():
    """A ring pressed in step by step on a moving mesh reaches the result of one solve."""
    scene = ShrinkFit(((6, 2), (8, 3)), **KINDS["curved P2"], **LAGRANGE)
    problem = scene.problem()

    def drive(t, dt):
        scene.contact.allow_overclosure(1 - min(t + dt, 1.0))

    stepper = qs.TimeStepper(problem, 0.5, drive)
    for _ in stepper.run(1.0):
        pass
    mean = scene.pressure("slave")[0]
    assert mean / exact_pressure() == pytest.approx(1, abs=0.01)


def test_fields(tmp_path):
    """Files of a curved mesh have all its nodes, with functions of degree 1 and 2 there."""
    folder = WORLD.bcast(tmp_path)
    shell = Shell((4, 2), (5.0, 10.0), degrees=(2, 2))
    shell.u.interpolate(lambda x: np.stack([x[1] ** 2, x[0]]))
    p = fem.Function(fem.functionspace(shell.mesh, ("Lagrange", 1)))
    for suffix in ("xdmf", "bp"):
        with qs.FieldWriter(folder / f"a.{suffix}", shell.mesh, {"u": shell.u, "p": p}) as writer:
            writer.write(0.0)
            shell.mesh.geometry.x[:, 0] += 0.5
            writer.write(1.0)
        shell.mesh.geometry.x[:, 0] -= 0.5
    x = stored(folder / "a.h5", "/Mesh/mesh/geometry").reshape(-1, 2)
    nodes = (2 * 4 + 1) * (2 * 2 + 1)
    assert len(x) == nodes
    for name, expected in (
        ("displacement", np.tile([0.5, 0.0], (nodes, 1))),
        ("u", np.column_stack([x[:, 1] ** 2, x[:, 0]])),
        ("p", np.zeros((nodes, 1))),
    ):
        found = stored(folder / "a.h5", f"/Function/{name}/1").reshape(nodes, -1)
        found = found[:, : expected.shape[1]]
        np.testing.assert_allclose(found, expected, atol=1e-10)


def test_refused():
    curved = ShrinkFit(RINGS, degrees=(2, 1))
    raises_everywhere(
        WORLD,
        ValueError,
        "quadrature: the nodal rule measures gaps to straight facets",
        lambda: qs.Contact(curved.contact.slave, curved.contact.master, quadrature="nodal"),
    )
    tool = qs.RigidSurface.cylinder(WORLD, [0.0, 0.0], None, 9.99)
    qs.Contact(curved.contact.master, tool, quadrature="nodal")  # the nodes do not move
    raises_everywhere(
        WORLD,
        ValueError,
        "V: contact facets of degree 2 are more curved than an arc of 60°",
        lambda: ShrinkFit(((1, 2), (2, 2)), degrees=(2, 1)),
    )


# --- Named surfaces


SQUARE = np.array([[0.3, 0.9, -0.2], [-0.8, 0.4, 0.5], [0.5, 0.1, 0.8]])
TURN = np.linalg.qr(SQUARE)[0]
AT = np.array([3.0, -2.0, 5.0])


def patch(shape, cell, n=(9, 8), uneven=0.2):
    """Make a block with one side mapped to a part of a surface, and the other sides below it."""
    msh = box(WORLD, (*n, 1), cell, [0.0] * 3, [1.0] * 3)
    V = vector_space(msh)
    facets = plane(msh, 2, 1.0)
    s, t, depth = msh.geometry.x.T.copy()
    s = s + uneven / n[0] * np.sin(9 * s) * np.sin(3 * t)
    msh.geometry.x[:] = shape(s, t, 1 - depth) @ TURN.T + AT
    return qs.Surface(V, facets=facets)


def plane_of(s, t, depth):
    return np.stack([2 * s, t, -depth], axis=1)


def cylinder_of(s, t, depth):
    r = 2 - depth
    return np.stack([r * np.cos(1.2 * s), r * np.sin(1.2 * s), 3 * t], axis=1)


def sphere_of(s, t, depth):
    r, a, b = 2 - depth, 0.9 * s, 0.4 + 0.8 * t
    return np.stack([r * np.cos(a) * np.cos(b), r * np.sin(a) * np.cos(b), r * np.sin(b)], axis=1)


def cone_of(s, t, depth):
    along = 2 + 2 * t
    r = along * np.tan(0.4) - 0.3 * depth
    return np.stack([r * np.cos(1.5 * s), r * np.sin(1.5 * s), along], axis=1)


def torus_of(s, t, depth):
    r, a, b = 0.8 - 0.5 * depth, 1.1 * s, 1.5 * t - 0.4
    away = 3 + r * np.cos(b)
    return np.stack([away * np.cos(a), away * np.sin(a), r * np.sin(b)], axis=1)


AXIS = TURN[:, 2]
SHAPES = {
    "plane": (plane_of, qs.smooth.Plane, lambda: qs.smooth.Plane(AT, AXIS)),
    "cylinder": (cylinder_of, qs.smooth.Cylinder, lambda: qs.smooth.Cylinder(AT, AXIS, 2.0)),
    "sphere": (sphere_of, qs.smooth.Sphere, lambda: qs.smooth.Sphere(AT, 2.0)),
    "cone": (cone_of, qs.smooth.Cone, lambda: qs.smooth.Cone(AT, AXIS, 0.4)),
    "torus": (torus_of, qs.smooth.Torus, lambda: qs.smooth.Torus(AT, AXIS, 3.0, 0.8)),
}


@pytest.mark.parametrize("cell", ("tetrahedron", "hexahedron"))
@pytest.mark.parametrize("name", SHAPES)
def test_fit(name, cell):
    """The fit recovers the surface through the vertices, wherever it is."""
    shape, kind, made = SHAPES[name]
    found, exact = kind.fit(patch(shape, cell)).shape, made().shape
    rng = np.random.default_rng(1)
    s, t = rng.random((2, 40))
    x = shape(s, t, np.full(40, 0.1)) @ TURN.T + AT
    distances = [np.abs(of.distance(x)[0]) for of in (found, exact)]
    np.testing.assert_allclose(*distances, atol=1e-9)
    assert np.all(distances[0] > 0.01)
    on = shape(s, t, np.zeros(40)) @ TURN.T + AT
    np.testing.assert_allclose(found.distance(on)[0], 0, atol=1e-9)


@pytest.mark.parametrize("turn", ([1, -1, -1], [-1, 1, -1], [-1, -1, 1]))
def test_fit_of_cones_in_any_direction(turn):
    """The axis leads from the apex into the cone."""
    found = qs.smooth.Cone.fit(patch(lambda *at: cone_of(*at) * turn, "hexahedron")).shape
    np.testing.assert_allclose(found.apex, AT, atol=1e-9)
    np.testing.assert_allclose(found.axis, turn[2] * AXIS, atol=1e-9)
    assert found.half_angle == pytest.approx(0.4, abs=1e-9)


def test_fit_in_2d():
    ring = Shell((12, 3), (5.0, 10.0))
    for name, R in (("inner", 5.0), ("outer", 10.0)):
        for kind in (qs.smooth.Cylinder, qs.smooth.Sphere):
            shape = kind.fit(ring.surface(getattr(ring, name))).shape
            assert shape.radius == pytest.approx(R, rel=1e-12)
            np.testing.assert_allclose(shape.center, 0, atol=1e-11)
    end = ring.surface(ring.ends[0][0])
    np.testing.assert_allclose(np.abs(qs.smooth.Plane.fit(end).shape.normal), [0, 1, 0], atol=1e-12)


def test_fit_of_noisy_vertices():
    """With noise of a part of the chord error, least squares are better than single vertices."""
    ring = Shell((40, 3), (5.0, 10.005))
    surface = ring.surface(ring.outer)
    chord = 10.005 * (1 - np.cos(np.pi / 160))
    x = ring.mesh.geometry.x
    angle = np.arctan2(x[:, 1], x[:, 0])
    x[:, :2] *= 1 + 0.05 * chord / 10 * np.sin(57 * angle)[:, None]
    surface.update()
    found = qs.smooth.Cylinder.fit(surface)
    assert abs(found.shape.radius - 10.005) < 0.05 * chord


def test_not_on_the_shape():
    ring = Shell((16, 5), (5.0, 10.0))
    surface = ring.surface(ring.outer)
    beside = qs.smooth.Plane([20.0, 0.0], [1.0, 0.0])
    for shape in [qs.smooth.Cylinder([0.0, 0.0], None, r) for r in (9.99, 10.01)] + [beside]:
        raises_everywhere(
            WORLD,
            ValueError,
            "shape: vertices of the surface are up to",
            lambda s=shape: qs.elevate(ring.mesh, facets=ring.outer, shape=s),
        )
    few = Shell((1, 2), (5.0, 10.0))
    raises_everywhere(
        WORLD,
        ValueError,
        "are not on the Cylinder, or too coarse for it",
        lambda: qs.smooth.Cylinder.fit(few.surface(few.outer)),
    )
    raises_everywhere(
        WORLD,
        ValueError,
        "surface are up to",
        lambda: qs.smooth.Plane.fit(surface),
    )
    raises_everywhere(
        WORLD, ValueError, "needs a surface in 3D", lambda: qs.smooth.Torus.fit(surface)
    )
    for wrong in (
        lambda: qs.smooth.Cylinder([0.0, 0.0, 0.0], None, 1.0),
        lambda: qs.smooth.Sphere([0.0, 0.0], -1.0),
        lambda: qs.smooth.Cone([0.0, 0.0, 0.0], [0, 0, 1], 2.0),
        lambda: qs.smooth.Torus([0.0, 0.0], [0, 0, 1], 2.0, 1.0),
    ):
        with pytest.raises(ValueError, match="must be"):
            wrong()
