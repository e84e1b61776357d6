"""Short functions to set up bodies: facets, Dirichlet conditions, loads, reactions."""

import numpy as np

import ufl
from dolfinx import fem, la, mesh

from qsdolfinx.compat import model_to_mesh


def gmsh_mesh(comm, dim, draw):
    """Make the mesh of the model that ``draw(gmsh)`` builds; it is called on rank 0."""
    import gmsh

    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    if comm.rank == 0:
        draw(gmsh)
        gmsh.model.addPhysicalGroup(dim, [tag for _, tag in gmsh.model.getEntities(dim)], 1)
        gmsh.model.mesh.generate(dim)
    msh = model_to_mesh(gmsh.model, comm, 0, gdim=dim)[0]
    gmsh.finalize()
    return msh


def facets_at(msh, axis, value):
    """Return the boundary facets in a plane normal to an axis."""
    return mesh.locate_entities_boundary(
        msh, msh.topology.dim - 1, lambda x: np.isclose(x[axis], value)
    )


def fix(V, axis, facets, value=0.0):
    """Make a Dirichlet condition along one axis; the value of a fem.Constant can be changed."""
    component = V.sub(axis)
    dofs = fem.locate_dofs_topological(component, V.mesh.topology.dim - 1, facets)
    return fem.dirichletbc(value, dofs, component)


def measure(msh, facets):
    """Return the measure for integrals over some facets of the boundary."""
    facets = np.sort(facets)
    tags = mesh.meshtags(msh, msh.topology.dim - 1, facets, np.ones_like(facets))
    return ufl.Measure("ds", domain=msh, subdomain_data=tags)(1)


def integral(msh, form):
    """Integrate a scalar form over all ranks. Collective."""
    return msh.comm.allreduce(fem.assemble_scalar(fem.form(form)))


def per_area(msh, force, ds):
    """Return the traction of a total force that is spread evenly over the area of a measure."""
    return fem.Constant(msh, force / integral(msh, fem.Constant(msh, 1.0) * ds))


class Reaction:
    """Return the reaction force on some facets: the sum of the residual over their nodes.

    Args:
        F: Residual of the body without contact.
        V: Function space of its displacement.
        facets: Facets of the boundary.
    """

    def __init__(self, F, V, facets):
        self.V, self.residual = V, fem.form(F)
        nodes = fem.locate_dofs_topological(V, V.mesh.topology.dim - 1, facets)
        self.nodes = nodes[nodes < V.dofmap.index_map.size_local]

    def __call__(self):
        """The reaction force, a vector. Collective."""
        b = fem.assemble_vector(self.residual)
        b.scatter_reverse(la.InsertMode.add)
        at_nodes = b.array.reshape(-1, self.V.dofmap.bs)[self.nodes]
        return self.V.mesh.comm.allreduce(at_nodes.sum(axis=0))
