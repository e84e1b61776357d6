"""Arguments of ContactProblem: what can be told before anything is built."""

from __future__ import annotations

import typing

from mpi4py import MPI

import ufl
from dolfinx import fem

from qsdolfinx.contact.contact import Contact
from qsdolfinx.system.body import body_of, contains


def communicator(u: typing.Any) -> MPI.Intracomm:
    """Communicator to agree on errors with; that of the first body if there is one."""
    if isinstance(u, typing.Sequence) and len(u) and isinstance(u[0], fem.Function):
        comm: MPI.Intracomm = u[0].function_space.mesh.comm
        return comm
    return MPI.COMM_WORLD


def check_sequences(**arguments: typing.Any) -> None:
    """Refuse a single thing where there must be one for each body."""
    for name, value in arguments.items():
        optional = name in ("bcs", "J") and value is None
        if not optional and not isinstance(value, typing.Sequence):
            raise TypeError(f"{name}: must be a list, not {type(value).__name__}")


def check_options(prefix: typing.Any, options: typing.Any) -> None:
    """Refuse options that PETSc's database cannot hold."""
    if not isinstance(prefix, (str, type(None))):
        raise TypeError(f"petsc_options_prefix: must be a string, not {prefix!r}")
    if options is not None and not (
        isinstance(options, dict) and all(isinstance(key, str) for key in options)
    ):
        raise TypeError("petsc_options: must be a dictionary of options without the prefix")


def check_arguments(
    F: typing.Sequence[ufl.Form],
    u: typing.Sequence[fem.Function],
    contacts: typing.Sequence[Contact],
    bcs: typing.Sequence[typing.Sequence[fem.DirichletBC]],
    J: typing.Sequence[ufl.Form | None],
    kind: str,
) -> None:
    """Refuse what no problem can be made of."""
    if len(u) == 0:
        raise ValueError("u: there must be at least one body")
    for name, given in (("F", F), ("bcs", bcs), ("J", J)):
        if len(given) != len(u):
            raise ValueError(f"{name}: must have one entry for each of the {len(u)} bodies in u")
    if not all(isinstance(function, fem.Function) for function in u):
        raise TypeError("u: must hold a dolfinx.fem.Function for each body")
    if not all(isinstance(entry, typing.Sequence) for entry in bcs):
        raise ValueError("bcs: must be a list of lists, one list of Dirichlet conditions per body")
    if kind not in ("mpi", "nest"):
        raise ValueError(f'kind: must be "mpi" or "nest", not {kind!r}')
    if any(not isinstance(contact, Contact) for contact in contacts):
        raise ValueError("contacts: must be a list of qsdolfinx.Contact")
    if len({id(contact) for contact in contacts}) < len(contacts):
        raise ValueError("contacts: one of them is in the list twice")
    comm = u[0].function_space.mesh.comm
    for i, function in enumerate(u):
        if any(function.function_space == other.function_space for other in u[:i]):
            raise ValueError("u: every body needs a function space of its own")
        other = function.function_space.mesh.comm
        if MPI.Comm.Compare(comm, other) not in (MPI.IDENT, MPI.CONGRUENT):
            raise ValueError("u: all meshes must be on the same ranks in the same order")
    if not all(isinstance(bc, fem.DirichletBC) for entry in bcs for bc in entry):
        raise TypeError("bcs: must be a list of lists of dolfinx.fem.DirichletBC")
    for i, (function, conditions) in enumerate(zip(u, bcs, strict=True)):
        if not all(contains(function.function_space, bc.function_space) for bc in conditions):
            raise ValueError(f"bcs: entry {i} has a condition on a space other than that of u[{i}]")
    for i, (form, tangent, function) in enumerate(zip(F, J, u, strict=True)):
        _check_form("F", i, form, 1, function)
        if tangent is not None:
            _check_form("J", i, tangent, 2, function)
    _check_unknowns(u, contacts)


def _check_unknowns(u: typing.Sequence[fem.Function], contacts: typing.Sequence[Contact]) -> None:
    """Refuse contacts of no body of ours, or that disagree on what a body's unknowns are."""
    known: dict[int, float] = {}
    for contact in contacts:
        surfaces = ("slave", contact.slave), ("master", contact.master)
        for (name, surface), scale in zip(surfaces, contact.scale, strict=True):
            try:
                i = body_of(u, surface.V)
            except ValueError:
                raise ValueError(
                    f"contacts: the {name} surface of a contact belongs to the space of none of u"
                ) from None
            if i is not None and known.setdefault(i, scale) != scale:
                raise ValueError(f"contacts: must agree on whether u[{i}] is a velocity, and on dt")


def _check_form(name: str, i: int, form: typing.Any, rank: int, u: fem.Function) -> None:
    """Refuse what is not a form of this rank on the body's space."""
    if not isinstance(form, ufl.Form):
        raise TypeError(f"{name}: entry {i} must be a UFL form, not {type(form).__name__}")
    spaces = [argument.ufl_function_space() for argument in form.arguments()]
    if spaces != [u.function_space] * rank:
        what = "a test function" if rank == 1 else "a test and a trial function"
        raise ValueError(f"{name}: entry {i} must have {what} in the space of u[{i}], and no other")
    if rank == 1 and u not in form.coefficients():
        raise ValueError(f"F: entry {i} does not depend on u[{i}]")
