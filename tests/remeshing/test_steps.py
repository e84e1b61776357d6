"""Time steps with remeshing."""

import warnings

import numpy as np
import pytest
from friction.weakening import Weakening
from remeshing_scenes import Upset, tagged
from scenes import WORLD, box, elastic, plane, slide, vector_space

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.contact import multipliers

pytest.importorskip("gmsh")


def state(case):
    """State that a failed remeshing must not change."""
    stepper = case.stepper
    arrays = [u.x.array for u in stepper.problem.u]
    arrays += [motion.mesh.geometry.x for motion in stepper.motions]
    arrays += [m for c in stepper.problem.contacts for m in multipliers.on_nodes(c.model.parts)]
    arrays += [tool.position for tool in case.tools] + [tool.displacement for tool in case.tools]
    return [a.copy() for a in arrays] + [np.array([stepper.t, stepper.num_steps])]


def same(first, second):
    equal = all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))
    return WORLD.allreduce(int(not equal)) == 0


@pytest.mark.parametrize(
    ("dim", "size", "friction", "within"),
    [
        pytest.param(2, 1.25, None, 2e-3, marks=pytest.mark.long),
        (2, 1.25, lambda: qs.Tresca(8.0), 5e-3),
        pytest.param(3, 3.5, None, 0.01, marks=pytest.mark.long),
    ],
    ids=["axisymmetric", "barrel", "quarter"],
)
def test_upsetting_goes_on_as_on_one_mesh(dim, size, friction, within):
    alone = Upset(dim, size, friction).run()
    case = Upset(dim, size, friction, remesh={"every": 3})
    forces = case.run()
    assert len(case.stepper.remeshings) == 3 and case.num_built == 4
    assert np.allclose(forces, alone, rtol=within)
    for report in case.stepper.remeshings:
        assert report.volume_change < 1e-4 and report.force_jump < 5e-3
        assert all(np.allclose(m[0], m[1], rtol=1e-12) for m in report.multipliers)
        assert np.isclose(*report.energy, rtol=2e-3)
        assert report.bodies[0].quality > 0.1 and report.num_cells > 50
        assert "every = 3" in str(report)


@pytest.mark.several_ranks
def test_forces_are_the_same_on_any_partition():
    """Forces with remeshing are the same on one rank and on all ranks."""
    alone, together = (
        Upset(2, 2.5, lambda: qs.Tresca(8.0), remesh={"every": 4}, comm=comm).run()
        for comm in (WORLD.Split(WORLD.rank), WORLD)
    )
    assert np.allclose(alone, together, rtol=1e-6)


def test_friction_goes_on_where_it_was():
    case = Upset(2, 1.25, lambda: qs.CoulombTresca(0.1, 0.5, 30.0), remesh={"min_quality": None})
    for _ in range(4):
        case.stepper.step()
    before = [c.dissipated_energy() for c in case.contacts]
    slip = [np.linalg.norm(c.slip(), axis=1).max(initial=0.0) for c in case.contacts]
    slip = [max(WORLD.allgather(s)) for s in slip]
    report = case.stepper.remesh()
    assert np.allclose([c.dissipated_energy() for c in case.contacts], before)
    found = [np.linalg.norm(c.slip(), axis=1).max(initial=0.0) for c in case.contacts]
    assert np.allclose([max(WORLD.allgather(s)) for s in found], slip, rtol=0.1)
    assert report.force_jump < 5e-3 and report.why == "asked for"


def test_history_of_a_friction_law_goes_on():
    """A new mesh keeps the history variables of a friction law, and its friction."""
    law = lambda: Weakening(0.2, 0.05, 1.0)  # noqa: E731
    alone = Upset(2, 1.25, law, num_steps=6)
    case = Upset(2, 1.25, law, num_steps=6, remesh={"every": 3})
    forces = [alone.run(), case.run()]
    assert np.allclose(*forces, rtol=5e-3)

    def total(scene):
        contact = scene.contacts[1]
        contact.slave.linear.update()  # areas at the end of the step
        return WORLD.allreduce(contact.memory("way") @ contact.slave.linear.node_area)

    before = total(case)
    assert before == pytest.approx(total(alone), rel=0.02) and before > 0
    case.stepper.remesh()
    assert total(case) == pytest.approx(before, rel=1e-3)


def test_criteria():
    by_quality = Upset(2, 2.5, remesh={"min_quality": 0.9})
    asked = []
    when = {"min_quality": None, "when": lambda s: asked.append(s.num_steps) or s.num_steps == 2}
    by_function = Upset(2, 2.5, remesh=when)
    for case in (by_quality, by_function):
        for _ in range(4):
            case.stepper.step()
    assert [r.step for r in by_quality.stepper.remeshings] == [0, 1, 2, 3]
    assert "below min_quality = 0.9" in by_quality.stepper.remeshings[0].why
    assert [r.step for r in by_function.stepper.remeshings] == [2] and asked == [0, 1, 2, 3]


def test_distorted_mesh_is_replaced_before_a_step_fails():
    limits = {"min_quality": 0.8}
    with pytest.raises(qs.StepError, match="is distorted"):
        Upset(2, 2.5, **limits).run()
    case = Upset(2, 2.5, remesh={"min_quality": None}, **limits)
    case.run()
    assert case.stepper.t == case.t_end and len(case.stepper.remeshings) > 0
    assert "is distorted" in case.stepper.remeshings[0].why


class Failing(Upset):
    """An upsetting whose rebuilt problems have a fault."""

    fault = None

    def build(self, meshes, tags):
        problem = super().build(meshes, tags)
        if self.num_built > 1 and self.fault == "build":
            raise ValueError("no problem")
        if self.num_built > 1 and self.fault == "contacts":
            return qs.ContactProblem([self.body.F], [self.body.w], self.contacts[:1])
        return problem

    def solve(self, step):
        if self.num_built > 1 and self.fault == "solve":
            raise qs.ConvergenceError(-5, [1.0], [])
        super().solve(step)


@pytest.mark.parametrize(
    ("fault", "error", "text"),
    [
        ("build", ValueError, "no problem"),
        ("contacts", ValueError, "build: the problem must have the same contacts"),
        ("solve", qs.StepError, "no equilibrium on the new mesh"),
    ],
)
def test_what_fails_keeps_the_last_state(fault, error, text):
    case = Failing(2, 2.5, remesh={"every": 2, "min_quality": None})
    for _ in range(2):
        case.stepper.step()
    before, problem = state(case), case.stepper.problem
    case.fault = fault
    with pytest.raises(error, match=text):
        case.stepper.step()
    assert case.stepper.problem is problem and same(before, state(case))
    assert case.stepper.remeshings == []


def test_no_mesh_keeps_the_last_state():
    """If no mesh can be made, the state is kept.

    A node of the axis lies beyond the side, so the boundary intersects itself.
    """
    case = Upset(2, 2.5, remesh={"min_quality": None})
    case.stepper.step()
    motion = case.stepper.motions[0]
    x = motion.reference.copy()
    x[np.isclose(x[:, 0], 0) & np.isclose(x[:, 1], 7.5, atol=1.3), 0] = 30.0
    kept = motion.reference.copy()
    motion.set_reference(x)
    before = state(case)
    with pytest.raises(qs.RemeshError, match="passes through itself at") as caught:
        case.stepper.remesh()
    assert len(caught.value.where) > 0
    assert same(before, state(case)) and case.num_built == 1
    motion.set_reference(kept)
    case.stepper.step()


def test_wrong_settings_are_refused():
    case = Upset(2, 5.0)
    with pytest.raises(RuntimeError, match="nothing to make a new mesh with"):
        case.stepper.remesh()
    for options, text in (
        ({"size": -1.0}, "size"),
        ({"size": 1.0, "every": 0}, "every"),
        ({"size": 1.0, "facet_tags": [None, None]}, "facet_tags must be a list of 1"),
    ):
        with pytest.raises(ValueError, match=text):
            qs.TimeStepper(case.stepper.problem, 0.1, remesh=qs.Remeshing(case.build, **options))


def test_a_jump_of_forces_is_told():
    """A warning is given if forces change by remeshing, as with much larger cells."""
    case = Upset(2, 1.25, lambda: qs.Tresca(20.0), remesh={"min_quality": None})
    for _ in range(3):
        case.stepper.step()
    case.stepper.remeshing.size = 6.0
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        report = case.stepper.remesh()
    jumps = [w for w in told if "forces changed by" in str(w.message)]
    assert (len(jumps) == 1) == (report.force_jump > 0.005)


class OnDie:
    """A viscous block pressed on a wider elastic die, plane strain; the block alone flows."""

    def __init__(self, remesh=None):
        self.tool = qs.RigidSurface.plane(WORLD, [0.0, 1.0], [0.0, -1.0])
        meshes = [
            box(WORLD, (5, 5), "triangle", [0.0, 0.0], [1.0, 1.0]),
            box(WORLD, (8, 3), "triangle", [0.0, -1.0], [2.0, 0.0]),
        ]
        tags = [tagged(meshes[0], [(0, 0.0), (1, 0.0), (1, 1.0)]), None]
        problem = self.build(meshes, tags)
        options = (
            {} if remesh is None else {"remesh": qs.Remeshing(self.build, 0.2, tags, **remesh)}
        )
        self.stepper = qs.TimeStepper(problem, 0.02, self.drive, **options)

    def build(self, meshes, tags):
        W, D = qs.materials.mini_space(meshes[0]), vector_space(meshes[1])
        self.w, self.u = fem.Function(W), fem.Function(D)
        V, block = W.sub(0), tags[0]
        stress = qs.materials.newtonian(ufl.split(self.w)[0], 3.0)
        axis = fem.locate_dofs_topological(V.sub(0), 1, block.find(1))
        bcs = [
            [fem.dirichletbc(0.0, axis, V.sub(0))],
            [slide(D, i, plane(meshes[1], 1, -1.0)) for i in (0, 1)]
            + [slide(D, 0, plane(meshes[1], 0, 0.0))],
        ]
        die = qs.Surface(D, facets=plane(meshes[1], 1, 0.0))
        options = {"dt": 0.02}
        self.contacts = [
            qs.Contact(
                qs.Surface(V, block, 2), die, unknown=("velocity", "displacement"), **options
            ),
            qs.Contact(qs.Surface(V, block, 3), self.tool, unknown="velocity", **options),
        ]
        forms = [qs.materials.incompressible(self.w, stress), elastic(self.u, E=200.0)]
        return qs.ContactProblem(forms, [self.w, self.u], self.contacts, bcs)

    def drive(self, t, dt):
        self.tool.displacement = [0.0, -dt]

    def run(self):
        return np.array(
            [[c.force("slave")[1] for c in self.contacts] for _ in self.stepper.run(0.2)]
        )


def test_elastic_die_keeps_its_mesh_and_its_displacement():
    alone = OnDie().run()
    case = OnDie({"every": 3, "min_quality": None})
    die = case.stepper.motions[1].mesh
    assert np.allclose(case.run(), alone, rtol=0.01)
    assert case.stepper.motions[1].mesh is die and len(case.stepper.remeshings) == 3
    for report in case.stepper.remeshings:
        assert report.bodies[1] is None and report.force_jump < 5e-3
        assert all(np.allclose(*m, rtol=1e-10) for m in report.multipliers)
