"""Forces and blocks of the tangent of a scene of ``run.py``, for given displacements."""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from scenes import gathered

from qsdolfinx.contact import active_set, terms
from qsdolfinx.pairing.points import Pairing


def field(x, scene, seed, amplitude=0.05):
    """A smooth displacement of points (points, 3), the same function on any partition."""
    rng = np.random.default_rng([scene.index, seed])
    waves = rng.normal(size=(4, 3)) * 3 / scene.size
    phases = rng.uniform(0, 2 * np.pi, (4, scene.gdim))
    values = np.sin((x @ waves.T)[:, :, None] + phases).sum(axis=1)
    push = (1 - 2 * (seed % 2)) * np.asarray(scene.direction)  # 0: slave, 1: master
    return amplitude * scene.size * (0.5 * values + push)


def unknowns(surface, scene, seed):
    """The field as a vector of the surface's body, at all its nodes."""
    V = surface.V
    x = V.tabulate_dof_coordinates()[: V.dofmap.index_map.size_local]
    vec = surface.create_vec()
    vec.array[:] = field(x, scene, seed).ravel()
    return vec


def assembly(contact, scene, numbers):
    """Compute forces and blocks for given displacements; adds to the numbers. Collective."""
    surfaces = contact.slave, contact.master
    u = [unknowns(s, scene, i) for i, s in enumerate(surfaces)]
    v = [unknowns(s, scene, 10 + 2 * i) for i, s in enumerate(surfaces)]
    terms.evaluate(contact.model, *u)
    r = residual(contact)
    energy = contact.stored_energy()
    force, moment = contact.force("slave"), contact.moment("slave")
    size = max(r[0].norm(PETSc.NormType.NORM_1), r[1].norm(PETSc.NormType.NORM_1), 1e-300)
    imbalance = np.abs(force + contact.force("master")).max()
    out = []
    if not imbalance <= 1e-11 * size:
        out.append(f"forces out of balance by {imbalance / size:.1e}")
    out += moment_faults(contact, scene, moment + contact.moment("master"), size)
    active = contact.comm.allreduce(active_set.num_closed(contact.model), op=MPI.SUM)
    numbers.add("active rows", active, max(active, 1))
    numbers.add("energy", energy, max(abs(energy), 1e-14 * size * scene.size))
    for i, value in enumerate((*force, *moment / scene.size)):
        numbers.add(f"force {i}", value, size * 10)
    out += block_faults(contact, scene, v, r, numbers)
    for vec in (*u, *v, *r):
        vec.destroy()
    return out


def residual(contact):
    out = contact.slave.create_vec(), contact.master.create_vec()
    terms.add_residual(contact.model, *out)
    return out


def moment_faults(contact, scene, imbalance, size):
    """Check the balance of moments, up to points that do not face each other exactly.

    The expected difference is Σ_p w_p λ(ξ_p) (x_s − x_m) × n_p. It vanishes if the two points lie
    on a line along n.
    """
    if scene.tied or scene.degree > 1:
        return []
    expected = np.zeros(3)
    for pass_ in contact.model.gaps:
        p = Pairing.from_cpp(pass_.points)
        nodes, of_rows = pass_.slave.node_dofs[:, 0], pass_.multiplier(contact.model.eps)
        values = pass_.rows.on_nodes(of_rows, 0.0)[:, 0]
        keys = gathered(contact.comm, nodes)
        values = dict(zip(keys.tolist(), gathered(contact.comm, values).tolist(), strict=True))
        where = []
        for side, surface in ((p.master, pass_.master), (p.slave, pass_.slave)):
            keys = gathered(contact.comm, surface.node_dofs[:, 0]).tolist()
            x = dict(zip(keys, gathered(contact.comm, surface.node_x), strict=True))
            x[-1] = np.zeros(3)
            at = np.array([x[d] for d in side.dofs[..., 0].ravel().tolist()])
            at = at.reshape(*side.dofs.shape[:2], 3)
            where.append(np.einsum("pi,pij->pj", side.shape_values, at))
        values[-1] = 0.0
        first = p.slave.dofs[:, : p.multiplier_values.shape[1], 0]
        at = np.array([values[d] for d in first.ravel().tolist()]).reshape(first.shape)
        at_points = np.sum(at * p.multiplier_values, axis=1)
        strength = p.weight * (of_rows[:, 0] if pass_.rows.are_points else at_points)
        strength *= 0.5 if contact.settings.formulation == "double-pass" else 1.0
        lever = where[0] - where[1]
        expected += np.sum(strength[:, None] * np.cross(lever, p.normal), axis=0)
    expected = contact.comm.allreduce(expected, op=MPI.SUM)
    expected = expected[2:] if scene.gdim == 2 else expected
    error = np.abs(imbalance - expected).max()
    lever = np.abs(np.concatenate([s.x for s in scene.shapes])).max()
    return [f"moments out of balance by {error / size:.1e}"] if error > 1e-10 * size * lever else []


def blocks_of(contact):
    """Blocks ss, sm, ms, mm of the tangent. Collective."""
    layouts = [
        (s.V.dofmap.index_map.size_local * s.gdim, s.V.dofmap.index_map.size_global * s.gdim)
        for s in (contact.slave, contact.master)
    ]
    mats = []
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        sizes, gdim = (layouts[i], layouts[j]), contact.slave.gdim
        mat = PETSc.Mat().createAIJ(sizes, bsize=gdim, comm=contact.comm)
        mat.setUp()
        mats.append(mat)
    terms.add_pattern(contact.model, tuple(mats))
    for mat in mats:
        mat.assemble()
        mat.setOption(PETSc.Mat.Option.NEW_NONZERO_LOCATION_ERR, True)
    terms.add_tangent(contact.model, tuple(mats))
    for mat in mats:
        mat.assemble()
    return mats


def block_faults(contact, scene, v, r, numbers):
    """Check that the tangent is symmetric, semi-definite and the true derivative. Collective."""
    mats = blocks_of(contact)
    out = []
    norms = [mat.norm(PETSc.NormType.FROBENIUS) for mat in mats]
    scale = max(*norms, 1e-300)
    for name, value in zip(("ss", "sm", "ms", "mm"), norms, strict=True):
        numbers.add(f"norm of block {name}", value, scale)
    Kv = apply(mats, v)
    work = sum(a.dot(b) for a, b in zip(v, Kv, strict=True))
    numbers.add("work of the tangent", work, scale * sum(a.dot(a) for a in v))
    if contact.model.symmetric:
        if work < -1e-12 * scale * sum(a.dot(a) for a in v):
            out.append("the tangent is not positive semi-definite")
        w = [contact.slave.create_vec(), contact.master.create_vec()]
        for vec in w:
            vec.array[:] = np.sin(1.3 * np.arange(*vec.owner_range) ** 1.2)
        Kw = apply(mats, w)
        skew = sum(a.dot(b) for a, b in zip(w, Kv, strict=True))
        skew -= sum(a.dot(b) for a, b in zip(v, Kw, strict=True))
        size = np.sqrt(sum(a.dot(a) for a in v) * sum(a.dot(a) for a in w))
        if abs(skew) > 1e-12 * scale * size:
            out.append(f"the tangent is not symmetric: {abs(skew) / scale / size:.1e}")
        if contact.comm.size == 1:
            out += spectrum_faults(mats, scale)
    out += derivative_faults(contact, scene, v, r, Kv)
    for thing in (*mats, *Kv):
        thing.destroy()
    return out


def spectrum_faults(mats, scale):
    """Check the smallest eigenvalue of the whole tangent."""
    dense = [mat.convert("dense").getDenseArray() for mat in mats]
    K = np.block([[dense[0], dense[1]], [dense[2], dense[3]]])
    if np.abs(K - K.T).max() > 1e-12 * scale:
        return ["entries are not symmetric"]
    low = np.linalg.eigvalsh((K + K.T) / 2)[0]
    return [f"eigenvalue {low / scale:.1e}"] if low < -1e-12 * scale else []


def apply(mats, v):
    """Product of the tangent, of both bodies, with a vector. Collective."""
    out = v[0].duplicate(), v[1].duplicate()
    for i in (0, 1):
        mats[2 * i].mult(v[0], out[i])
        mats[2 * i + 1].multAdd(v[1], out[i], out[i])
    return out


def derivative_faults(contact, scene, v, r, Kv):
    """Check that the tangent gives the change of the residual for a fixed active set."""
    state = active_set.active_state(contact.model)
    h = 1e-4
    u = [unknowns(s, scene, i) for i, s in enumerate((contact.slave, contact.master))]
    for a, b in zip(u, v, strict=True):
        a.axpy(h, b)
    terms.evaluate(contact.model, *u)
    stays = contact.comm.allreduce(active_set.active_state(contact.model) == state, op=MPI.LAND)
    out = []
    if stays:
        there = residual(contact)
        change = [a - b for a, b in zip(there, r, strict=True)]
        size = sum(a.norm() for a in change) + sum(a.norm() for a in r) * 1e-7  # rounding
        for a, b in zip(change, Kv, strict=True):
            a.axpy(-h, b)
        error = sum(a.norm() for a in change)
        # Nodes that just touch, and move apart, are in the tangent and not in the residual.
        if size > 0 and error > 1e-7 * size + 1e-300:
            out.append(f"the tangent is not the derivative: {error / size:.1e}")
    return out
