"""Options for compiling UFL forms, the same for every form of a problem's bodies."""

from __future__ import annotations

import dataclasses
import typing

import ufl
from dolfinx import fem


@dataclasses.dataclass(frozen=True)
class Compiling:
    """Options of ``dolfinx.fem.form``, as in ``dolfinx.fem.petsc.NonlinearProblem``.

    Attributes:
        form_compiler_options: Options of FFCx, such as ``{"sum_factorization": True}``.
        jit_options: Options of the C compiler, such as ``{"cffi_extra_compile_args": ["-O3"]}``.
        entity_maps: Maps between meshes, for a form with coefficients on several meshes, in the
            format of the installed DOLFINx.
    """

    form_compiler_options: dict[str, typing.Any] | None = None
    jit_options: dict[str, typing.Any] | None = None
    entity_maps: typing.Any = None

    def form(self, form: ufl.Form) -> fem.Form:
        """Compile a form. Collective."""
        try:
            return fem.form(
                form,
                form_compiler_options=self.form_compiler_options,
                jit_options=self.jit_options,
                entity_maps=self.entity_maps,
            )
        except (TypeError, AttributeError, RuntimeError) as error:
            if self == Compiling():
                raise
            # On several ranks, DOLFINx turns any error of the first rank into a RuntimeError.
            kind = RuntimeError if isinstance(error, RuntimeError) else TypeError
            names = "form_compiler_options, jit_options, entity_maps"
            raise kind(f"{names}: DOLFINx does not accept one of these: {error}") from error
