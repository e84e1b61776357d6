"""Picture of a forging: pressure on the lower die under three contact formulations.

python3 demos/forging_plot.py --die-refinement 4 forging.png
"""

import argparse
import dataclasses
import pathlib
import sys

from mpi4py import MPI

import matplotlib
import numpy as np
from matplotlib import cm, colors
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from dolfinx import mesh

matplotlib.use("Agg")
import matplotlib.pyplot as plt

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from forging import Parameters, run

VARIANTS = (
    ("master-slave, nodal", {"formulation": "master-slave", "quadrature": "nodal"}),
    ("quasi-symmetric, nodal", {"quadrature": "nodal"}),
    ("quasi-symmetric, overlay", {"quadrature": "overlay"}),
)
LIFT = 4.0  # mm, by which the workpiece is drawn above the die
LIMIT = 300.0  # MPa, end of the scale


def boundary(msh, x):
    """Boundary triangles of a tetrahedral mesh: nodes (facets, 3), coordinates (facets, 3, 3)."""
    msh.topology.create_connectivity(2, 3)
    facets = mesh.exterior_facet_indices(msh.topology)
    nodes = mesh.entities_to_geometry(msh, 2, facets)
    return nodes, x[nodes]


def add(axis, triangles, colors, **options):
    """Triangles lit from above."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    light = 0.6 + 0.4 * np.abs(normal @ [0.3, 0.5, 0.81])
    shaded = np.array(colors)
    shaded[:, :3] *= light[:, None]
    axis.add_collection3d(Poly3DCollection(triangles, facecolors=shaded, **options))


def draw(axis, title, scene, scale):
    """Lower die with the pressure on its face, and the workpiece lifted off it."""
    work, dies, contacts, _, stepper = scene
    die, motion = dies[0], stepper.motions[1]
    pressure = np.zeros(len(motion.reference))
    traction = contacts[0].traction("master").x.array.reshape(-1, 3)
    # P1: one node of the space and one of the geometry at each vertex.
    for nodes, dofs in zip(die.mesh.geometry.dofmap, die.V.dofmap.list, strict=True):
        pressure[nodes] = -traction[dofs, 2]
    nodes, triangles = boundary(die.mesh, motion.reference + motion.values())
    on_face = np.isclose(motion.reference[nodes, 2], 0.0).all(axis=1)
    colors = np.full((len(nodes), 4), 0.75)
    colors[on_face] = scale.to_rgba(pressure[nodes[on_face]].mean(axis=1))
    colors[:, 3] = 1.0
    add(axis, triangles, colors, linewidth=0.1, edgecolor=(0, 0, 0, 0.3))
    lift = np.array([0, 0, LIFT])
    _, triangles = boundary(work.mesh, work.mesh.geometry.x + lift)
    steel = np.tile([0.95, 0.55, 0.35, 1.0], (len(triangles), 1))
    add(axis, triangles, steel, linewidth=0.3, edgecolor=(0, 0, 0, 0.5))
    axis.set_title(title, fontsize=11)
    axis.set(xlim=(0, 18), ylim=(0, 18), zlim=(-9, 17))
    axis.set_box_aspect((18, 18, 26))
    axis.view_init(elev=28, azim=35)
    axis.set_axis_off()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("filename")
    parser.add_argument("--die-refinement", type=float, default=4.0)
    parser.add_argument("--reduction", type=float, default=0.3)
    a = parser.parse_args()
    if MPI.COMM_WORLD.size > 1:
        parser.error("draws on one rank only")
    figure = plt.figure(figsize=(14, 6.2), layout="constrained")
    scale = cm.ScalarMappable(colors.Normalize(0, LIMIT), "viridis")
    axes = []
    for i, (title, options) in enumerate(VARIANTS):
        p = dataclasses.replace(
            Parameters(die_refinement=a.die_refinement, reduction=a.reduction), **options
        )
        result, scene = run(p)
        axes.append(figure.add_subplot(1, 3, i + 1, projection="3d"))
        draw(axes[-1], title, scene, scale)
        print(f"{title:26} roughness {result['die_traction_roughness']:.3g}")
    bar = figure.colorbar(scale, ax=axes, orientation="horizontal", shrink=0.4, extend="max")
    bar.set_label("pressure on the die, mean of a facet (MPa)")
    figure.savefig(a.filename, dpi=110)


if __name__ == "__main__":
    main()
