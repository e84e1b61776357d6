from mpi4py import MPI

import matplotlib.pyplot as plt
import numpy as np

import ufl
from dolfinx import fem, mesh

import qsdolfinx as qs


def block(low, high, cells, E, held, move):
    msh = mesh.create_rectangle(MPI.COMM_WORLD, [low, high], cells)
    V = fem.functionspace(msh, ("Lagrange", 1, (2,)))
    u, v = fem.Function(V), ufl.TestFunction(V)
    F = ufl.inner(qs.materials.linear_elastic(u, E, 0.3), ufl.grad(v)) * ufl.dx
    dofs = fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[1], held))
    touching = mesh.locate_entities_boundary(msh, 1, lambda x: np.isclose(x[1], 0))
    return F, u, fem.dirichletbc(np.array(move), dofs, V), qs.Surface(V, facets=touching)


die = block((-0.4, 0), (0.4, 0.5), (9, 6), 1e4, 0.5, (0.0, -0.1))
base = block((-1, -1), (1, 0), (40, 20), 1e3, -1.0, (0.0, 0.0))
F, u, bcs, (slave, master) = zip(die, base)
contact = qs.Contact(slave, master, friction=qs.Coulomb(0.2))
problem = qs.ContactProblem(F, u, contact, bcs)
problem.solve()
print("force on the die:", contact.force("slave"))

for u_i in u:  # on one rank: vertices are numbered as unknowns are
    x, way = u_i.function_space.mesh.geometry.x, u_i.x.array.reshape(-1, 2)
    cells = u_i.function_space.mesh.geometry.dofmap
    places, down = (x[:, :2] + way).T, -way[:, 1]
    plt.tripcolor(*places, cells, down, edgecolors="k", vmin=0, vmax=0.1)
plt.axis("equal")
plt.axis("off")
plt.savefig("first.png", bbox_inches="tight")
