"""Remeshing in time steps: criteria and parameters."""

from __future__ import annotations

import typing

from mpi4py import MPI

import ufl
from dolfinx import fem, mesh

from qsdolfinx.base.checks import (
    CALLABLE,
    COUNT,
    FLAG,
    FRACTION,
    POSITIVE,
    TAGS,
    check,
    either,
    instance,
    one_of,
    require,
)
from qsdolfinx.base.collective import collective_errors
from qsdolfinx.remeshing.remesh import MESHERS, check_mesher
from qsdolfinx.remeshing.sizes import Size
from qsdolfinx.solve.problem import ContactProblem
from qsdolfinx.steps.scene import Scene
from qsdolfinx.steps.staggered import Staggered

Build = typing.Callable[
    [typing.Sequence[mesh.Mesh], typing.Sequence[mesh.MeshTags | None]],
    ContactProblem | tuple[ContactProblem, Staggered],
]

LIST = instance((list, tuple), "a list")


class Remeshing:
    """Remeshing in a :class:`qs.TimeStepper`: when and how bodies get new meshes.

    All velocity-based bodies get new meshes (:func:`qs.remesh`) at the start of a step if one of
    the criteria holds, or when no step can be made because a mesh is distorted. Velocities,
    pressures and named fields are transferred (:func:`qs.transfer`), and so are multipliers and the
    history of friction on the contact surfaces. Tools keep their positions. Then equilibrium is
    found again.

    Forms, conditions and surfaces belong to a mesh, so that a new problem is needed: ``build``
    makes it. It is then ``stepper.problem``; the ``solve`` argument of the stepper has to use this
    problem.

    Args:
        build: Called with the meshes of all bodies and the tags of their facets, in the order of
            the problem's unknowns. It returns a problem with the same bodies, contacts and tools in
            the same order, or a pair of this problem and its ``qs.Staggered``; temperatures are
            transferred, and their integrals are kept. ``build`` may replace objects of the program
            by the new ones.
        size: Cell size (length), or a function of a mesh that returns a size as in ``qs.remesh``;
            it is called with the old mesh for each new mesh.
        facet_tags: Tags of the facets to be transferred, a list with one entry for each body's
            mesh; None for no tags.
        min_quality: Bodies are remeshed if the quality of the worst cell (see MeshMotion.quality)
            is below this value; new meshes should have at least this quality (see
            :func:`qs.remesh`). None for no such criterion.
        every: Number of steps after which bodies are remeshed; None for no such criterion.
        max_penetration: Penetration (length) above which bodies are remeshed; None for no such
            criterion.
        when: Function of the stepper that returns whether to remesh now; None for no such
            criterion.
        fields: Function that returns the functions to be transferred, by name. It is called before
            ``build``, and again after it to get the functions on the new meshes, which are then
            filled.
        energy: Function that returns a form, such as a strain energy or a dissipation. The form is
            integrated on the old and on the new mesh, for a comparison in the report.
        axisymmetric: Whether coordinates are (r, z).
        feature_angle: See :func:`qs.remesh`.
        gradation: See :func:`qs.remesh`.
        mesher: See :func:`qs.remesh`.

    Raises:
        TypeError, ValueError: If an argument is of another type or out of range.
    """

    def __init__(
        self,
        build: Build,
        size: float | typing.Callable[[mesh.Mesh], Size],
        facet_tags: typing.Sequence[mesh.MeshTags | None] | None = None,
        *,
        min_quality: float | None = 0.05,
        every: int | None = None,
        max_penetration: float | None = None,
        when: typing.Callable[[typing.Any], bool] | None = None,
        fields: typing.Callable[[], typing.Mapping[str, fem.Function]] | None = None,
        energy: typing.Callable[[], ufl.Form] | None = None,
        axisymmetric: bool = False,
        feature_angle: float = 40.0,
        gradation: float | None = 0.5,
        mesher: str = "gmsh",
    ) -> None:
        check(CALLABLE, build=build)
        check(either(CALLABLE, None), when=when, fields=fields, energy=energy)
        no_ufl = not any(hasattr(given, "ufl_shape") for given in (fields, energy))
        require(no_ufl, "fields, energy: must be Python functions that return them")
        if not callable(size):
            check(POSITIVE, size=size)
        check(either(LIST, None), facet_tags=facet_tags)
        check(either(TAGS, None), **{f"facet_tags: {i}": t for i, t in enumerate(facet_tags or ())})
        check(either(POSITIVE, None), max_penetration=max_penetration)
        check(either(FRACTION, None), min_quality=min_quality)
        check(either(COUNT, None), every=every)
        check(FLAG, axisymmetric=axisymmetric)
        check(POSITIVE, feature_angle=feature_angle)
        check(either(POSITIVE, None), gradation=gradation)
        check(one_of(MESHERS), mesher=mesher)
        self.build, self.size = build, size
        #: Facet tags of the present meshes, None for a body without tags.
        self.facet_tags: list[mesh.MeshTags | None] | None = None
        if facet_tags is not None:
            self.facet_tags = list(facet_tags)
        self.min_quality, self.every, self.max_penetration = min_quality, every, max_penetration
        self.when = when
        self.fields = fields or (lambda: {})
        self.energy = energy
        self.axisymmetric, self.feature_angle = bool(axisymmetric), float(feature_angle)
        self.gradation, self.mesher = gradation, mesher

    def check(self, problem: ContactProblem) -> None:
        """Check that a problem has a body to be remeshed, and the right number of bodies.

        Raises:
            ValueError: If it has not.
        """
        flows = "velocity" in problem.unknowns
        require(flows, "remesh: only bodies in velocities get new meshes, and there is none")
        tags = self.facet_tags
        fits = tags is None or len(tags) == len(problem.u)
        require(fits, f"remesh: facet_tags must be a list of {len(problem.u)}, one for each body")
        for u, unknown in zip(problem.u, problem.unknowns, strict=True):
            if unknown == "velocity":
                check_mesher(u.function_space.mesh, self.mesher)

    def due(self, scene: Scene, steps: int, stepper: object) -> str | None:
        """Reason for a remeshing now; None if none is needed. Collective.

        Args:
            scene: Bodies, tools and contacts of the stepper.
            steps: Number of steps since the last remeshing.
            stepper: Argument for ``when``.
        """
        if self.every is not None and steps >= self.every:
            return f"every = {self.every}"
        if self.min_quality is not None:
            flowing = zip(scene.motions, scene.in_velocity, strict=True)
            worst = min(motion.quality() for motion, flows in flowing if flows)
            if worst < self.min_quality:
                return f"a quality of {worst:.3g}, below min_quality = {self.min_quality:g}"
        if self.max_penetration is not None and steps > 0:
            depths = [c.penetration() for c in scene.problem.contacts if c.model.has_gaps]
            deepest = max(depths, default=0.0)
            if deepest > self.max_penetration:
                limit = f"max_penetration = {self.max_penetration:g}"
                return f"a penetration of {deepest:.3g}, above {limit}"
        if self.when is not None:
            with collective_errors(scene.problem.comm):
                asked = bool(self.when(stepper))
            if scene.problem.comm.allreduce(asked, op=MPI.LOR):
                return "when"
        return None

    def size_for(self, msh: mesh.Mesh) -> typing.Any:
        """Cell sizes of a body, as an argument for ``qs.remesh``."""
        return self.size(msh) if callable(self.size) else float(self.size)
