"""How a problem's UFL forms are compiled: the options that every form of its bodies gets."""

from __future__ import annotations

import dataclasses
import typing

import ufl
from dolfinx import fem


@dataclasses.dataclass(frozen=True)
class Compiling:
    """Options of ``dolfinx.fem.form``, as those of ``dolfinx.fem.petsc.NonlinearProblem``.

    Attributes:
        form_compiler_options: For FFCx, such as ``{"sum_factorization": True}``.
        jit_options: For the C compiler, such as ``{"cffi_extra_compile_args": ["-O3"]}``.
        entity_maps: Maps between the meshes of a form with coefficients of several, in the form
            that the installed DOLFINx takes.
    """

    form_compiler_options: dict[str, typing.Any] | None = None
    jit_options: dict[str, typing.Any] | None = None
    entity_maps: typing.Any = None

    def form(self, form: ufl.Form) -> fem.Form:
        """The compiled form. Collective."""
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
            # On several ranks DOLFINx makes a RuntimeError of whatever the first one raises.
            kind = RuntimeError if isinstance(error, RuntimeError) else TypeError
            names = "form_compiler_options, jit_options, entity_maps"
            raise kind(f"{names}: DOLFINx does not accept one of these: {error}") from error
