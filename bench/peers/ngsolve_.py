"""Run a job through NGSolve: its ContactBoundary with a penalty energy, sampled on the slave.

python3 bench/peers/ngsolve_.py --sizes 22,18 --linear cg
"""

import argparse
import pathlib
import sys

import netgen.meshing as netgen
import ngsolve as ng
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import jobs

#: Relative residual at which CG stops, and the gap below which contact counts as closed.
LINEAR, TOUCHING = 1e-8, 1e-12


def create_mesh(bodies):
    """Make one mesh of both bodies, with named faces."""
    msh = netgen.Mesh()
    msh.dim = 3
    names, first = [], 0
    for i, body in enumerate(bodies):
        msh.AddPoints(body.x)
        held, touching = (body.high, body.low) if i else (body.low, body.high)
        planes = {f"plane{axis}": quads for axis, quads in body.planes.items()}
        for kind, quads in ({"held": held, "touching": touching} | planes).items():
            names.append(f"{kind}_{i}")
            index = msh.Add(netgen.FaceDescriptor(surfnr=len(names), domin=i + 1, bc=len(names)))
            msh.AddElements(dim=2, index=index, data=quads.astype(np.int32) + first, base=0)
        msh.AddElements(dim=3, index=i + 1, data=body.cells.astype(np.int32) + first, base=0)
        first += len(body.x)
    for number, name in enumerate(names):
        msh.SetBCName(number, name)
    for i, name in enumerate(("lower", "upper")):
        msh.SetMaterial(i + 1, name)
    return ng.Mesh(msh)


def strain_energy(msh, u, job):
    """Return the energy density of both bodies."""
    mu, lame = (
        msh.MaterialCF({"lower": factor * job.E[0], "upper": factor * job.E[1]})
        for factor in (
            1 / (2 * (1 + job.NU)),
            job.NU / ((1 + job.NU) * (1 - 2 * job.NU)),
        )
    )
    strain = ng.Sym(ng.Grad(u))
    return mu * ng.InnerProduct(strain, strain) + lame / 2 * ng.Trace(strain) ** 2


def solve(p):
    """Return displacements and row of results."""
    bodies = p.job.bodies(p.sizes)
    msh = create_mesh(bodies)
    planes = {"xyz"[k]: f"held_.*|plane{k}_.*" for k in bodies[0].planes}
    held = {f"dirichlet{axis}": planes.get(axis, "held_.*") for axis in "xyz"}
    V = ng.VectorH1(msh, order=1, **held)
    u, gf = V.TrialFunction(), ng.GridFunction(V)
    a = ng.BilinearForm(V, symmetric=True)
    a += ng.Variation(strain_energy(msh, u, p.job).Compile() * ng.dx)
    order = (1, 0) if p.slave == "upper" else (0, 1)
    contact = ng.ContactBoundary(*(msh.Boundaries(f"touching_{i}") for i in order))
    x = ng.CF((ng.x, ng.y, ng.z))
    gap = (x + u - (x.Other() + u.Other())) * ng.specialcf.normal(3)
    epsilon = jobs.penalty(p.job, p.sizes, p.factor)
    # Touching counts as closed; otherwise the upper cube would first move through the lower one.
    contact.AddEnergy(ng.IfPos(gap + TOUCHING, epsilon / 2 * gap**2, 0))
    gf.Set(ng.CF((0, 0, p.job.PRESS)), definedon=msh.Boundaries("held_1"))
    contact.Update(gf, a, intorder=p.order, maxdist=max(p.job.cell_size(n) for n in p.sizes))
    free = V.FreeDofs()
    residual, step = gf.vec.CreateVector(), gf.vec.CreateVector()
    jacobi = ng.Preconditioner(a, "local")
    newton, krylov, first = 0, 0, None
    while True:
        a.Apply(gf.vec, residual)
        forces = ng.GridFunction(V)
        forces.vec.data = residual
        residual.data = ng.Projector(free, True) * residual
        norm = residual.Norm()
        first = first or norm
        if norm <= p.rtol * first:
            break
        a.AssembleLinearization(gf.vec)
        if p.linear == "cg":
            solver = ng.CGSolver(a.mat, jacobi.mat, maxiter=20000, tol=LINEAR)
            step.data = solver * residual
            krylov += solver.GetSteps()
        else:
            step.data = a.mat.Inverse(free, inverse=p.linear) * residual
        gf.vec.data -= step
        newton += 1
        print(f"Newton {newton}: |r| = {norm:.3e}", flush=True)
    held = msh.Boundaries("held_0")
    z = np.arange(V.ndof // 3) + 2 * (V.ndof // 3)  # VectorH1 numbers component by component
    reaction = forces.vec.FV().NumPy()[z][np.array(V.components[2].GetDofs(held))]
    values = gf.vec.FV().NumPy().reshape(3, -1).T
    return values, {"force": float(abs(reaction.sum())), "newton": newton, "krylov": krylov}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    jobs.add_arguments(parser)
    parser.add_argument("--linear", choices=("cg", "sparsecholesky", "umfpack"), default="cg")
    parser.add_argument("--factor", type=float, default=10.0, help="penalty over E/h")
    parser.add_argument("--slave", choices=("lower", "upper"), default="upper")
    parser.add_argument("--order", type=int, default=4, help="quadrature order of the contact")
    parser.add_argument("--rtol", type=float, default=1e-6, help="tolerance of Newton's method")
    p = jobs.parse(parser)
    ng.SetNumThreads(1)
    u, row = solve(p)
    jobs.report(p.output, u, **row, version=ng.__version__)


if __name__ == "__main__":
    main()
