"""Warnings at the first contact detection: once, on all ranks, and none without a cause."""

import re
import warnings

import numpy as np
import pytest
from curved_scenes import Rings, Shell, ShrinkFit
from hertz import Parameters, build
from scenes import (
    CELLS,
    FORMULATIONS,
    LAWS,
    WORLD,
    Pair,
    box,
    clamp,
    drag_top,
    elastic,
    largest,
    plane,
    vector_space,
)
from step_scenes import Upset

from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx._cpp import SearchRadius
from qsdolfinx.pairing.facets import sharp_nodes
from qsdolfinx.pairing.pair import find_conforming


def warned(call):
    """Return the texts of the contact warnings inside the call; they are the same on all ranks."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call()
    texts = [str(w.message) for w in caught if issubclass(w.category, qs.ContactWarning)]
    everywhere = WORLD.allgather(texts)
    assert all(other == texts for other in everywhere), everywhere
    return texts


def one(call, start):
    """Assert that there is one warning, and that it begins with the name of this argument."""
    texts = warned(call)
    assert len(texts) == 1 and texts[0].startswith(f"{start}: "), texts


def square(low, n=4, partition="forward"):
    """Make a unit square above ``low``; return its bottom and its top."""
    V = vector_space(box(WORLD, (n, n), "triangle", [0.0, low], [1.0, low + 1], partition))
    return [qs.Surface(V, facets=plane(V.mesh, 1, y)) for y in (low, low + 1)]


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
def test_nothing_to_warn_of(quadrature, formulation, law):
    def scenes():
        for cell in CELLS:
            options = {"contact_options": {"quadrature": quadrature}, "wave": 0.02}
            Pair(cell, formulation, law(), **options).contact.update()

    # touching waves share their curvature, and a tie keeps the gaps between their chords
    found = [text for text in warned(scenes) if law is qs.Tied or not text.startswith("facets: ")]
    assert found == []


# --- Few partners


@pytest.mark.parallel
def test_few_partners():
    """The message counts nodes beyond the search distance apart from those that are paired."""
    bottom, _ = square(0.02, 60)
    x = np.array([[-1.0, 1.0], [0.0, 0.0], [1.0, -1.0]])
    master = qs.RigidSurface.triangulated(WORLD, x, [[1, 0], [2, 1]])
    radius = 0.05
    (text,) = warned(
        lambda: qs.Contact(bottom, master, search_radius=radius, initial_overclosure="ignore")
    )
    words = r"only (\d+) of \d+ slave nodes .* but (\d+) others face .* from (\S+) on"
    found = re.search(words, text)
    assert found, text
    paired, others, away = int(found[1]), int(found[2]), float(found[3])
    assert 0 < paired and paired + others <= 61 and radius < away < radius + 2 / 60


# --- Finer master


@pytest.mark.parametrize("formulation", ("master-slave", "quasi-symmetric"))
@pytest.mark.parametrize("cell", ("triangle", "hexahedron"))
def test_finer_master(cell, formulation):
    """One warning, although contact detection and solves repeat; none with the remedies."""

    def steps():
        pair = Pair(cell, formulation, n=(9, 3), **nodal)
        pair.contact.update()
        pair.problem().solve()
        pair.contact.update()

    nodal = {"contact_options": {"quadrature": "nodal"}}
    one(steps, "quadrature")
    assert warned(lambda: Pair(cell, formulation, n=(9, 3))) == []
    assert warned(lambda: Pair(cell, formulation, n=(3, 9), **nodal)) == []
    assert warned(lambda: Pair(cell, formulation, n=(6, 3), **nodal)) == []


def test_finer_where_they_meet():
    """The warning depends on the master's facets below the slave, not on those elsewhere."""
    for inner, outer, count in ((0.02, 0.5, 1), (0.2, 0.001, 0)):
        near = np.arange(-0.2, 1.2, inner)
        far = np.arange(near[-1] + outer, near[-1] + 600 * outer, outer)
        x = np.concatenate([near, far])
        msh = box(WORLD, (len(x) - 1, 1), "triangle", [0.0, -1.0], [len(x) - 1.0, 0.0])
        msh.geometry.x[:, 0] = x[np.round(msh.geometry.x[:, 0]).astype(int)]
        V = vector_space(msh)
        master, slave = qs.Surface(V, facets=plane(msh, 1, 0.0)), square(0.0)[0]
        options = {"quadrature": "nodal", "search_radius": 0.2}
        texts = warned(lambda m=master, s=slave: qs.Contact(s, m, **options))
        assert len(texts) == count, texts


# --- Finer slave, soft penalty


def largest_shear(cell, n, factor, **options):
    """Return the largest friction at slave nodes of sticking blocks, and the warnings.

    Args:
        cell: Cell type of both blocks.
        n: Cells of the master and the slave along an edge.
        factor: Penalty over the stiffness of the softer side.
        options: Options of the contact.
    """
    formulation = options.pop("formulation", "quasi-symmetric")
    given = {"friction": qs.Coulomb(0.3), "enforcement": "penalty"} | options
    probe = Pair(cell, formulation, n=n, contact_options=given)
    problem = probe.problem()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        problem.set_up()
    penalty = factor * min(probe.contact.model.penalty.stiffness)
    pair = Pair(cell, formulation, n=n, penalty=penalty, contact_options=given)
    drag_top(pair, 0.01)
    found = warned(lambda: (pair.problem().solve(), pair.contact.update(), pair.problem().solve()))
    shear = pair.contact.traction("slave", part="tangential")
    return largest(pair.slave.node_values(shear)), found


@pytest.mark.parametrize("cell", ("quadrilateral", "hexahedron"))
def test_soft_penalty_at_nodes_of_a_finer_slave(cell):
    """The warning is given exactly where friction is several times too large."""
    nodal, finer, soft, stiff = {"quadrature": "nodal"}, (2, 8), 0.3, 100.0
    spikes, found = largest_shear(cell, finer, soft, **nodal)
    smooth, nothing = largest_shear(cell, finer, soft)
    assert len(found) == 1 and found[0].startswith("quadrature: ") and nothing == []
    assert spikes > 3 * smooth
    for n, factor, options in (
        (finer, stiff, {}),
        (finer, soft, {"formulation": "master-slave"}),
        (finer, soft, {"enforcement": "augmented-lagrangian"}),
        ((6, 6), soft, {}),
        ((6, 8), soft, {}),
    ):
        at_nodes, texts = largest_shear(cell, n, factor, **nodal | options)
        overlay, _ = largest_shear(cell, n, factor, **options)
        assert texts == [] and at_nodes < 2 * overlay, (n, factor, options, texts)


# --- No contact pairs


def test_out_of_reach():
    """A warning is given for bodies that are apart, or overlap, by more than the search radius."""
    for distance in (0.5, -0.5):
        slave, master = square(distance)[0], square(-1.0)[1]
        one(lambda s=slave, m=master: qs.Contact(s, m), "search_radius")
        found = warned(lambda s=slave, m=master: qs.Contact(s, m, search_radius=0.6))
        assert len(found) == (distance < 0) and all("penetrate" in text for text in found)
    tool = qs.RigidSurface.plane(WORLD, [0.0, -0.3], [0.0, 1.0])
    one(lambda: qs.Contact(square(0.0)[0], tool), "search_radius")


def test_free_side():
    """A side at right angles to a die, which it may fold onto later, has no pairs or warning."""
    V = vector_space(box(WORLD, (4, 4), "triangle", [0.0, 0.0], [1.0, 1.0]))
    side = qs.Surface(V, facets=plane(V.mesh, 0, 1.0))
    rigid = qs.RigidSurface.plane(WORLD, [0.0, -0.1], [0.0, 1.0])
    assert warned(lambda: qs.Contact(side, rigid)) == []
    assert warned(lambda: qs.Contact(side, square(-1.1)[1])) == []


def segments(turned):
    ends = [[1, 0]] if turned else [[0, 1]]
    return qs.RigidSurface.triangulated(WORLD, [[2.0, 0.0], [-1.0, 0.0]], ends)


@pytest.mark.parametrize(
    "tool",
    [
        lambda turned: qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, -1.0 if turned else 1.0]),
        lambda turned: qs.RigidSurface.sphere(WORLD, [0.5, -40.0], 40.0, inside=turned),
        segments,
    ],
    ids=("plane", "sphere", "segments"),
)
@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
def test_inverted_tool(tool, quadrature):
    slave = square(0.0, partition="backward")[0]
    kind = {"quadrature": quadrature}
    if tool is segments:  # the correct orientation is the one that gives pairs
        counts = [len(warned(lambda t=t: qs.Contact(slave, tool(t), **kind))) for t in (0, 1)]
        assert sorted(counts) == [0, 1]
        turned = bool(counts[1])
    else:
        assert warned(lambda: qs.Contact(slave, tool(False), **kind)) == []
        turned = True
    one(lambda: qs.Contact(slave, tool(turned), **kind), "normals")
    before = slave.node_normal.copy()
    assert np.all(before[:, 1] < 0)  # the slave normals are unchanged


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
def test_wrong_face(quadrature):
    """The lower block's bottom instead of its top, at the same height, gives a warning."""
    slave, master = square(0.0)[0], square(0.01, partition="backward")[0]
    one(lambda: qs.Contact(slave, master, quadrature=quadrature), "normals")


# --- Facets that approximate curves


#: Degrees of the mesh and of displacements.
CURVED = "elevated", 1
FINE, COARSE = ((64, 4), (90, 4)), ((16, 5), (22, 7))


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
@pytest.mark.parametrize("misfit", (0.01, -0.01))
def test_chords_of_a_fit(misfit, quadrature):
    """The warning compares the misfit with h²/8R of the coarser side and gives a facet size."""
    for swap in (False, True):
        scene = ShrinkFit(COARSE, swap, misfit)
        chord = 10.0 * (1 - np.cos(np.pi / 2 / 16 / 2))
        options = {"quadrature": quadrature, "search_radius": 0.5}
        sides = scene.contact.slave, scene.contact.master
        (text,) = warned(lambda s=sides, o=options: qs.Contact(*s, **o))
        assert text.startswith("facets: ") and "interference (0.01)" in text, text
        assert ('with quadrature="overlay"' in text) == (quadrature == "nodal")
        assert "qs.elevate(msh, facet_tags, tag)" in text
        first, second = map(float, re.search(r"facets \((\S+), (\S+)\)", text).groups())
        assert (second if swap else first) == pytest.approx(chord, rel=0.05)
        size = float(re.search(r"facets of size (\S+)", text).group(1))
        assert size == pytest.approx(0.01 / 0.4)


def test_chords_that_do_not_matter():
    """No warning for fine or matching facets, a large misfit, a tie, or with the remedy."""
    for options in (
        {"n": FINE},
        {"n": (COARSE[0], COARSE[0])},
        {"n": COARSE, "misfit": 0.2, "initial_overclosure": "ignore"},
        {"n": COARSE, "law": qs.Tied()},
        {"n": COARSE, "degrees": CURVED},
    ):
        assert warned(lambda o=options: ShrinkFit(**o)) == [], options


def rms(surface, values):
    """Return the root mean square over a surface, weighted with the areas of its nodes."""
    area = surface.node_area
    sums = WORLD.allreduce(np.array([area.sum(), area @ values**2]))
    return np.sqrt(sums[1] / sums[0])


@pytest.mark.parametrize("misfit, found", ((0.01, True), (0.08, False)))
def test_chords_and_pressure(misfit, found):
    """Facets fine compared with the interference may be coarse compared with their flattening.

    The warning gives the error of the pressures, up to the reduction by the penalty. The remedy
    works.
    """
    pressures, texts = [], []
    for degrees in ((1, 1), CURVED):
        scene = ShrinkFit(FINE, misfit=misfit, degrees=degrees, constraints="nodes")
        texts += warned(scene.problem().solve)
        surface = scene.contact.slave
        pressures.append(scene.contact.model.gaps[0].multiplier(scene.contact.model.eps)[:, 0])
    assert len(texts) == found, texts
    mean = rms(surface, pressures[1])  # it is nearly constant over the surface
    error = rms(surface, pressures[0] - pressures[1]) / mean
    assert (error > 0.1) == found
    if found:
        assert texts[0].startswith("facets: ") and "qs.elevate" in texts[0]
        said = float(re.search(r"wrong by (\d+)%", texts[0]).group(1)) / 100
        assert 0.75 * error < said < 1.05 * error


class PinInBore(Rings):
    """Pin that is pressed into a bore with clearance, by less than the clearance."""

    def __init__(self, n, clearance, depth, degrees):
        radii = (0.4, 1.0), (1.0 + clearance, 2.0)
        super().__init__(n, radii, degrees=degrees, search_radius=0.1, sliding="small")
        self.motion = np.array([clearance + depth, 0.0])

    def problem(self):
        bodies, conditions = (self.inner, self.outer), []
        for body, facets, value in (
            (self.inner, self.inner.inner, self.motion),
            (self.outer, self.outer.outer, np.zeros(2)),
        ):
            dofs = fem.locate_dofs_topological(body.V, 1, facets)
            conditions.append([body.symmetry()[0], fem.dirichletbc(value, dofs, body.V)])
        return qs.ContactProblem(
            [body.F for body in bodies], [body.u for body in bodies], [self.contact], conditions
        )


@pytest.mark.parametrize("n, depth, found", ((24, 0.005, True), (80, 0.1, False)))
def test_chords_beside_the_approach(n, depth, found):
    """Facets fine compared with the clearance may be coarse compared with the approach."""
    forces, texts = [], []
    for degrees in ((1, 1), CURVED):
        scene = PinInBore(((n, 4), (n * 5 // 8, 4)), 0.02, depth, degrees)
        texts += warned(scene.problem().solve)
        forces.append(scene.contact.force("slave")[0])
    assert [text.startswith("facets: ") for text in texts] == [True] * found, texts
    assert (abs(forces[0] / forces[1] - 1) > 0.1) == found


@pytest.mark.parametrize("degrees", ((2, 1), (2, 2)))
@pytest.mark.parametrize("n, misfit", ((COARSE, 0.01), (FINE, 0.01), (COARSE, -0.01)))
def test_chords_of_bent_facets_that_follow(n, misfit, degrees):
    """Displacements of degree 1 leave bent facets flat; the warning does not suggest qs.elevate."""

    def fit(sliding):
        scene = ShrinkFit(n, misfit=misfit, degrees=degrees, sliding=sliding, search_radius=0.5)
        if misfit > 0:
            scene.problem().solve()
            found.append(largest(scene.contact.force("slave")))

    found = []
    texts, none = warned(lambda: fit("finite")), warned(lambda: fit("small"))
    assert none == [] and len(texts) == (degrees[1] == 1), texts
    if texts and n is COARSE:  # when the contact is made; otherwise from its pressures
        assert 'sliding="small"' in texts[0] and "displacements of degree 2" in texts[0]
        assert "qs.elevate" not in texts[0]
    if misfit > 0 and n is COARSE:
        assert (abs(found[0] / found[1] - 1) > 0.01) == bool(texts)


def test_chords_of_bent_facets_that_follow_a_shaft():
    """The same holds on an analytic tool, which has no chord errors."""
    tool = qs.RigidSurface.cylinder(WORLD, [0.0, 0.0], None, 10.005)
    for degrees, sliding, count in (
        ((2, 1), "finite", 1),
        ((2, 1), "small", 0),
        ((2, 2), "finite", 0),
    ):
        ring = Shell((22, 3), (9.995, 15.0), degrees=degrees)
        texts = warned(lambda r=ring, s=sliding: qs.Contact(r.surface(r.inner), tool, sliding=s))
        assert len(texts) == count, texts
        assert all('sliding="small"' in text for text in texts)


@pytest.mark.parametrize("quadrature", ("nodal", "overlay"))
def test_chords_of_hertz(quadrature):
    """No warning for nonconforming surfaces: two cylinders, a cylinder or a sphere on a block."""
    for options in ({"case": "cylinders"}, {"ratio": 2.0}, {"dim": 3, "h": 0.3}):
        parameters = Parameters(**({"h": 0.1, "quadrature": quadrature} | options))
        found = warned(lambda p=parameters: build(WORLD, p))
        assert [text for text in found if text.startswith("facets")] == []


def test_chords_on_a_tool():
    """A ring on a rigid cylinder warns; not if curved, fine, with a large misfit, or at nodes."""
    for n, R, found in ((22, 10.005, 1), (22, 9.0, 0), (150, 9.9, 0)):
        ring = Shell((n, 3), (9.995, 15.0))
        tool = qs.RigidSurface.cylinder(WORLD, [0.0, 0.0], None, R)
        slave, radius = ring.surface(ring.inner), {"search_radius": 2.0}
        texts = warned(lambda s=slave, t=tool, o=radius: qs.Contact(s, t, **o))
        assert len(texts) == found
        if found:
            assert texts[0].startswith("facets: ") and "interference (0.01)" in texts[0]
            error = float(re.search(r"facets \((\S+)\) changes the gap", texts[0]).group(1))
            chord = 9.995 * (1 - np.cos(np.pi / 4 / n))
            assert error == pytest.approx(chord, rel=0.1)
            size = float(re.search(r"facets of size (\S+)", texts[0]).group(1))
            assert size == pytest.approx(0.01 / 0.4)
        curved = Shell((n, 3), (9.995, 15.0), degrees=CURVED)
        of_curved = curved.surface(curved.inner)
        assert warned(lambda s=of_curved, t=tool, o=radius: qs.Contact(s, t, **o)) == []
        for options in (radius | {"quadrature": "nodal"}, radius | {"law": qs.Tied()}):
            assert warned(lambda s=slave, t=tool, o=options: qs.Contact(s, t, **o)) == []


def test_size_of_finer_facets():
    """Facets of the named size h have a chord error h²/8R of a tenth of the interference."""
    options = {"search_radius": 4.0, "initial_overclosure": "ignore"}
    texts = warned(lambda: ShrinkFit(((3, 2), (4, 2)), misfit=2.0, **options))
    size = float(re.search(r"facets of size (\S+)", texts[0]).group(1))
    assert size**2 / (8 * ShrinkFit.R) == pytest.approx(0.1 * 2.0, rel=0.1)


def on_cone(sides, slope, n=7, away=0.0):
    """Make a block whose top is pressed into the shape of a cone of flat facets, and the cone.

    Args:
        sides: Number of facets.
        slope: Slope of the facets.
        n: Cells of the block along its sides.
        away: Distance of the cone above the block.
    """
    msh = box(WORLD, [n, n, 2], "hexahedron", [-1.0, -1.0, -1.0], [1.0, 1.0, 0.0], "scattered")
    top = plane(msh, 2, 0.0)
    angle = 2 * np.pi * np.arange(sides) / sides + 0.1
    normals = np.column_stack([np.cos(angle), np.sin(angle)])
    x = msh.geometry.x
    x[:, 2] += (1 + x[:, 2]) * slope * (x[:, :2] @ normals.T).max(axis=1)
    middle = angle + np.pi / sides  # direction of the edges between two facets
    rim = 3.0 / np.cos(np.pi / sides) * np.column_stack([np.cos(middle), np.sin(middle)])
    corners = np.vstack([[0.0, 0.0, 0.0], np.column_stack([rim, np.full(sides, 3 * slope)])])
    corners[:, 2] += away
    i = np.arange(sides)
    triangles = np.column_stack([0 * i, 1 + np.roll(i, -1), 1 + i])
    V = vector_space(msh)
    return qs.Surface(V, facets=top), qs.RigidSurface.triangulated(WORLD, corners, triangles)


@pytest.mark.parametrize("sides, away", ((4, 0.0), (4, 0.1), (5, 0.01), (12, 0.0)))
def test_flat_facets_are_no_chords(sides, away):
    """The edges of pyramids and cones that shaped a body are edges, and give no chord warning."""
    slave, tool = on_cone(sides, 0.1, away=away)
    texts = warned(lambda: qs.Contact(slave, tool, search_radius=0.5))
    assert [text for text in texts if text.startswith("facets")] == []


def test_chords_of_one_side():
    """A mesh of degree 2 has no chord errors; those of the other side count."""
    assert warned(lambda: ShrinkFit(COARSE, degrees=(2, 1))) == []
    sides = ShrinkFit(COARSE, degrees=CURVED).contact.slave, ShrinkFit(COARSE).contact.master
    (text,) = warned(lambda: qs.Contact(*sides))
    first, second = map(float, re.search(r"facets \((\S+), (\S+)\)", text).groups())
    assert first == 0
    assert second == pytest.approx(9.995 * (1 - np.cos(np.pi / 88)), rel=0.35)


def test_what_conforms():
    """A pin conforms to its hole everywhere; two pins of different radii conform nowhere."""
    fit = ShrinkFit(COARSE).contact
    pins = [Shell((n, 2), (5.0, R)) for n, R in ((16, 10.0), (30, 15.0))]
    x = pins[1].mesh.geometry.x
    x[:, :2] = 25.0 / np.sqrt(2.0) - x[:, :2]  # they touch at half of the quarter circle
    slave, master = (pin.surface(pin.outer) for pin in pins)
    for pair, part in (((fit.slave, fit.master), 1.0), ((slave, master), 0.0)):
        assert find_conforming(*pair, degree=2, radius=SearchRadius(1.0)).part == pytest.approx(
            part
        )
    assert warned(lambda: qs.Contact(slave, master)) == []
    assert WORLD.allreduce(len(qs.Contact(slave, master).pairing)) > 0


# --- Penetration


def test_deep_overclosure():
    def contact(depth, **options):
        return lambda: qs.Contact(square(-depth)[0], square(-1.0)[1], **options)

    one(contact(0.1), "initial_overclosure")
    assert warned(contact(0.05)) == []
    assert warned(contact(0.1, initial_overclosure="ignore")) == []
    assert warned(contact(0.1, law=qs.Tied())) == []


# --- How warnings are shown


def test_not_in_a_loop():
    """A correct run gives no warning in any of its steps."""

    def run():
        for _ in Upset().stepper.run(0.1):
            pass

    assert warned(run) == []


def on_its_corner(n, degree=1, **options):
    """Make a square on its corner above a floor; return the problem and the floor."""
    msh = box(WORLD, [n, n], "quadrilateral", [0.0, 0.0], [1.0, 1.0])
    low = np.concatenate([plane(msh, axis, 0.0) for axis in (0, 1)])
    far = np.concatenate([plane(msh, axis, 1.0) for axis in (0, 1)])
    x, c = msh.geometry.x, np.sqrt(0.5)
    x[:, 0], x[:, 1] = c * (x[:, 0] - x[:, 1]), c * (x[:, 0] + x[:, 1])
    V = fem.functionspace(msh, ("Lagrange", degree, (2,)))
    u = fem.Function(V)
    floor = qs.RigidSurface.plane(WORLD, [0.0, 0.0], [0.0, 1.0])
    options = {"constraints": "nodes"} | options
    contact = qs.Contact(qs.Surface(V, facets=np.unique(low)), floor, **options)
    return qs.ContactProblem([elastic(u)], [u], [contact], [[clamp(V, far)]]), floor


def corners(texts):
    """Select the warnings about corners."""
    return [text.startswith("constraints: a corner of the slave") for text in texts]


@pytest.mark.parametrize("degree", (1, 2))
@pytest.mark.parametrize("depth, found", ((0.005, False), (0.02, True), (0.15, True), (0.5, True)))
def test_a_corner_that_sinks(depth, found, degree):
    """Under a corner mean gaps stay open, without force, up to a depth of .23 facets.

    At a larger depth there is some force, but too little.
    """
    problem, floor = on_its_corner(8, degree)
    floor.displacement = [0.0, depth / 8]
    assert corners(warned(problem.solve)) == [True] * found
    assert (problem.contacts[0].force("slave")[1] > 0) == (depth > 0.23)


@pytest.mark.parametrize("degree", (1, 2))
@pytest.mark.parametrize("constraints", ("nodes", "points"))
def test_a_corner_of_a_cube_that_sinks(constraints, degree):
    """A cube's corner sinks a third of an edge without force with nodes, and not with points."""
    n = 4
    msh = box(WORLD, [n, n, n], "hexahedron", [0.0] * 3, [1.0] * 3)
    low = np.concatenate([plane(msh, axis, 0.0) for axis in range(3)])
    far = np.concatenate([plane(msh, axis, 1.0) for axis in range(3)])
    V = fem.functionspace(msh, ("Lagrange", degree, (3,)))
    u, up = fem.Function(V), np.ones(3) / np.sqrt(3)
    floor = qs.RigidSurface.plane(WORLD, [0.0] * 3, up)
    surface = qs.Surface(V, facets=np.unique(low))
    contact = qs.Contact(surface, floor, constraints=constraints)
    problem = qs.ContactProblem([elastic(u)], [u], [contact], [[clamp(V, far)]])
    floor.displacement = 0.32 / n * up
    texts = [text for text in warned(problem.solve) if corners([text])[0]]
    assert len(texts) == (constraints == "nodes")
    assert (abs(contact.force("slave") @ up) < 1e-9) == (constraints == "nodes")


@pytest.mark.parametrize("degrees, found", (((1, 1), True), ((2, 1), False), ((2, 2), False)))
def test_curved_facets_have_no_corners(degrees, found):
    """A coarse roller has no corners: its chords meet at 45°, its arcs of degree 2 smoothly."""
    shell = Shell((2, 1), (0.4, 1.0), degrees=degrees)
    x = shell.mesh.geometry.x
    x[:, 0], x[:, 1] = (x[:, 0] + x[:, 1]) / np.sqrt(2), (x[:, 0] - x[:, 1]) / np.sqrt(2)
    assert WORLD.allreduce(int(sharp_nodes(shell.surface(shell.outer)).sum())) == found
