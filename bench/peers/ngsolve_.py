"""The job through NGSolve: its ContactBoundary with a penalty energy, sampled on the slave.

python3 bench/peers/ngsolve_.py --sizes 22,18 --linear cg
"""

import argparse
import pathlib
import sys

import netgen.meshing as netgen
import ngsolve as ng
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import cubes

#: Relative residual at which CG ends, and the gap that counts as closed.
LINEAR, TOUCHING = 1e-8, 1e-12


def create_mesh(sizes):
    """Both cubes in one mesh, with their faces by name."""
    msh = netgen.Mesh()
    msh.dim = 3
    names, first = [], 0
    for i, n in enumerate(sizes):
        body = cubes.cube(n, float(i))
        msh.AddPoints(body.x)
        faces = {"held": body.high, "touching": body.low} if i else {}
        faces = faces or {"touching": body.high, "held": body.low}
        for kind, quads in faces.items():
            names.append(f"{kind}{i}")
            index = msh.Add(netgen.FaceDescriptor(surfnr=len(names), domin=i + 1, bc=len(names)))
            msh.AddElements(dim=2, index=index, data=quads.astype(np.int32) + first, base=0)
        msh.AddElements(dim=3, index=i + 1, data=body.cells.astype(np.int32) + first, base=0)
        first += len(body.x)
    for number, name in enumerate(names):
        msh.SetBCName(number, name)
    for i, name in enumerate(("lower", "upper")):
        msh.SetMaterial(i + 1, name)
    return ng.Mesh(msh)


def strain_energy(msh, u):
    """Density of the energy of both cubes."""
    mu, lame = (
        msh.MaterialCF({"lower": factor * cubes.E[0], "upper": factor * cubes.E[1]})
        for factor in (
            1 / (2 * (1 + cubes.NU)),
            cubes.NU / ((1 + cubes.NU) * (1 - 2 * cubes.NU)),
        )
    )
    strain = ng.Sym(ng.Grad(u))
    return mu * ng.InnerProduct(strain, strain) + lame / 2 * ng.Trace(strain) ** 2


def solve(p, sizes):
    """Row of results."""
    msh = create_mesh(sizes)
    V = ng.VectorH1(msh, order=1, dirichlet="held0|held1")
    u, gf = V.TrialFunction(), ng.GridFunction(V)
    a = ng.BilinearForm(V, symmetric=True)
    a += ng.Variation(strain_energy(msh, u).Compile() * ng.dx)
    order = (1, 0) if p.slave == "upper" else (0, 1)
    contact = ng.ContactBoundary(*(msh.Boundaries(f"touching{i}") for i in order))
    x = ng.CF((ng.x, ng.y, ng.z))
    gap = (x + u - (x.Other() + u.Other())) * ng.specialcf.normal(3)
    epsilon = cubes.penalty(sizes, p.factor)
    # Touching counts as closed; otherwise the upper cube would first fall through the lower one.
    contact.AddEnergy(ng.IfPos(gap + TOUCHING, epsilon / 2 * gap**2, 0))
    gf.Set(ng.CF((0, 0, cubes.PRESS)), definedon=msh.Boundaries("held1"))
    contact.Update(gf, a, intorder=p.order, maxdist=1.0 / min(sizes))
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
    held = msh.Boundaries("held0")
    z = np.arange(V.ndof // 3) + 2 * (V.ndof // 3)  # VectorH1 numbers component by component
    reaction = forces.vec.FV().NumPy()[z][np.array(V.components[2].GetDofs(held))]
    return {"force": float(abs(reaction.sum())), "newton": newton, "krylov": krylov}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", required=True)
    parser.add_argument("--linear", choices=("cg", "sparsecholesky", "umfpack"), default="cg")
    parser.add_argument("--factor", type=float, default=10.0, help="penalty over E/h")
    parser.add_argument("--slave", choices=("lower", "upper"), default="upper")
    parser.add_argument("--order", type=int, default=4, help="of the quadrature of the contact")
    parser.add_argument("--rtol", type=float, default=1e-6, help="where Newton's method ends")
    p = parser.parse_args()
    ng.SetNumThreads(1)
    row = solve(p, [int(n) for n in p.sizes.split(",")])
    cubes.report(**row, version=ng.__version__)


if __name__ == "__main__":
    main()
