"""An O-ring squeezed in its groove: which elements lock, and which do not.

A quarter of the section, by symmetry: radius 1, plane strain, neo-Hookean rubber (shear modulus 1),
squeezed by a quarter of its height between the rigid bottom and lid of a groove 3 wide, without
friction. Three elements are compared on the same mesh of triangles with curved edges: displacements
of degree 1 (p1), displacements of degree 2 (p2), and displacements of degree 2 with a continuous
pressure of degree 1 as an unknown (mixed; Taylor and Hood).

    python3 demos/engineering/oring.py --plot oring_locking.png
    mpirun -n 2 python3 demos/engineering/oring.py --nu 0.4999 --json oring.json

Lindley's formula (J. IRI 1, 1967), fitted to measurements: rings that may expand need a force of E
d (1.25 c^1.5 + 50 c^6) per length for a squeeze c of their diameter d. In plane strain E / (1 − ν²)
replaces E. Keys of the JSON object, for each element:

- force_error_p1, ...: force on the lid over Lindley's force, − 1;
- iterations_p1, ...: number of Newton iterations, all steps.
"""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

from dolfinx import mesh

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from common import machine_parts
from common.bodies import facets_at, fix, gmsh_mesh
from common.command import Command, option, report
from common.limits import check
from rubber_bodies import MU, RADIUS, MixedRubber, Rubber

ELEMENTS = ("p1", "p2", "mixed")
HALF_WIDTH, SQUEEZE, STEPS = 1.5, 0.25, 5
LINDLEY = (1.25 * SQUEEZE**1.5 + 50 * SQUEEZE**6) * 2 * RADIUS  # stress over the shear modulus
LIMITS = {"force_error_p2": 0.03, "force_error_mixed": 0.03}


@dataclasses.dataclass
class Parameters:
    """Parameters of a squeezed ring."""

    facet: float = option(0.1, "size of facets")
    nu: float = option(0.499, "Poisson's ratio")


def create(comm, p, element):
    """The quarter of a ring with one of ELEMENTS, supported by symmetry."""

    def draw(gmsh):
        for name, value in (("SizeMax", p.facet), ("SizeMin", p.facet)):
            gmsh.option.setNumber(f"Mesh.Mesh{name}", value)
        gmsh.option.setNumber("Mesh.ElementOrder", 2)
        occ, corner = gmsh.model.occ, (0, 0, 0, RADIUS, RADIUS)
        occ.intersect([(2, occ.addDisk(0, 0, 0, RADIUS, RADIUS))], [(2, occ.addRectangle(*corner))])
        occ.synchronize()

    msh, lmbda = gmsh_mesh(comm, 2, draw), 2 * MU * p.nu / (1 - 2 * p.nu)
    arc = mesh.locate_entities_boundary(msh, 1, lambda x: x[0] ** 2 + x[1] ** 2 > 0.999 * RADIUS**2)
    if element == "mixed":
        body = MixedRubber(msh, arc, lmbda)
    else:
        body = Rubber(msh, int(element[1]), arc, lmbda=lmbda, reduced=False)
    body.bcs = [fix(body.V, axis, facets_at(msh, axis, 0.0)) for axis in (0, 1)]
    return body


def squeeze(comm, p, element):
    """Squeeze the ring: force on the lid over Lindley's, − 1; iterations; the ring. Collective."""
    body = create(comm, p, element)
    lid = qs.RigidSurface.plane(comm, [0, RADIUS], [0, -1])
    wall = qs.RigidSurface.plane(comm, [HALF_WIDTH, 0], [-1, 0])
    contacts = [qs.Contact(body.surface, tool, search_radius=1.0) for tool in (lid, wall)]
    problem = qs.ContactProblem([body.F], [body.u], contacts, [body.bcs])

    def drive(t, dt):
        lid.displacement = [0, -RADIUS * SQUEEZE * dt / STEPS]

    stepper, iterations = qs.TimeStepper(problem, 1.0, drive), 0
    for _ in stepper.run(float(STEPS)):
        iterations += stepper.num_iterations
    if element == "mixed":
        body.u = body.u.sub(0).collapse()  # for the picture
    force = 2 * contacts[0].force("master")[1] / (LINDLEY * 2 * MU / (1 - p.nu))
    return force - 1, iterations, body


def run(p, comm=MPI.COMM_WORLD):
    """Solve with each element; return the --json object, and the rings."""
    result, rings = {}, {}
    for element in ELEMENTS:
        error, iterations, rings[element] = squeeze(comm, p, element)
        result |= {f"force_error_{element}": error, f"iterations_{element}": iterations}
    return result, rings


def main():
    p, a = Command(__doc__, Parameters, plot="draw three of the squeezed rings").parse()
    result, rings = run(p)
    report(result, a.json, ".4g")
    check(result, LIMITS)
    if a.plot:
        forces = {name: 1 + result[f"force_error_{name}"] for name in ELEMENTS}
        machine_parts.oring(a.plot, rings, forces, RADIUS * (1 - SQUEEZE), HALF_WIDTH)


if __name__ == "__main__":
    main()
