"""A steel ball in a socket that is 1 % wider: how coarse facets affect a small clearance.

Axisymmetric, linear elastic (E = 210 GPa, ν = 0.3). A half ball of radius 10 mm, pressed on its
flat side, lies in the socket of a block, radius 10.1 mm. The load, 1219 N, gives a contact radius
of 2 mm by Hertz' theory; R* = 1010 mm, p₀ = 145 MPa. Facets are chords; their distance from the
circle is h²/8R, for facets of 1.6 mm a third of the clearance. Both mesh sizes are solved in four
ways:

- facets: chords;
- curvature: meshes of degree 2 by qs.elevate, displacements of degree 1;
- curved: meshes of degree 2 by gmsh, displacements of degree 1;
- curved_p2: meshes and displacements of degree 2.

    python3 demos/engineering/ball_in_socket.py --plot ball_in_socket.png
    mpirun -n 2 python3 demos/engineering/ball_in_socket.py --h 0.4 --json ball.json

Keys of the JSON object, for each way of solving and, with the prefix "coarse_", for facets of size
--coarse:

- peak_error_facets, ...: largest pressure of the ball over Hertz' p₀, − 1; the half-spaces of
  Hertz' theory are a little softer than these bodies (+ 3 % on fine meshes);
- radius_error_facets, ...: relative error of the largest radius of ball nodes in contact.

Further, force_error is the largest relative difference of contact force and load of all cases.
"""

import dataclasses
import pathlib
import sys

from mpi4py import MPI

import numpy as np

import qsdolfinx as qs

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from ball_in_socket_bodies import BALL, LOAD, P0, RADIUS, SOCKET, Body
from common import machine_parts
from common.command import Command, option, report
from common.limits import check

#: Degree of the mesh, or "elevated", and degree of the displacements.
WAYS = {
    "facets": (1, 1),
    "curvature": ("elevated", 1),
    "curved": (2, 1),
    "curved_p2": (2, 2),
}
LIMITS = {"peak_error_curved_p2": 0.05, "coarse_peak_error_curved_p2": 0.15, "force_error": 1e-8}


@dataclasses.dataclass
class Parameters:
    """Mesh sizes on the ball; facets of the socket are 0.7 times as large."""

    h: float = option(0.2, "fine mesh size, mm")
    coarse: float = option(1.6, "coarse mesh size, mm")


def press(comm, h, way):
    """Solve one case; return the bodies, radii and pressures of nodes, contact radius, force."""
    degrees = WAYS[way]
    bodies = ball, socket = Body(comm, BALL, h, degrees), Body(comm, SOCKET, 0.7 * h, degrees)
    contact = qs.Contact(ball.surface, socket.surface)
    problem = qs.ContactProblem(
        [b.F for b in bodies], [b.u for b in bodies], [contact], [b.bcs for b in bodies]
    )
    problem.solve()
    surface = ball.surface
    traction = surface.node_values(contact.traction("slave"))
    p = -np.sum(traction * surface.node_normal[:, :2], axis=1)
    nodes = np.concatenate(comm.allgather(np.stack([surface.node_x[:, 0], p], axis=-1)))
    radius = np.sqrt(contact.patch()[0] / np.pi)
    return bodies, nodes[np.argsort(nodes[:, 0])], radius, contact.force("slave")[1]


def run(p, comm=MPI.COMM_WORLD):
    """Solve in all ways on both meshes; return the --json object, and pressures with the bodies."""
    result, forces, drawn = {}, [], {}
    for prefix, h in (("", p.h), ("coarse_", p.coarse)):
        for way in WAYS:
            bodies, nodes, radius, force = press(comm, h, way)
            result[f"{prefix}peak_error_{way}"] = nodes[:, 1].max() / P0 - 1
            result[f"{prefix}radius_error_{way}"] = radius / RADIUS - 1
            forces.append(abs(force / LOAD - 1))
            drawn[prefix + way] = bodies, nodes
    return result | {"force_error": max(forces)}, drawn


def main():
    p, a = Command(__doc__, Parameters, plot="draw ball and socket, and pressures").parse()
    result, drawn = run(p)
    report(result, a.json, ".3g")
    check(result, LIMITS)
    if a.plot:
        machine_parts.ball_in_socket(a.plot, drawn, (p.h, p.coarse), RADIUS, P0)


if __name__ == "__main__":
    main()
