"""Closest facets: this package's search (Boost R-tree) against DOLFINx's BoundingBoxTree.

Nodes of one wavy surface are projected onto the facets of another, of a different cell count, at
growing numbers of nodes n. Printed are microseconds per node, which grow like log n if the search
is O(n log n), and how far the distances found differ:

- qsdolfinx: pairing of the slave nodes, with exact closest points, ties and the test of normals;
- DOLFINx: bounding-box and midpoint trees, closest facet and its distance (GJK), which takes a
  bilinear facet for the convex hull of its vertices.

Times are of one process; several methods alternate, and the best of the repeats is taken.

    python3 bench/search.py --json search.json
"""

import argparse
import json
import time

from mpi4py import MPI

import numpy as np

from dolfinx import fem, geometry, mesh

import qsdolfinx as qs

COMM = MPI.COMM_SELF


def wavy(n, cell, side, seed):
    """Facets at a wavy height 0 of a slab of n × n × 1 cells, as a surface."""
    low, high = (0.0, 1.0) if side == "slave" else (-1.0, 0.0)
    box = mesh.create_box(COMM, [[0, 0, low], [1, 1, high]], [n, n, 1], mesh.CellType[cell])
    rng = np.random.default_rng(seed)
    waves, phases = rng.normal(size=(4, 2)) * 5, rng.random(4) * 6
    x = box.geometry.x
    facets = mesh.locate_entities_boundary(box, 2, lambda x: np.isclose(x[2], 0))
    x[:, 2] += 0.02 * np.sin(x[:, :2] @ waves.T + phases).sum(axis=1)
    return qs.Surface(fem.functionspace(box, ("Lagrange", 1, (3,))), facets=facets)


def search_qsdolfinx(slave, master):
    """Distances from all slave nodes; nan where the node has no partner."""
    contact = qs.Contact(slave, master, "master-slave", search_radius=0.5)
    distance = np.full(len(slave.node_x), np.nan)
    index = {tuple(x): k for k, x in enumerate(slave.node_x)}
    pairing = contact.pairing
    found = [index[tuple(x)] for x in pairing.slave.x]
    distance[found] = np.linalg.norm(pairing.slave.x - pairing.master.x, axis=1)
    return contact.seconds, distance


def search_dolfinx(slave, master):
    """Distances from all slave nodes."""
    start = time.perf_counter()
    msh, facets = master.mesh, master.facets
    tree = geometry.bb_tree(msh, 2, entities=facets)
    midpoints = geometry.create_midpoint_tree(msh, 2, facets)
    closest = geometry.compute_closest_entity(tree, midpoints, msh, slave.node_x)
    distance = np.sqrt(geometry.squared_distance(msh, 2, closest, slave.node_x))
    return time.perf_counter() - start, distance


METHODS = {"qsdolfinx": search_qsdolfinx, "DOLFINx": search_dolfinx}


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", type=int, nargs="+", default=[20, 40, 80, 160, 320])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", metavar="FILE")
    a = parser.parse_args()

    result = {}
    print(f"{'cell':13}{'nodes':>8}{'qsdolfinx':>12}{'DOLFINx':>10}{'ratio':>7}   µs per node")
    for cell in ("tetrahedron", "hexahedron"):
        for n in a.sizes:
            slave = wavy(n, cell, "slave", 0)
            master = wavy(max(2, 3 * n // 4), cell, "master", 1)
            times = {name: [] for name in METHODS}
            distances = {}
            for _ in range(a.repeats):
                for name, method in METHODS.items():
                    seconds, distances[name] = method(slave, master)
                    times[name].append(seconds)
            nodes = len(slave.node_x)
            best = {name: 1e6 * min(t) / nodes for name, t in times.items()}
            worse = np.nanmax(distances["qsdolfinx"] - distances["DOLFINx"])
            better = np.nanmax(distances["DOLFINx"] - distances["qsdolfinx"])
            ratio = best["DOLFINx"] / best["qsdolfinx"]
            print(
                f"{cell:13}{nodes:8}{best['qsdolfinx']:12.2f}{best['DOLFINx']:10.2f}{ratio:7.2f}"
                f"   distance minus DOLFINx's: largest {worse:.1e}, smallest {-better:.1e}"
            )
            result[f"{cell}_{nodes}"] = best
    if a.json:
        with open(a.json, "w") as file:
            json.dump(result, file, indent=2)


if __name__ == "__main__":
    main()
