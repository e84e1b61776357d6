"""Random scenes of ``run.py`` as elastic bodies: they reach equilibrium, or give a reason."""

from mpi4py import MPI

import numpy as np
from fuzz.bodies import make_surfaces
from fuzz.checks import Numbers

import ufl
from dolfinx import fem, la

import qsdolfinx as qs
from qsdolfinx.contact import terms

#: Largest residual allowed at a free unknown, over the sum of all contact forces.
RESIDUAL = 1e-6

#: Forces that count as zero, relative to the stiffer modulus times the displacement.
ROUNDING = 1e-4

#: Allowed errors instead of a solution; any other error is a fault.
REFUSALS = ("SNES did not converge", 'penalty: "auto" needs')


class Body:
    """An elastic body, clamped or displaced at the side furthest from the other body."""

    def __init__(self, surface, x, toward, shift, E, nu):
        self.V = V = surface.V
        self.u, v = fem.Function(V), ufl.TestFunction(V)
        # Constants, so that forms of all scenes of a kind are the same and compiled only once.
        material = (fem.Constant(V.mesh, float(value)) for value in (E, nu))
        stress = qs.materials.linear_elastic(self.u, *material)
        self.F = ufl.inner(stress, ufl.grad(v)) * ufl.dx
        low, high = np.min(x @ toward), np.max(x @ toward)
        limit = low + 0.4127 * (high - low)
        dofs = fem.locate_dofs_geometrical(V, lambda p: p[: len(toward)].T @ toward < limit)
        self.bcs = [fem.dirichletbc(shift, dofs, V)]
        self.held = np.zeros(len(self.u.x.array), dtype=bool)
        for i in range(V.dofmap.bs):
            self.held[dofs * V.dofmap.bs + i] = True

    def internal_forces(self):
        """Internal forces ∂F/∂v at the owned unknowns. Collective."""
        b = fem.assemble_vector(fem.form(self.F))
        b.scatter_reverse(la.InsertMode.add)
        return b.array[: self.V.dofmap.index_map.size_local * self.V.dofmap.bs]


def choices(scene):
    """Materials and options of the solve, determined by the scene's number."""
    rng = np.random.default_rng([scene.index, 77])
    E = scene.modulus * np.array([1.0, 10.0 ** rng.choice([-4, -1, 0, 0, 1, 4])])
    nu = rng.choice([0.0, 0.3, 0.45, 0.499], 2)
    options = dict(scene.options)
    options["penalty"] = "auto"
    if rng.random() < 0.4:
        options["penalty"] = float(E.min() / scene.size * 10.0 ** rng.uniform(-1, 4))
    if rng.random() < 0.3 and options["formulation"] != "double-pass":
        options["enforcement"] = "augmented-lagrangian"
    if not scene.tied and rng.random() < 0.25:
        options["friction"] = qs.Coulomb(float(rng.uniform(0, 0.6)))
    depth = scene.size * rng.choice([-0.01, 0.003, 0.03, 0.1])
    return E, nu, options, depth


def check_solve(comm, scene):
    """Press the bodies of a scene together. Collective.

    Returns:
        Its numbers, and the faults on this rank (a list of sentences).
    """
    E, nu, options, depth = choices(scene)
    surfaces = make_surfaces(comm, scene)
    shifts = np.zeros(scene.gdim), -depth * np.asarray(scene.direction)
    bodies = [
        Body(surface, shape.x, sign * np.asarray(scene.direction), shift, *material)
        for surface, shape, sign, shift, material in zip(
            surfaces, scene.shapes, (1, -1), shifts, zip(E, nu, strict=True), strict=True
        )
    ]
    law = qs.Tied() if scene.tied else qs.Unilateral()
    contact = qs.Contact(*surfaces, law=law, **options)
    problem = qs.ContactProblem(
        [b.F for b in bodies], [b.u for b in bodies], [contact], [b.bcs for b in bodies]
    )
    numbers, faults = Numbers(), []
    try:
        problem.solve()
    except (qs.ConvergenceError, ValueError) as error:
        if not str(error).startswith(REFUSALS):
            raise
        if any([np.any(b.u.x.array) for b in bodies]):
            faults.append("a refused solve has changed the unknowns")
        numbers.add("refused", 1.0, 1.0)
        numbers.refused = f"{options['formulation']} {options.get('enforcement', 'penalty')}"
    else:
        numbers.add("refused", 0.0, 1.0)
        stiffness = E.max() * abs(depth) * scene.size ** (scene.gdim - 2)
        # SNES stops relative to the first residual, which may be much larger than the final forces.
        least = max(ROUNDING * stiffness, 0.01 * problem.residual_history[0])
        faults += equilibrium(contact, bodies, scene, numbers, least)
    problem.destroy()
    return numbers, faults


def equilibrium(contact, bodies, scene, numbers, least):
    """Check residuals of both bodies, assembled here, and balance and signs. Collective.

    Forces below the minimum are rounding, or below the tolerance of Newton's method.
    """
    comm, out = contact.comm, []
    vecs = contact.slave.create_vec(), contact.master.create_vec()
    terms.add_residual(contact.model, *vecs)
    left, size, strain_forces = 0.0, 0.0, 0.0
    for body, vec in zip(bodies, vecs, strict=True):
        inner = body.internal_forces()
        free = ~body.held[: len(inner)]
        if not (np.all(np.isfinite(inner)) and np.all(np.isfinite(vec.array_r))):
            out.append("the solution is not finite")
        left = max(left, np.abs((inner + vec.array_r)[free]).max(initial=0.0))
        size += np.abs(vec.array_r).sum()
        strain_forces = max(strain_forces, np.abs(inner).max(initial=0.0))
    left, strain_forces = (comm.allreduce(v, op=MPI.MAX) for v in (left, strain_forces))
    size = max(comm.allreduce(size, op=MPI.SUM), strain_forces, least)
    if left > RESIDUAL * size:
        out.append(f"a residual of {left / size:.1e}")
    forces = contact.force("slave"), contact.force("master")
    imbalance = np.abs(forces[0] + forces[1]).max()
    if imbalance > 1e-10 * size:
        out.append(f"forces out of balance by {imbalance / size:.1e}")
    if not scene.tied and np.any(contact.multiplier() < 0):
        out.append("a multiplier pulls")
    for i, value in enumerate(forces[0]):
        numbers.add(f"force {i}", value, 1e3 * size)
    for vec in vecs:
        vec.destroy()
    return out
