"""Make the upper die of the forging with an STL die: its shape, and the file."""

import pathlib
import tempfile

import numpy as np

import qsdolfinx as qs

HEIGHT = 12.0  # mm, initial height of the land of the die, and of the billet


def profile(r):
    """Return the height of the upper die above its land: a pocket with a wall from 4 to 7.5 mm."""
    s = np.clip((7.5 - r) / 3.5, 0, 1)
    return 4 * s**2 * (3 - 2 * s)


def write_stl(filename, rings=48, sectors=36):
    """Write the upper die, a little more than a quarter of it, with its land at z = HEIGHT."""
    r, angle = np.meshgrid(np.linspace(0, 18, rings), np.radians(np.linspace(-10, 100, sectors)))
    x = np.stack([r * np.cos(angle), r * np.sin(angle), HEIGHT + profile(r)], axis=-1)
    a, b, c, d = x[:-1, :-1], x[:-1, 1:], x[1:, 1:], x[1:, :-1]
    corners = np.concatenate([np.stack([a, c, b], 2), np.stack([a, d, c], 2)], axis=1)
    corners = corners.reshape(-1, 3, 3)  # counter-clockwise seen from below, from the billet
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    corners = corners[np.linalg.norm(sides, axis=1) > 1e-9]  # triangles at the axis are degenerate
    facet = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets = np.zeros(len(corners), dtype=facet)
    facets["corners"] = corners
    with open(filename, "wb") as file:
        file.write(b"upper die, mm".ljust(80) + np.uint32(len(facets)).tobytes())
        file.write(facets.tobytes())


def read_die(comm):
    """Write the upper die to a file, and read it from there."""
    with tempfile.TemporaryDirectory() as folder:
        filename = comm.bcast(pathlib.Path(folder) / "die.stl")
        if comm.rank == 0:
            write_stl(filename)
        die = qs.RigidSurface.from_stl(comm, filename)  # read on rank 0, which has written it
        comm.barrier()
    return die
