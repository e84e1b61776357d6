"""Check the arguments of ContactProblem, as far as possible before anything is built."""

from __future__ import annotations

import typing

from mpi4py import MPI

import ufl
from dolfinx import fem

from qsdolfinx.base.checks import Kind, check, instance, require
from qsdolfinx.contact.contact import Contact
from qsdolfinx.contact.model import ContactModel
from qsdolfinx.system.body import body_of, contains
from qsdolfinx.system.one_point import mixes_one_point

LIST = instance(typing.Sequence, "a list")
BODIES = Kind(
    "a list with at least one dolfinx.fem.Function",
    lambda u: isinstance(u, typing.Sequence) and len(u) > 0 and isinstance(u[0], fem.Function),
    TypeError,
)
OPTIONS = Kind(
    "a dictionary of options without the prefix",
    lambda given: isinstance(given, dict) and all(isinstance(key, str) for key in given),
    TypeError,
)


class Given(typing.NamedTuple):
    """Bodies and contacts of a problem, as lists: one entry for each body, or contact."""

    F: typing.Any
    u: typing.Any
    contacts: typing.Any
    bcs: typing.Any
    J: typing.Any

    @staticmethod
    def from_arguments(
        F: typing.Any, u: typing.Any, contacts: typing.Any, bcs: typing.Any, J: typing.Any
    ) -> Given:
        """Convert arguments to lists: single bodies and contacts, conditions in one or more lists.

        Arguments of a wrong kind are left unchanged, so that the checks can name them.
        """
        if isinstance(u, fem.Function):
            u = [u]
        F = [F] if isinstance(F, ufl.Form) else F
        contacts = [contacts] if isinstance(contacts, Contact) else contacts
        J = [J] if isinstance(J, ufl.Form) else J
        bcs = [bcs] if isinstance(bcs, fem.DirichletBC) else bcs
        return Given(F, u, contacts, bcs, J)

    @property
    def bodies(self) -> list[tuple[typing.Any, ...]]:
        """Form, unknown, conditions and derivative of each body."""
        return list(zip(self.F, self.u, self.bcs, self.J, strict=True))

    def with_lists(self) -> Given:
        """Copy with the conditions sorted by body, and with entries for omitted arguments."""
        text = f"F: must have one entry for each of the {len(self.u)} bodies in u"
        require(len(self.F) == len(self.u), text)
        J = [None for _ in self.u] if self.J is None else self.J
        if self.bcs is None:
            return self._replace(bcs=[[] for _ in self.u], J=J)
        is_flat = any(isinstance(bc, fem.DirichletBC) for bc in self.bcs) or not len(self.bcs)
        return self._replace(bcs=_by_body(self.u, self.bcs) if is_flat else self.bcs, J=J)


def _by_body(
    u: typing.Sequence[fem.Function], bcs: typing.Sequence[typing.Any]
) -> list[list[fem.DirichletBC]]:
    """Sort the conditions of one list by the body whose space they are on."""
    out: list[list[fem.DirichletBC]] = [[] for _ in u]
    text = "bcs: must be one list of dolfinx.fem.DirichletBC, or a list for each body, not both"
    require(_all(fem.DirichletBC, bcs), text, TypeError)
    require(_all(fem.Function, u), "u: must hold a dolfinx.fem.Function for each body", TypeError)
    for i, bc in enumerate(bcs):
        fits = [k for k, f in enumerate(u) if contains(f.function_space, bc.function_space)]
        require(fits, f"bcs: entry {i} is on the space of none of u")
        out[fits[0]].append(bc)
    return out


def communicator(u: typing.Any) -> MPI.Intracomm:
    """Communicator of the first body, over which the ranks agree on errors."""
    check(BODIES, u=u)
    comm: MPI.Intracomm = u[0].function_space.mesh.comm
    return comm


def check_bodies(
    F: typing.Sequence[ufl.Form],
    u: typing.Sequence[fem.Function],
    contacts: typing.Sequence[Contact],
    bcs: typing.Sequence[typing.Sequence[fem.DirichletBC]],
    J: typing.Sequence[ufl.Form | None],
) -> None:
    """Raise an error for lists from which no problem can be built."""
    for name, given in (("F", F), ("bcs", bcs), ("J", J)):
        text = f"{name}: must have one entry for each of the {len(u)} bodies in u"
        require(len(given) == len(u), text)
    require(_all(fem.Function, u), "u: must hold a dolfinx.fem.Function for each body", TypeError)
    text = "bcs: must be a list of Dirichlet conditions, or such a list for each body"
    require(_all(typing.Sequence, bcs), text)
    conditions = [bc for entry in bcs for bc in entry]
    text = "bcs: must be a list of dolfinx.fem.DirichletBC, or such a list for each body"
    require(_all(fem.DirichletBC, conditions), text, TypeError)
    require(_all(Contact, contacts), "contacts: must be a list of qsdolfinx.Contact")
    twice = len({id(contact) for contact in contacts}) < len(contacts)
    require(not twice, "contacts: one of them is in the list twice")
    names = [contact.name for contact in contacts if contact.name is not None]
    alike = sorted({name for name in names if names.count(name) > 1})
    require(not alike, f"contacts: several are called {', '.join(map(repr, alike))}")
    spaces = [function.function_space for function in u]
    shared = any(V == W for i, V in enumerate(spaces) for W in spaces[:i])
    require(not shared, "u: every body needs a function space of its own")
    ranks = {MPI.Comm.Compare(spaces[0].mesh.comm, V.mesh.comm) for V in spaces}
    same = ranks <= {MPI.IDENT, MPI.CONGRUENT}
    require(same, "u: all meshes must be on the same ranks in the same order")
    for i, V in enumerate(spaces):
        fit = all(contains(V, bc.function_space) for bc in bcs[i])
        require(fit, f"bcs: entry {i} has a condition on a space other than that of u[{i}]")
        _check_form("F", i, F[i], 1, u[i])
        if J[i] is not None:
            _check_form("J", i, J[i], 2, u[i])
    _check_unknowns(u, contacts)


def check_free(contacts: typing.Sequence[ContactModel], problem: object) -> None:
    """Raise an error for contacts that another problem has used since."""
    for i, contact in enumerate(contacts):
        other = None if contact.problem is None else contact.problem()
        require(
            other is None or other is problem,
            f"contacts: {contact.called(i)} is part of another problem, which was solved since "
            "and uses its multipliers and friction: make another contact, or call destroy() of "
            "that problem",
        )


def _check_unknowns(u: typing.Sequence[fem.Function], contacts: typing.Sequence[Contact]) -> None:
    """Raise an error for contacts of other bodies, or that disagree on the unknowns of a body."""
    known: dict[int, float] = {}
    for contact in contacts:
        surfaces = ("slave", contact.slave), ("master", contact.master)
        for (name, surface), scale in zip(surfaces, contact.model.kinematics.scale, strict=True):
            try:
                i = body_of(u, surface.V)
            except ValueError:
                text = f"contacts: the {name} surface of a contact is on the space of none of u"
                raise ValueError(text) from None
            if i is not None and contact.model.is_scalar:
                continue  # a scalar field on the body does not show how the body moves
            alike = i is None or known.setdefault(i, scale) == scale
            require(alike, f"contacts: must agree on whether u[{i}] is a velocity, and on dt")


def _check_form(name: str, i: int, form: typing.Any, rank: int, u: fem.Function) -> None:
    """Raise an error for an argument that is not a form of this rank on the body's space."""
    check(instance(ufl.Form, "a UFL form"), **{f"{name}: entry {i}": form})
    spaces = [argument.ufl_function_space() for argument in form.arguments()]
    what = "a test function" if rank == 1 else "a test and a trial function"
    text = f"{name}: entry {i} must have {what} in the space of u[{i}], and no other"
    require(spaces == [u.function_space] * rank, text)
    depends = rank == 2 or u in form.coefficients()
    require(depends, f"F: entry {i} does not depend on u[{i}]")
    derived = [ufl.derivative(form, u)] if rank == 1 else []
    text = (
        f"{name}: entry {i} has integrals with one quadrature point and others over the same cells "
        "or facets, of which FFCx makes wrong kernels; give all of them subdomains of their own, "
        'ufl.Measure("dx", mesh, subdomain_data=[(1, cells), (2, cells)]), or the same degree'
    )
    require(not any(map(mixes_one_point, [form, *derived])), text)


def _all(kind: type, values: typing.Iterable[typing.Any]) -> bool:
    return all(isinstance(value, kind) for value in values)
