"""Picture of a forging: pressure on the lower die under three contact formulations.

python3 demos/forging_plot.py --die-refinement 4 forging.png
"""

import argparse
import dataclasses
import pathlib
import sys

from mpi4py import MPI

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

from forging import HEIGHT, SPEED, Parameters, run
from forging_film import GREY, Film
from plotting import draw_triangles, picture_file, pyplot, save, set_view

VARIANTS = (
    ("master-slave, nodal", {"formulation": "master-slave", "quadrature": "nodal"}),
    ("quasi-symmetric, nodal", {"quadrature": "nodal"}),
    ("quasi-symmetric, overlay", {"quadrature": "overlay"}),
)
LIFT = 6.0  # mm, by which the workpiece is drawn above the die
LIMIT = 300.0  # MPa, end of the scale
STEEL = (0.95, 0.55, 0.35, 1.0)


def draw(axis, state, scale):
    """Lower die with the pressure on its face, and the workpiece lifted off it."""
    set_view(axis, 28, 35, ((0, 18), (0, 18), (-9, 17)), zoom=1.0)
    triangles, pressure, on_face = state["lower"]
    colours = np.tile(GREY, (len(triangles), 1))
    colours[on_face] = scale.to_rgba(pressure[on_face])
    draw_triangles(axis, triangles, colours, linewidth=0.25)
    work = state["work"][0] + [0, 0, LIFT]
    draw_triangles(axis, work, np.tile(STEEL, (len(work), 1)), linewidth=0.3)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("filename", type=picture_file)
    parser.add_argument("--die-refinement", type=float, default=4.0)
    parser.add_argument("--reduction", type=float, default=0.3)
    parser.add_argument("--steps", type=int, default=Parameters.num_steps)
    a = parser.parse_args()
    base = Parameters(die_refinement=a.die_refinement, reduction=a.reduction, num_steps=a.steps)
    states = []
    for title, options in VARIANTS:
        film = Film(HEIGHT, SPEED)
        result, _ = run(dataclasses.replace(base, **options), on_step=film)
        if MPI.COMM_WORLD.rank == 0:
            states.append((title, film.states[-1]))
            print(f"{title:26} roughness {result['die_traction_roughness']:.3g}", flush=True)
    if MPI.COMM_WORLD.rank > 0:
        return
    from matplotlib import cm, colors

    figure = pyplot().figure(figsize=(12, 5.2))
    scale = cm.ScalarMappable(colors.Normalize(0, LIMIT), "viridis")
    for i, (title, state) in enumerate(states):
        axis = figure.add_axes((i / 3, 0.14, 1 / 3, 0.78), projection="3d")
        draw(axis, state, scale)
        figure.text((i + 0.5) / 3, 0.95, title, ha="center")
    bar = figure.add_axes((0.3, 0.12, 0.4, 0.03))
    label = "pressure on the lower die, mean of a facet (MPa); radius of the die 18 mm"
    figure.colorbar(scale, cax=bar, orientation="horizontal", extend="max", label=label)
    save(figure, a.filename)


if __name__ == "__main__":
    main()
