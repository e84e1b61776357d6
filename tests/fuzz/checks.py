"""Checks of contact detection and tangent blocks for any scene of ``run.py``."""

import itertools

from mpi4py import MPI

import numpy as np
from fuzz.blocks import assembly
from fuzz.bodies import make_contact
from fuzz.brute import dot, first_hits, is_warped, nodal_faults, outward
from scenes import all_facets


class Numbers:
    """Numbers of a scene that must not depend on the ranks, each with its reference size."""

    def __init__(self):
        self.values, self.sizes, self.names = [], [], []
        #: Reason why there is no solution.
        self.refused = None

    def add(self, name, value, size):
        self.names.append(name)
        self.values.append(float(value))
        self.sizes.append(float(size))

    def faults(self, other, tolerance):
        """Names of the numbers that differ from those of another run by more than a tolerance."""
        if self.names != other.names:
            return ["solved or refused"]
        out = []
        for name, a, b, size in zip(self.names, self.values, other.values, self.sizes, strict=True):
            if not abs(a - b) <= tolerance * max(size, 1e-300):
                out.append(f"{name}: {a:.12g} and {b:.12g}")
        return out

    @property
    def digest(self):
        """One number of the order of 1 for comparison."""
        sizes = np.maximum(self.sizes, 1e-300)
        return float(np.sum(np.array(self.values) / sizes * np.sin(1 + np.arange(len(sizes)))))


def check_scene(comm, scene):
    """Detect contact and assemble a scene. Collective.

    Returns:
        Its numbers, and the faults on this rank (a list of sentences).
    """
    contact = make_contact(comm, scene)
    faults = point_faults(contact, scene)
    if scene.options["quadrature"] == "nodal":
        for at, onto, found, point in paired_nodes(contact):
            facets, center = all_facets(onto), center_of(scene, onto is contact.master)
            radius = scene.options["search_radius"]
            given = at.node_x, at.node_normal, facets, center, radius, found, point
            faults += nodal_faults(*given, all_facets(at))
    else:
        faults += overlay_faults(contact, scene)
    numbers = pairing_numbers(contact)
    faults += assembly(contact, scene, numbers)
    return numbers, faults


# --- Contact detection


def point_faults(contact, scene):
    """Faults of single points: shape functions, unit normals, finite gaps within the radius."""
    out = []
    for p in contact.model.pairings:
        sides = (p.slave, p.master)
        arrays = [p.normal, p.gap, p.weight, *(s.x for s in sides)]
        arrays += [s.shape_values for s in sides]
        if not all(np.all(np.isfinite(a)) for a in arrays):
            out.append("points are not finite")
            continue
        if any(np.any(np.abs(s.shape_values.sum(axis=1) - 1) > 1e-9) for s in sides):
            out.append("shape functions do not sum to 1")
        if np.any(np.abs(np.linalg.norm(p.normal, axis=1) - 1) > 1e-12):
            out.append("normals are not of length 1")
        if np.any(p.weight < 0):
            out.append("negative weights")
        if np.any(np.abs(p.gap) > contact.settings.search_radius * (1 + 1e-9)):
            out.append("a gap beyond the radius")
        gap = dot(p.master.x - p.slave.x, p.normal)
        if np.any(np.abs(gap - p.gap) > 1e-9 * scene.size):
            out.append("the gap is not the distance along the normal")
    if any(gap.points.num_corners for gap in contact.model.gaps):  # the bodies are convex
        out.append("nodes in corners of a convex body")
    return out


def pairing_numbers(contact):
    """Sums over the points, which must be the same on every partition. Collective."""
    numbers = Numbers()
    comm, total = contact.comm, contact.slave.area + contact.master.area
    nodes = comm.allreduce(len(contact.slave.node_x) + len(contact.master.node_x))
    numbers.add("unpaired", contact.num_unpaired, nodes)
    for p in contact.model.pairings:
        sums = [p.weight.sum(), p.weight @ p.gap, *(p.weight @ p.normal)]
        sums += [*(p.weight @ p.slave.x), *(p.weight @ p.master.x)]
        sums += [np.sum(p.weight[:, None] * p.slave.shape_values**2)]
        sums += [np.sum(p.weight[:, None] * p.master.shape_values**2)]
        sums = comm.allreduce(np.array(sums), op=MPI.SUM)
        length = contact.slave.facet_size_range[1] + contact.master.facet_size_range[1]
        sizes = [total, total * length, *[total] * 3, *[total * length] * 6, total, total]
        for i, (value, size) in enumerate(zip(sums, sizes, strict=True)):
            numbers.add(f"sum {i} over points", value, size)
    return numbers


def center_of(scene, number):
    """A point inside a body of the scene."""
    return np.pad(scene.shapes[number].x.mean(axis=0), (0, 3 - scene.gdim))


def paired_nodes(contact):
    """Results of nodal quadrature: surfaces, paired nodes of the first, and their points.

    Each integration side pairs the nodes of its slave; quasi-symmetric contact also pairs the nodes
    of the master.
    """
    for p, pass_ in zip(contact.model.pairings, contact.model.gaps, strict=True):
        sides = (p.slave, pass_.slave), (p.master, pass_.master)
        for (node, at), (facet, onto) in itertools.permutations(sides):
            if at is pass_.slave or contact.settings.formulation == "quasi-symmetric":
                rows = np.all(node.dofs[:, 1:, 0] < 0, axis=1)
                found = np.isin(at.node_dofs[:, 0], node.dofs[rows, 0, 0])
                point = np.zeros((len(found), 3))
                point[found] = facet.x[rows]
                yield at, onto, found, point


def overlay_faults(contact, scene):
    """Faults if a facet lies between two paired points, or an area counts twice. Collective."""
    out = []
    surfaces = contact.slave, contact.master
    facets = [all_facets(s) for s in surfaces]
    normals = [outward(points, center_of(scene, i)) for i, points in enumerate(facets)]
    warped = any(f.shape[1] == 4 and is_warped(f) for f in facets)
    for number, p in enumerate(contact.model.pairings):
        share = (0.5, 0.5) if contact.settings.formulation == "quasi-symmetric" else (1, 0)
        areas = [s.area for s in surfaces][:: 1 - 2 * number]
        bound = share[0] * areas[0] + share[1] * areas[1]
        covered = contact.comm.allreduce(p.weight.sum(), op=MPI.SUM)
        if covered > bound * (1 + 1e-8):
            out.append(f"covered {covered / bound:.6f} of the area")
        apart = p.master.x - p.slave.x
        reach = np.linalg.norm(apart, axis=1)
        clear = reach > 1e-6 * scene.size
        if warped or contact.settings.normals != "facet" or not np.any(clear):
            continue
        # Along the line between the points, the facet that was found is the first that faces it.
        if share[1] == 0:  # all points are in slave segments
            hits = first_hits(p.slave.x, p.normal, facets[1 - number], normals[1 - number])
            behind = clear & (reach - hits > 1e-7 * scene.size)
            if np.any(behind):
                out.append(f"{np.count_nonzero(behind)} points are behind another facet")
    return out
