"""Compare contact detection with the trees of libigl and DOLFINx: microseconds per node, one core.

The nodes of one wavy surface are projected onto the facets of another with 3/4 as many cells along
an edge. All methods run one after the other in the same run. The best of the repeats counts, in
processor time of all threads:

- update: the whole `contact.update()`: coordinates, nodal areas and normals, search, contact
  quadrature points, the operator of the weighted gap;
- pairing: only the search and the contact quadrature points (closest points, equal distances,
  normals, weights);
- search: only the closest facets, including the tree: exact projection, equal distances, the test
  of normals;
- libigl (if it can be imported): an AABB tree of the triangles, built and queried for the
  distances;
- DOLFINx: bounding-box and midpoint trees, closest facet and its distance (GJK), which treats a
  bilinear facet as the convex hull of its vertices; up to --dolfinx-limit nodes;
- k-d tree (SciPy): only the nearest vertex, less than the other methods find.

libigl handles only triangles. Columns a+b are seconds for building and querying a tree, per node.
"agreement" is the largest difference from the closest distances of libigl, or else of DOLFINx, over
the size of the surface; nodes beside the surface have no partner here and are left out. Facets
whose distances differ by less than 1e-10 of their size count as equally close here, so that the
choice does not depend on the number of ranks. The remaining difference from libigl's distances has
this cause.

    python3 bench/pairing.py --json pairing.json
"""

import argparse
import gc
import os
import pathlib
import sys
import time

os.environ["IGL_NUM_THREADS"] = "1"  # before libigl counts the cores

from mpi4py import MPI

import numpy as np
from scipy.spatial import cKDTree

import basix.ufl
from dolfinx import fem, geometry, mesh

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from machine import circumstances, write

import qsdolfinx as qs
import qsdolfinx._cpp as _cpp

try:
    import igl
except ImportError:
    igl = None

COMM = MPI.COMM_SELF
RADIUS = 0.5
TARGET = 1e-12  # agreement with libigl
FACET = {"triangle": "tetrahedron", "quadrilateral": "hexahedron"}


def wavy(n, facet, side, seed):
    """Make a surface of n × n squares, or twice as many triangles, at a wavy height around 0.

    The mesh has only the cells that the surface needs: a layer of hexahedra, or tetrahedra that all
    have one common point far below.
    """
    ticks = np.linspace(0, 1, n + 1)
    top = np.array(np.meshgrid(ticks, ticks, [0.0], indexing="ij")).reshape(3, -1).T
    rng = np.random.default_rng(seed)
    waves, phases = rng.normal(size=(4, 2)) * 5, rng.random(4) * 6
    top[:, 2] += 0.02 * np.sin(top[:, :2] @ waves.T + phases).sum(axis=1)
    down = np.array([0, 0, 1.0 if side == "slave" else -1.0])
    i, j = (a.ravel() for a in np.meshgrid(range(n), range(n), indexing="ij"))
    corners = np.stack([(i + a) * (n + 1) + j + b for a in (0, 1) for b in (0, 1)], axis=1)
    if facet == "quadrilateral":
        x = np.concatenate([top, top + down / n])
        cells = np.concatenate([corners, corners + len(top)], axis=1)
    else:
        x = np.concatenate([top, [top.mean(axis=0) + 3 * down]])
        apex = np.full(n * n, len(top))
        cells = np.concatenate(
            [np.column_stack([corners[:, list(c)], apex]) for c in ((0, 1, 3), (0, 2, 3))]
        )
    domain = basix.ufl.element("Lagrange", FACET[facet], 1, shape=(3,))
    msh = mesh.create_mesh(COMM, cells=cells.astype(np.int64), x=x, e=domain)
    return qs.Surface(fem.functionspace(msh, ("Lagrange", 1, (3,))), facets=facets_of_top(msh, top))


def facets_of_top(msh, top):
    """Return the facets with all vertices on top."""
    msh.topology.create_entities(2)
    for dims in ((2, 0), (2, 3), (0, 3)):
        msh.topology.create_connectivity(*dims)
    vertices = msh.topology.connectivity(2, 0)
    on_top = msh.geometry.input_global_indices < len(top)
    to_geometry = mesh.entities_to_geometry(
        msh, 0, np.arange(msh.topology.index_map(0).size_local, dtype=np.int32)
    ).ravel()
    of_facets = to_geometry[vertices.array].reshape(-1, vertices.offsets[1])
    return np.flatnonzero(on_top[of_facets].all(axis=1)).astype(np.int32)


class OurPairing:
    """Return functions of qsdolfinx: update of a contact, its pairing, and the search alone."""

    def __init__(self, slave, master):
        self.contact = qs.Contact(
            slave, master, formulation="master-slave", quadrature="nodal", search_radius=RADIUS
        )
        self.surfaces = slave, master

    def update(self):
        self.contact.update()

    def pairing(self):
        slave, master = (surface.cpp_object for surface in self.surfaces)
        _cpp.pair_surfaces(slave, master, False, RADIUS, 0)

    def search(self):
        slave, master = (surface.cpp_object for surface in self.surfaces)
        self.found, self.closest = _cpp.closest_facets(slave, master, RADIUS)

    def distances(self):
        """Return the distances of all nodes; nan for nodes without a partner."""
        out = np.linalg.norm(self.surfaces[0].node_x - self.closest, axis=1)
        return np.where(self.found, out, np.nan)


class Libigl:
    """Return functions of libigl: tree of axis-aligned boxes of triangles."""

    def __init__(self, slave, master):
        x = master.cpp_object.facet_x
        dofs = master.cpp_object.facet_dofs[:, :, 0]
        _, first, self.triangles = np.unique(dofs, return_index=True, return_inverse=True)
        self.triangles = np.ascontiguousarray(self.triangles.reshape(dofs.shape), dtype=np.int64)
        self.x = np.ascontiguousarray(x.reshape(-1, 3)[first])
        self.nodes = slave.node_x

    def build(self):
        self.tree = igl.AABB()
        self.tree.init(self.x, self.triangles)

    def ask(self):
        _, _, self.closest = self.tree.squared_distance(self.x, self.triangles, self.nodes)

    def distances(self):
        return np.linalg.norm(self.nodes - self.closest, axis=1)  # squares lose half the digits


class Dolfinx:
    """Return functions of DOLFINx: tree of axis-aligned boxes."""

    def __init__(self, slave, master):
        self.mesh, self.facets, self.nodes = master.mesh, master.facets, slave.node_x

    def build(self):
        self.tree = geometry.bb_tree(self.mesh, 2, entities=self.facets)
        self.midpoints = geometry.create_midpoint_tree(self.mesh, 2, self.facets)

    def ask(self):
        args = self.tree, self.midpoints, self.mesh, self.nodes
        self.squared = geometry.squared_distance(
            self.mesh, 2, geometry.compute_closest_entity(*args), self.nodes
        )

    def distances(self):
        return np.sqrt(self.squared)


class KdTree:
    """Return functions of SciPy: k-d tree of the vertices."""

    def __init__(self, slave, master):
        self.x, self.nodes = master.node_x, slave.node_x

    def build(self):
        self.tree = cKDTree(self.x)

    def ask(self):
        self.tree.query(self.nodes)


def measure(facet, n, repeats, dolfinx_limit):
    """Return microseconds per node of every step of every method, and the agreement."""
    slave, master = wavy(n, facet, "slave", 0), wavy(max(2, 3 * n // 4), facet, "master", 1)
    nodes = len(slave.node_x)
    methods = {"qsdolfinx": OurPairing(slave, master)}
    if igl is not None and facet == "triangle":
        methods["libigl"] = Libigl(slave, master)
    if nodes <= dolfinx_limit:
        methods["DOLFINx"] = Dolfinx(slave, master)
    methods["k-d tree"] = KdTree(slave, master)
    row = {"nodes": nodes, "facets": len(master.facets)}
    for name in methods:
        row[name] = dict.fromkeys(
            ("update", "pairing", "search") if name == "qsdolfinx" else ("build", "ask"), np.inf
        )
    for _ in range(repeats):
        for name, method in methods.items():
            for step, best in row[name].items():
                gc.collect()
                start = time.process_time()
                getattr(method, step)()
                seconds = time.process_time() - start
                row[name][step] = min(best, 1e6 * seconds / nodes)
    ours = methods["qsdolfinx"].distances()
    size = np.linalg.norm(np.ptp(master.node_x, axis=0))
    row["paired"] = int(np.isfinite(ours).sum())
    for name in ("libigl", "DOLFINx"):
        if name in methods:
            row[name]["agreement"] = np.nanmax(abs(ours - methods[name].distances())) / size
    return row


def line(facet, row):
    """Return one line of the table."""

    def tree(name):
        if name not in row:
            return f"{'-':>13}"
        return f"{row[name]['build']:.2f}+{row[name]['ask']:.2f}".rjust(13)

    ours = row["qsdolfinx"]
    text = f"{facet:14}{row['nodes']:>9}"
    text += "".join(f"{ours[step]:9.2f}" for step in ("update", "pairing", "search"))
    text += "".join(tree(name) for name in ("libigl", "DOLFINx", "k-d tree"))
    if "libigl" in row:
        text += f"{row['libigl']['ask'] / ours['pairing']:13.2f}"
    else:
        text += f"{'-':>13}"
    known = [name for name in ("libigl", "DOLFINx") if name in row]
    return text + (f"{row[known[0]]['agreement']:11.1e} ({known[0]})" if known else "")


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--nodes", type=float, nargs="+", default=[1e4, 1e5, 1e6])
    parser.add_argument("--facets", nargs="+", choices=tuple(FACET), default=list(FACET))
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--dolfinx-limit", type=float, default=2e4)
    parser.add_argument("--json", metavar="FILE")
    a = parser.parse_args()

    result = {"libigl": igl is not None, "rows": []}
    if igl is None:
        print("libigl is missing (python3 -m pip install libigl): its columns are empty")
    print("µs per node, one core; libigl, DOLFINx, k-d tree: build + query")
    print(
        f"{'facets':14}{'nodes':>9}{'update':>9}{'pairing':>9}{'search':>9}{'libigl':>13}"
        f"{'DOLFINx':>13}{'k-d tree':>13}{'igl/pairing':>13}{'agreement':>11}"
    )
    worst = 0.0
    for facet in a.facets:
        for nodes in a.nodes:
            n = max(2, round(nodes**0.5) - 1)
            row = measure(facet, n, a.repeats, a.dolfinx_limit)
            print(line(facet, row), flush=True)
            result["rows"].append({"facet": facet} | row)
            worst = max(worst, row.get("libigl", {}).get("agreement", 0.0))
    if a.json:
        write(a.json, circumstances(1) | result)
    if worst > TARGET:
        raise SystemExit(f"distances differ from libigl's by {worst:.1e} of the surface")


if __name__ == "__main__":
    main()
