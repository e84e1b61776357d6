"""Options for compiling UFL forms, the same for every form of a problem's bodies."""

from __future__ import annotations

import dataclasses
import logging
import typing

from mpi4py import MPI

import ufl
from dolfinx import fem, jit

from qsdolfinx import _cpp
from qsdolfinx.base.messages import say

#: Options of GCC and Clang with which forms are assembled about twice as fast as with DOLFINx's
#: ``-O2``. Sums may be reordered, which changes results by rounding alone; NaN and infinity mean
#: what they mean without these options, unlike with ``-ffast-math``.
OPTIMISED = [
    "-O3",
    "-g0",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fno-signed-zeros",
    "-fassociative-math",
]

_ARGUMENTS = "cffi_extra_compile_args"


@dataclasses.dataclass(frozen=True)
class Compiling:
    """Options of ``dolfinx.fem.form``, as in ``dolfinx.fem.petsc.NonlinearProblem``.

    Attributes:
        form_compiler_options: Options of FFCx, such as ``{"sum_factorization": True}``.
        jit_options: Options of the C compiler, such as ``{"cffi_extra_compile_args": ["-O2"]}``.
            If neither they nor a ``dolfinx_jit_options.json`` of the user name compiler arguments,
            these are :data:`OPTIMISED`, and the instructions that the processors of all ranks
            have: AVX2 and FMA, if they have them.
        entity_maps: Maps between meshes, for a form with coefficients on several meshes, in the
            format of the installed DOLFINx.
    """

    form_compiler_options: dict[str, typing.Any] | None = None
    jit_options: dict[str, typing.Any] | None = None
    entity_maps: typing.Any = None

    def form(self, form: ufl.Form) -> fem.Form:
        """Compile a form. Collective.

        Raises:
            TypeError, RuntimeError: On all ranks, if DOLFINx or the compiler refuses it.
        """
        if self._leaves_arguments():
            comm: MPI.Intracomm = form.ufl_domains()[0].ufl_cargo().comm
            root = logging.getLogger()
            handlers = root.handlers
            try:
                return self._compile(form, (self.jit_options or {}) | _arguments(comm))
            except Exception as error:  # of any class: an unknown compiler, a wrong form
                root.handlers = handlers  # FFCx leaves its own here when the compiler fails
                compiled = self._checked(form)
                say(comm, f"forms are compiled with DOLFINx's options, since {error}")
                return compiled
        return self._checked(form)

    def _leaves_arguments(self) -> bool:
        """Whether the user has left the compiler's arguments at the defaults of DOLFINx."""
        default = jit.DOLFINX_DEFAULT_JIT_OPTIONS[_ARGUMENTS][0]
        given = self.jit_options or {}
        return _ARGUMENTS not in given and bool(jit.get_options(given)[_ARGUMENTS] == default)

    def _compile(self, form: ufl.Form, jit_options: dict[str, typing.Any] | None) -> fem.Form:
        return fem.form(
            form,
            form_compiler_options=self.form_compiler_options,
            jit_options=jit_options,
            entity_maps=self.entity_maps,
        )

    def _checked(self, form: ufl.Form) -> fem.Form:
        """Compile a form with the user's options; errors name the arguments."""
        try:
            return self._compile(form, self.jit_options)
        except (TypeError, AttributeError, RuntimeError) as error:
            if self == Compiling():
                raise
            # On several ranks, DOLFINx turns any error of the first rank into a RuntimeError.
            kind = RuntimeError if isinstance(error, RuntimeError) else TypeError
            names = "form_compiler_options, jit_options, entity_maps"
            raise kind(f"{names}: DOLFINx does not accept one of these: {error}") from error


def _arguments(comm: MPI.Intracomm) -> dict[str, list[str]]:
    """Compiler arguments for the processors of all ranks. Collective.

    The level of instructions is named, and not ``native``: DOLFINx finds compiled forms by these
    arguments, and computers that share a cache folder may have unlike processors.
    """
    level = min(comm.allgather(_cpp.processor_level()))
    return {_ARGUMENTS: [*OPTIMISED, f"-march={level}"] if level else OPTIMISED}
