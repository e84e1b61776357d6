"""A table of malformed inputs to the whole public interface.

Every row is one wrong argument in an otherwise valid call. All ranks refuse it with one exception
that names the argument, and nothing is changed. For a collective call, the same holds if the last
rank alone has the wrong argument. Errors of several arguments are in ``test_bad_input.py``.
"""

import pathlib
import typing
from functools import partial

import numpy as np
import pytest
from base.malformed_scene import GOOD, LOCAL, Of, Scene
from scenes import WORLD

import ufl
from dolfinx import fem

import qsdolfinx as qs

V, T = ValueError, TypeError
nan, inf = float("nan"), float("inf")
NOT_POSITIVE = (-1.0, 0.0, nan, inf, -inf, True)
TYPES = ("ksp_type", "pc_type", "snes_type")
THREE = np.array([[2.0, 0.0], [1.0, 0.0], [0.0, 0.0]])
SPACES = (
    (("Lagrange", 1, (3,)), "contact needs a blocked vector"),
    (("Lagrange", 3, (2,)), "the trace"),
    (("DG", 1, (2,)), "the trace"),
    (("CR", 1, (2,)), "the trace"),
)


def space(element, scene):
    return fem.functionspace(scene.case.mesh, element)


class Row(typing.NamedTuple):
    """One wrong argument.

    Attributes:
        target: Name of a valid call.
        name: Name of the argument.
        value: The wrong value.
        error: Exception that is raised.
        everywhere: Whether the argument that it replaces carries the communicator.
        says: A part of the message.
    """

    target: str
    name: str
    value: object
    error: type[Exception] | tuple[type[Exception], ...]
    everywhere: bool = False
    says: str = ""


ROWS = [
    Row("Surface", "V", None, T, True),
    Row("Surface", "V", Of(lambda s: s.case.w), T, True),
    Row("Surface", "V", Of(lambda s: s.numbers), V, True),
    Row("Surface", "V", Of(lambda s: s.constants), V, True),
    Row("Surface", "V", Of(lambda s: s.tensors), V, True),
    Row("Surface", "V", Of(lambda s: s.case.W), V, True),
    Row("Surface", "V", Of(lambda s: s.on_membrane), V, True),
    Row("Surface", "V", Of(lambda s: s.case.mesh), T, True),
    *(Row("Surface", "V", Of(partial(space, e)), V, True, f"V: {says}") for e, says in SPACES),
    Row("Surface", "facets", Of(lambda s: s.interior), V),
    Row("Surface", "facets", Of(lambda s: [[0, 1], [2, 3]]), V),
    Row("Surface", "facets", "bottom", V),
    Row("Surface", "facets", [True, False], V),
    Row("Surface", "facets", [0.0], V),
    Row("Surface", "facets", [2**40], V),
    Row("Surface", "facets", [-5], V),
    Row("Surface", "facets", [10**6], V),
    Row("Surface", "facets", [], V, True, "empty"),
    Row("Surface", "facets", None, T),
    Row("Surface", "axisymmetric", "yes", T),
    Row("tagged", "facet_tags", Of(lambda s: s.tags_of_cells), V),
    Row("tagged", "facet_tags", Of(lambda s: s.tags_of_other), V),
    Row("tagged", "facet_tags", Of(lambda s: s.facets), T),
    Row("tagged", "tag", 1.0, T),
    Row("tagged", "tag", None, T),
    Row("tagged", "tag", True, T),
    Row("tagged", "tag", "1", T),
    Row("tagged", "tag", 77, V, True, "empty"),
    Row("tagged", "facets", Of(lambda s: s.facets), T),
    Row("Surface.function", "values", np.zeros((1, 7)), V),
    Row("Surface.function", "values", "zero", V),
    Row("Surface.node_values", "function", Of(lambda s: s.other_function), V),
    Row("Surface.node_values", "function", 3, T),
    Row("Contact", "slave", Of(lambda s: s.other_comm), V, True),
    Row("Contact", "slave", Of(lambda s: s.pair.V[1]), T, True),
    Row("Contact", "master", Of(lambda s: s.of_3d), V, True, "dimension"),
    Row("Contact", "master", Of(lambda s: s.slave_again), V, True, "share facets"),
    Row("Contact", "master", None, T),
    Row("Contact", "master", Of(lambda s: s.tool_3d), V, True),
    Row("Contact", "master", qs.RigidSurface, T),
    Row("Contact", "formulation", None, V),
    Row("Contact", "formulation", ["master-slave"], V),
    Row("Contact", "formulation", np.array(["master-slave", "nodal"]), V),
    Row("Contact", "formulation", "mortar", V),
    Row("Contact", "law", "tied", T),
    Row("Contact", "law", qs.Tied, T),
    *(Row("Contact", "penalty", bad, V) for bad in (*NOT_POSITIVE, "1e3", None, [1.0], 1e3 + 0j)),
    Row("Contact", "penalty", np.array([1e3, 1e3]), V),
    *(Row("Contact", "search_radius", bad, V) for bad in (*NOT_POSITIVE, "far")),
    Row("Contact", "quadrature", "exact", V),
    Row("Contact", "quadrature", 2, V),
    Row("Contact", "quadrature_degree", 0, V),
    Row("Contact", "quadrature_degree", 2.5, V),
    Row("Contact", "quadrature_degree", True, V),
    Row("Contact", "normals", "outward", V),
    Row("Contact", "enforcement", "multiplier", V),
    Row("Contact", "gap_tolerance", 0, V),
    Row("Contact", "gap_tolerance", nan, V),
    Row("Contact", "gap_tolerance", -1.0, V),
    Row("Contact", "unknown", "pressure", V),
    Row("Contact", "unknown", 3, (V, T)),
    Row("Contact", "unknown", ("velocity",), V),
    Row("Contact", "dt", 0.1, V),
    Row("Contact in velocities", "dt", None, V),
    Row("Contact in velocities", "dt", -0.1, V),
    Row("Contact in velocities", "dt", "0.1", V),
    Row("Contact", "friction", 0.3, T),
    Row("Contact", "friction", qs.Coulomb, T),
    Row("Contact", "friction_penalty", 3.0, V),
    Row("Contact with friction", "friction_penalty", -3.0, V),
    Row("Contact with Norton", "dt", None, V),
    Row("Contact with friction", "friction", Of(lambda s: qs.Coulomb(s.on_other_mesh)), V),
    Row("Contact.set_penalty", "penalty", nan, V),
    Row("Contact.set_penalty", "penalty", -1, V),
    Row("Contact.set_penalty", "penalty", "auto", V),
    Row("Contact.set_dt", "dt", 0, V),
    Row("Contact.set_dt", "dt", -1.0, V),
    Row("Contact.set_dt", "dt", nan, V),
    Row("Contact.set_offset", "slave", Of(lambda s: s.other_function), V),
    Row("Contact.set_offset", "slave", 3, T),
    Row("Contact.traction", "side", 0, V),
    Row("Contact.traction", "side", "left", V),
    Row("Contact.force", "side", "both", V),
    Row("Contact.traction", "part", "shear", V),
    Row("Contact.moment", "about", [0.0, 0.0, 0.0], V),
    Row("Contact.moment", "about", [nan, 0.0], V),
    Row("Contact.gap", "side", None, V),
    Row("Contact.weighted_gap", "side", "master", V, says="no multiplier"),
    Row("Contact.slip", "side", "slaves", V),
    Row("ContactProblem", "F", None, T),
    Row("ContactProblem", "F", Of(lambda s: tuple(s.pair.F[:1])), V),
    Row("ContactProblem", "F", Of(lambda s: s.pair.F[0]), V),
    Row("ContactProblem", "F", Of(lambda s: [s.pair.F[0], None]), T),
    Row("ContactProblem", "F", Of(lambda s: s.pair.F[::-1]), V, says="F: entry 0"),
    Row("ContactProblem", "F", Of(lambda s: [s.bilinear, s.pair.F[1]]), V, says="F: entry 0 must"),
    Row("ContactProblem", "F", Of(lambda s: [s.loads, s.pair.F[1]]), V, says="does not depend"),
    Row("ContactProblem", "u", Of(lambda s: [s.pair.u[0]] * 2), V, True, "own"),
    Row("ContactProblem", "u", Of(lambda s: s.pair.u[0]), V, True),
    Row("ContactProblem", "u", Of(lambda s: s.pair.V), T, True),
    Row("ContactProblem", "u", [], T, True, "at least one"),
    Row("ContactProblem", "u", Of(lambda s: [s.pair.u[0], s.foreign_function]), V, True),
    Row("ContactProblem", "contacts", Of(lambda s: [s.pair.contact] * 2), V),
    Row("ContactProblem", "contacts", Of(lambda s: [qs.Contact]), (V, T)),
    Row("ContactProblem", "contacts", Of(lambda s: s.case.contacts), V, True, "slave surface"),
    Row("ContactProblem", "contacts", Of(lambda s: [s.on_other]), V, True, "master surface"),
    Row("ContactProblem", "contacts", Of(lambda s: [s.pair.slave]), V),
    Row("ContactProblem", "contacts", Of(lambda s: s.pair.slave), T),
    Row("ContactProblem", "bcs", Of(lambda s: [[s.pair.bcs[0]], []]), (V, T)),
    Row("ContactProblem", "bcs", Of(lambda s: [["clamped"], []]), (V, T)),
    Row("ContactProblem", "bcs", Of(lambda s: s.pair.bcs[:1]), V),
    Row("ContactProblem", "bcs", Of(lambda s: s.pair.bcs[::-1]), V),
    Row("ContactProblem", "bcs", Of(lambda s: [s.pair.bcs[0][0], []]), T, says="not both"),
    Row("ContactProblem", "J", Of(lambda s: [s.pair.F[0], None]), V, says="J: entry 0"),
    Row("ContactProblem", "J", Of(lambda s: [None, s.bilinear]), V, says="J: entry 1"),
    Row("ContactProblem", "J", [None], V),
    Row("ContactProblem", "kind", "aij", V),
    Row("ContactProblem", "kind", 3, V),
    Row("ContactProblem", "linear_solver", "mumps", V),
    Row("ContactProblem", "petsc_options", [("ksp_type", "cg")], T),
    Row("ContactProblem", "petsc_options", {1: "cg"}, T),
    Row("ContactProblem", "petsc_options", "ksp_type cg", T),
    Row("ContactProblem", "petsc_options_prefix", 3, T),
    Row("ContactProblem", "pressure_preconditioner", Of(lambda s: [None, None]), V),
    *(Row("ContactProblem", "petsc_options", {n: "x"}, V, True, f"{n}='x'") for n in TYPES),
    Row("problem by default", "pressure_preconditioner", 3, V),
    Row("problem by default", "pressure_preconditioner", Of(lambda s: [s.bilinear, None]), V),
    Row("solve_with_continuation", "problem", None, T, True),
    Row("solve_with_continuation", "m", 0.15, T),
    Row("solve_with_continuation", "target", 0.0, V),
    Row("solve_with_continuation", "target", nan, V),
    Row("solve_with_continuation", "target", [0.1, 0.2], V),
    Row("solve_with_continuation", "target", 1.5, V),
    Row("solve_with_continuation", "target", "0.5", V),
    Row("solve_with_continuation", "m", Of(lambda s: s.vector), T),
    Row("solve_with_continuation in several", "target", [0.5, 0.5], V),
    Row("solve_with_continuation in several", "target", [], V),
    Row("solve_with_continuation in several", "m", [1.0], T),
    Row("TimeStepper", "problem", Of(lambda s: s.case.w), T, True),
    Row("TimeStepper", "drive", 3.0, T),
    Row("TimeStepper", "solve", "direct", T),
    *(Row("TimeStepper", "dt", bad, V) for bad in (None, [0.1], 0.0, "fast")),
    *(Row("TimeStepper", "theta", bad, V) for bad in (None, True, 1.5, nan)),
    *(Row("TimeStepper", "num_pairings", bad, V) for bad in (0, 1.5)),
    *(Row("TimeStepper", "easy", bad, V) for bad in (inf, -1)),
    Row("TimeStepper", "dt_min", 0.1, V),
    Row("TimeStepper", "dt_max", 0.01, V),
    Row("TimeStepper", "growth", 0.9, V),
    Row("TimeStepper", "cutback", 1.0, V),
    Row("TimeStepper", "max_penetration", 0.0, V),
    Row("TimeStepper", "max_penetration", "often", V),
    Row("TimeStepper", "max_rotation", 0.0, V),
    Row("TimeStepper", "max_slip", -1.0, V),
    Row("TimeStepper", "min_quality", -0.1, V),
    Row("TimeStepper.step", "t_end", nan, V),
    Row("TimeStepper.step", "t_end", "1", V),
    Row("TimeStepper.run", "t_end", nan, V),
    Row("TimeStepper.run", "t_end", inf, V),
    Row("TimeStepper.run", "t_end", None, V),
    Row("Coulomb", "mu", -0.1, V),
    Row("Coulomb", "mu", nan, V),
    Row("Coulomb", "mu", None, T),
    Row("Coulomb", "mu", "rough", T),
    Row("Coulomb", "mu", Of(lambda s: s.other_function), T),
    Row("Tresca", "limit", -inf, V),
    Row("CoulombTresca", "m_bar", 1.5, V),
    Row("CoulombTresca", "flow_stress", "50", T),
    Row("Norton", "q", 0, V),
    Row("Norton", "v0", -1.0, V),
    Row("Norton", "K", [1.0], T),
    Row("RigidSurface.plane", "comm", None, T, True),
    Row("RigidSurface.plane", "point", [0.0], V),
    Row("RigidSurface.plane", "point", [0.0, nan], V),
    Row("RigidSurface.plane", "normal", [0.0, 0.0], V),
    Row("RigidSurface.plane", "point", "here", V),
    Row("RigidSurface.plane", "normal", "up", V),
    Row("RigidSurface.plane", "normal", [0.0, 0.0, 1.0], V),
    Row("RigidSurface.plane", "normal", [nan, 1.0], V),
    Row("RigidSurface.cylinder", "radius", 0.0, V),
    Row("RigidSurface.cylinder", "axis", None, V),
    Row("RigidSurface.cylinder", "axis", [0.0] * 3, V),
    Row("RigidSurface.cylinder", "inside", "yes", T),
    Row("RigidSurface.sphere", "center", [[0.0, 0.0]], V),
    Row("RigidSurface.sphere", "center", [0.0, nan], V),
    Row("RigidSurface.sphere", "radius", nan, V),
    Row("RigidSurface.sphere", "radius", -1.0, V),
    Row("RigidSurface.triangulated", "x", None, V, True),
    Row("RigidSurface.triangulated", "x", [[0.0], [1.0], [2.0]], V, True),
    Row("RigidSurface.triangulated", "x", [[0.0, nan], [1.0, 0.0], [2.0, 0.0]], V, True),
    Row("RigidSurface.triangulated", "x", [[inf, 0.0], [1.0, 0.0], [2.0, 0.0]], V, True),
    Row("RigidSurface.triangulated", "triangles", [[0, 7]], V, True),
    Row("RigidSurface.triangulated", "triangles", [[0.0, 1.0]], V, True),
    Row("RigidSurface.triangulated", "triangles", [[0, 1, 2]], V, True),
    Row("RigidSurface.triangulated", "triangles", np.zeros((0, 2), int), V, True),
    Row("RigidSurface.triangulated", "triangles", [[0, 1], [2, 1]], V, True, "opposite"),
    Row("triangulated in 3D", "triangles", [[0, 1, 2], [1, 2, 3]], V, True, "opposite"),
    Row("triangulated in 3D", "triangles", [[0, 1, 1]], V, True, "no area"),
    Row("triangulated in 3D", "triangles", [[0, 1]], V, True),
    Row("RigidSurface.triangulated", "center", [0.0, 0.0, 0.0], V),
    Row("RigidSurface.from_stl", "filename", "no/such/file.stl", V, True),
    Row("RigidSurface.from_stl", "filename", None, T, True, "a path"),
    Row("RigidSurface.from_stl", "filename", 3, T, True, "a path"),
    Row("RigidSurface.from_mesh", "msh", Of(lambda s: s.case.mesh), V, True),
    Row("RigidSurface.from_mesh", "msh", Of(lambda s: s.case.W), T, True),
    Row("RigidSurface.from_mesh", "msh", 3, T, True),
    Row("displacement", "displacement", [0.0, nan], V),
    Row("displacement", "displacement", 1.0, V),
    Row("rotation", "rotation", [0.0, 0.0, 0.1], V),
    Row("rotation", "rotation", "90°", V),
    Row("position", "position", np.ones((2, 3)), V),
    Row("position", "position", "here", V),
    Row("RigidSurface.drive", "force", nan, V),
    Row("RigidSurface.drive", "direction", [0.0, 0.0], V),
    Row("RigidSurface.distance", "x", [[0.0, 0.0]], V),
    Row("FieldWriter", "filename", "fields", V),
    Row("FieldWriter", "filename", 3, T),
    Row("FieldWriter", "filename", Of(lambda s: s.folder / "none" / "a.xdmf"), OSError),
    Row("FieldWriter", "msh", Of(lambda s: s.case.W), T, True),
    Row("FieldWriter", "fields", Of(lambda s: [s.case.w]), T),
    Row("FieldWriter", "fields", {"a": "stress"}, T),
    Row("FieldWriter", "fields", Of(lambda s: {"a": s.on_other_mesh}), V),
    Row("FieldWriter.write", "t", nan, V),
    Row("FieldWriter.write", "t", "1", V),
    Row("History", "filename", 3, T),
    Row("History", "filename", Of(lambda s: s.folder / "none" / "a.csv"), OSError),
    Row("History.add", "row", ["t", 1.0], T),
    Row("History.add", "row", {}, V),
    Row("History.add", "row", {"t": "x"}, V, says="'t' must be a number"),
    Row("History.add", "row", {"t": nan}, V, says="'t' must be finite"),
    Row("History.add", "row", {"t": 1.0, "a": "x"}, V, says="'a' must be a number"),
    Row("History.add", "row", {"t": 1.0, "a": [1.0]}, V, says="'a' must be a number"),
    Row("step_row", "stepper", None, T, True),
    Row("save_run", "stepper", Of(lambda s: s.case.problem), T, True),
    Row("save_run", "folder", None, T),
    Row("save_run", "functions", Of(lambda s: [s.other_function]), T),
    Row("save_run", "functions", {"a": 3}, T),
    Row("save_run", "values", {"a": object()}, T),
    Row("save_run", "values", 3, T),
    Row("load_run", "stepper", Of(lambda s: s.case.problem), T, True),
    Row("load_run", "folder", "no/such/folder", (OSError, V)),
    Row("load_run", "functions", Of(lambda s: s.other_function), T),
    Row("strain", "u", Of(lambda s: s.pressure), V, says="u: must be a vector"),
    Row("strain in 3D", "axisymmetric", True, V),
    Row("linear_elastic", "u", 3.0, V),
    Row("linear_elastic", "E", -1.0, V),
    Row("linear_elastic", "nu", 0.5, V),
    Row("linear_elastic", "nu", "0.3", T),
    Row("linear_elastic", "nu", nan, V),
    Row("neo_hookean", "mu", nan, V),
    Row("neo_hookean", "lmbda", "stiff", T),
    Row("neo_hookean_energy", "mu", 0.0, V),
    Row("newtonian", "K", 0.0, V),
    Row("newtonian", "K", nan, V),
    Row("newtonian", "K", "1", T),
    Row("newtonian", "K", Of(lambda s: ufl.split(s.case.w)[0]), T),
    Row("norton_hoff", "m", 1.5, V, says="m: must be at most 1"),
    Row("norton_hoff", "m", 0.0, V),
    Row("norton_hoff", "m", Of(lambda s: s.vector), V),
    Row("norton_hoff", "regularisation", 0.0, V),
    Row("mini_space", "msh", Of(lambda s: s.quads), V),
    Row("mini_space", "msh", Of(lambda s: s.case.w), T),
    Row("incompressible", "w", Of(lambda s: s.other_function), V, says="w: must be in a mixed"),
    Row("incompressible", "w", Of(lambda s: ufl.split(s.case.w)[0]), T),
    Row("incompressible", "stress", Of(lambda s: s.case.w), V),
    Row("incompressible", "stress", Of(lambda s: s.pressure), V),
    Row("incompressible", "dx", 3, T),
    Row("axisymmetric_weight", "msh", Of(lambda s: s.mesh_3d), V),
]

#: Values that are valid on each rank, but differ between ranks.
DIFFERENT = [
    Row("Contact", "formulation", ("master-slave", "double-pass"), V),
    Row("Contact", "law", (qs.Tied(), qs.Unilateral()), V),
    Row("Contact", "penalty", (10.0, 20.0), V),
    Row("Contact", "penalty", ("auto", 20.0), V),
    Row("Contact", "search_radius", (0.1, None), V),
    Row("Contact", "quadrature", ("nodal", "overlay"), V),
    Row("Contact", "normals", ("facet", "bisector"), V),
    Row("Contact", "enforcement", ("penalty", "augmented-lagrangian"), V),
    Row("Contact", "gap_tolerance", (1e-8, 1e-7), V),
    Row("Contact with friction", "friction", (qs.Coulomb(0.1), qs.Coulomb(0.2)), V),
    Row("Contact with friction", "friction_penalty", (1.0, 2.0), V),
    Row("Contact in velocities", "dt", (0.1, 0.2), V),
    Row("Contact by default", "friction", (None, qs.Coulomb(0.1)), V, says="friction: must be"),
    Row("Contact by default", "friction", (qs.Tresca(0.1), qs.Coulomb(0.1)), V),
    Row("Contact by default", "unknown", ("displacement", "velocity"), V, says="unknown: must be"),
    Row("Contact.set_penalty", "penalty", (1.0, 2.0), V),
    Row("Contact.set_dt", "dt", (0.1, 0.2), V),
    Row("Contact.moment", "about", ([0.0, 0.0], [1.0, 0.0]), V),
    Row("Contact.traction", "side", ("slave", "master"), V),
    Row("Surface", "axisymmetric", (True, False), V),
    Row("ContactProblem", "kind", ("mpi", "nest"), V),
    Row("ContactProblem", "linear_solver", ("direct", "amg"), V),
    Row("ContactProblem", "petsc_options", ({"snes_max_it": 3}, {"snes_max_it": 4}), V),
    Row("TimeStepper", "num_pairings", (1, 2), V),
    Row("TimeStepper", "dt_max", (0.1, 0.2), V),
    Row("TimeStepper", "max_penetration", (None, 0.1), V),
    Row("TimeStepper.step", "t_end", (1.0, 2.0), V),
    Row("TimeStepper.run", "t_end", (1.0, 2.0), V),
    Row("solve_with_continuation", "target", (0.1, 0.2), V),
    Row("RigidSurface.plane", "point", ([0.0, 0.0], [1.0, 0.0]), V),
    Row("RigidSurface.sphere", "radius", (1.0, 2.0), V),
    Row("RigidSurface.triangulated", "x", (THREE, THREE + 1.0), V),
    Row("displacement", "displacement", ([0.0, 0.0], [0.0, 0.1]), V),
    Row("rotation", "rotation", (0.0, 0.1), V),
    Row("position", "position", (np.eye(2, 3), np.eye(2, 3, 1)), V),
    Row("RigidSurface.drive", "force", (1.0, 2.0), V),
    Row("FieldWriter.write", "t", (0.1, 0.2), V),
    Row("save_run", "folder", ("one", "other"), V),
]


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """One scene for all rows, since no row may change it."""
    folder = WORLD.bcast(str(tmp_path_factory.mktemp("malformed")), root=0)
    scene = Scene(pathlib.Path(folder))
    yield scene
    scene.close()


def outcome(call):
    """Exceptions of all ranks: (types or None, text) of each."""
    found = None
    try:
        call()
    except Exception as error:
        found = error
    return WORLD.allgather((None if found is None else type(found).__mro__, str(found)))


def fault(row, found):
    """Description of what is wrong with an outcome, the same on all ranks; empty if nothing is."""
    errors = row.error if isinstance(row.error, tuple) else (row.error,)
    if any(types is None or not set(errors) & set(types) for types, _ in found):
        return f"{row}: {[(t and t[0].__name__, text) for t, text in found]}"
    if (
        len({text for _, text in found}) > 1
        or row.name not in found[0][1]
        or row.says not in found[0][1]
    ):
        return f"{row}: is not named, or not on all ranks: {[text for _, text in found]}"
    return ""


def check(scene, rows, given):
    """Check that each row is refused, and the scene does not change."""
    before, faults = scene.state(), []
    for row in rows:
        good = GOOD[row.target](scene)
        call = good.call
        arguments = good.arguments | given(row, good.arguments[row.name])
        faults.append(fault(row, outcome(lambda c=call, a=arguments: c(**a))))
        if not scene.is_as(before):
            faults.append(f"{row}: has changed something")
            before = scene.state()
    faults = [f for f in faults if f]
    assert not faults, "\n".join(faults)


def by_target(rows):
    return [pytest.param(t, id=t) for t in dict.fromkeys(row.target for row in rows)]


def resolved(scene, value):
    return value.make(scene) if isinstance(value, Of) else value


def test_size_of_the_table():
    assert len(ROWS) + len(DIFFERENT) >= 60
    assert len({(r.target, r.name, repr(r.value)) for r in ROWS}) == len(ROWS)


@pytest.mark.parametrize("target", by_target(ROWS))
def test_everywhere(scene, target):
    rows = [row for row in ROWS if row.target == target]
    check(scene, rows, lambda row, good: {row.name: resolved(scene, row.value)})


@pytest.mark.several_ranks
@pytest.mark.parametrize("target", by_target(ROWS))
def test_on_one_rank_alone(scene, target):
    rows = [r for r in ROWS if r.target == target and not (r.everywhere or target in LOCAL)]
    last = WORLD.rank == WORLD.size - 1

    def given(row, good):
        value = resolved(scene, row.value)
        return {row.name: value if last else good}

    check(scene, rows, given)


@pytest.mark.several_ranks
@pytest.mark.parametrize("target", by_target(DIFFERENT))
def test_different(scene, target):
    rows = [row for row in DIFFERENT if row.target == target]
    check(scene, rows, lambda row, good: {row.name: row.value[int(WORLD.rank > 0)]})
