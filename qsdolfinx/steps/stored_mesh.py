"""Meshes of remeshed bodies in a checkpoint."""

from __future__ import annotations

import pathlib

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from dolfinx import mesh

from qsdolfinx.base.checks import PATH, check, instance
from qsdolfinx.base.collective import checked, collective_errors
from qsdolfinx.remeshing.outline import Outline, gather
from qsdolfinx.remeshing.remesh import distribute, tags_of
from qsdolfinx.steps.checkpoint import Checkpoint
from qsdolfinx.steps.stepper import TimeStepper

COMM = instance(MPI.Intracomm, "a communicator of mpi4py")

Arrays = dict[str, npt.NDArray[np.generic]]


def stored(stepper: TimeStepper) -> dict[str, Arrays]:
    """Arrays of remeshed bodies' meshes on rank 0, by file; empty on other ranks. Collective.

    Rank 0 holds a whole mesh for a while, as it does in remeshing.
    """
    remeshing, out = stepper.remeshing, {}
    if remeshing is None:
        return {}
    known = remeshing.facet_tags or [None for _ in stepper.motions]
    for i, (motion, flows) in enumerate(zip(stepper.motions, stepper.in_velocity, strict=True)):
        if not flows:
            continue
        x = np.asarray(motion.mesh.geometry.x, dtype=np.float64)
        outline = gather(motion.mesh, x, np.zeros(len(x)), known[i])
        out[f"mesh_{i}"] = {} if outline is None else _arrays(outline)
    return out


def _arrays(outline: Outline) -> Arrays:
    return {"x": outline.x, "cells": outline.cells, "facets": outline.facets, "tags": outline.tags}


def load_meshes(
    comm: MPI.Intracomm, folder: str | pathlib.Path
) -> tuple[list[mesh.Mesh | None], list[mesh.MeshTags | None]]:
    """Load the meshes of a run with remeshing from its checkpoint. Collective.

    Make the problem on these meshes, with ``remesh`` for the stepper as before, and continue with
    :func:`qs.load_run`. Rank 0 reads the meshes and distributes them.

    Args:
        comm: Communicator, of any number of ranks.
        folder: Folder of the checkpoint, as in :func:`qs.save_run`.

    Returns:
        For each body its mesh, and the tags of its facets; None for bodies that keep their meshes.

    Raises:
        OSError: If there is no checkpoint.
        ValueError: If the checkpoint is of a run without remeshing.
    """
    with checked(comm) as same:
        check(COMM, comm=comm)
        check(PATH, folder=folder)
        same(folder=str(folder))
    checkpoint = Checkpoint(comm, folder)
    count = checkpoint.values().get("num_bodies")
    with collective_errors(comm):
        if count is None:
            raise ValueError(f"folder: {folder} is of a run that was saved without new meshes")
    meshes: list[mesh.Mesh | None] = [None for _ in range(count)]
    tags: list[mesh.MeshTags | None] = [None for _ in range(count)]
    for i in range(count):
        arrays = checkpoint.arrays(f"mesh_{i}")
        if comm.bcast(arrays is None, root=0):
            continue
        parts = None if not arrays else (arrays["x"], arrays["cells"])
        gdim = comm.bcast(None if not arrays else arrays["facets"].shape[1], root=0)
        meshes[i] = found = distribute(comm, gdim, parts)
        tags[i] = tags_of(found, None if not arrays else (arrays["facets"], arrays["tags"]))
    return meshes, tags
