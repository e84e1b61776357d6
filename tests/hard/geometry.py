"""Case 2: meshes of very different size, slivers, perturbed, nearly coincident and nested meshes.

Two elastic blocks are pressed together between rigid walls, so that the exact traction is uniform.
Overlay quadrature reproduces it at every node. With nodal quadrature, where the patch test fails on
non-matching meshes, the force is exact if the slave's nodes coincide with nodes of the master or
the other way round. Otherwise only a bound is checked.
"""

import numpy as np
from hard.bodies import Column, solve
from hard.cases import SHORT, Case, Variant

SHORTER = 1e-2
OFFSETS = (1e-14, 1e-12, 1e-10, 1e-8, 1e-6)
#: Largest error of the force with nodal quadrature on non-matching meshes.
ROUGH = 0.1
#: Reason for larger errors.
DENTED = (
    "A master that is much finer than the slave is dented between the slave's nodes, where nothing "
    "presses on it: use the overlay, or make the finer body the slave."
)


def slivers(n, ratio):
    """Return node positions such that every other cell is smaller by the ratio."""
    sizes = np.where(np.arange(n) % 2, 1.0 / ratio, 1.0)
    places = np.concatenate([[0.0], np.cumsum(sizes)])
    return places / places[-1]


def column(variant, cell, slave, master, near=0.5, **options):
    """Return the error of the tractions; with nodal quadrature that of the force."""
    heights = (0.0, near, 1.0)
    options |= variant.exact_gaps
    scene = Column(variant, (master, slave), cell, heights, **options)
    scene.push(-SHORTER)
    p = scene.problem()
    solve(p)
    error = scene.error(SHORTER / scene.compliance())
    p.destroy()
    return error


def meshes():
    """Yield label, whether nodes coincide, and arguments of the column."""
    for slave, master in ((2, 64), (64, 2)):
        yield f"slave:master {slave}:{master}, 2D", False, ("quadrilateral", slave, master), {}
    for slave, master in ((1, 32), (32, 1)):
        yield f"slave:master {slave}:{master}, 3D", False, ("hexahedron", slave, master), {}
    for cell, n, m in (("triangle", 9, 8), ("tetrahedron", 5, 4)):
        lines = slivers(n, 1e3), slivers(m, 1e3)
        yield f"facets 1:1000, {cell}", False, (cell, *lines), {}
        yield f"flat cells 1:1000, {cell}", False, (cell, n, m), {"near": 1e-3 / n}
    for cell in ("triangle", "quadrilateral", "tetrahedron", "hexahedron"):
        yield f"perturbed, {cell}", False, (cell, 6, 5), {"jitter": 0.3}
    for cell in ("quadrilateral", "tetrahedron"):
        for offset in OFFSETS:
            yield f"{offset:.0e} h apart, {cell}", True, (cell, 4, 4), {"offset": offset / 4}
        for slave, master in ((4, 12), (12, 4)):
            yield f"nested {slave}:{master}, {cell}", False, (cell, slave, master), {}


def cases(variant):
    nodal = variant.quadrature == "nodal"
    some = *SHORT[:2], Variant("master-slave", "overlay", "augmented-lagrangian")
    dented = {"quasi-symmetric": ("1:32",), "master-slave": ("1:32", "2:64"), "double-pass": ()}
    for label, meet, given, options in meshes():
        rough = nodal and not meet
        yield Case(
            "2 meshes",
            label,
            "force" if nodal else "tractions",
            ROUGH if rough else 1e-8 + 40 * options.get("offset", 0.0),
            lambda given=given, options=options: column(variant, *given, **options),
            variant in some and not any(w in label for w in ("3D", "e-12", "e-10", "hexahedron")),
            known=DENTED if nodal and any(w in label for w in dented[variant.formulation]) else "",
        )
