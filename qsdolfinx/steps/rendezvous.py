"""Exchange values by keys between ranks."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Keys = npt.NDArray[np.int64]
Indices = npt.NDArray[np.int64]


def find(comm: MPI.Intracomm, known: Keys, values: Array, wanted: Keys) -> tuple[Indices, Array]:
    """Find the values of keys, stored on any rank. Collective.

    Known and wanted keys are compared on a rank that is computed from the key. Each rank
    temporarily stores its share of the keys; no rank stores all of them.

    Args:
        comm: Communicator of the ranks.
        known: Keys whose values this rank has, (known, n); a key may occur several times, on any
            ranks.
        values: Their values, (known, m).
        wanted: Keys whose values this rank needs, (wanted, n).

    Returns:
        For each value that was found: the number of its key in ``wanted``, (found,), and the value,
        (found, m).
    """
    asking = _by_rank(comm, wanted)
    stored = comm.alltoall([(known[some], values[some]) for some in _by_rank(comm, known)])
    asked = comm.alltoall([wanted[some] for some in asking])
    keys, of_keys = (np.concatenate(parts) for parts in zip(*stored, strict=True))
    matches = [_matches(keys, want) for want in asked]
    answers = comm.alltoall([(number, of_keys[at]) for number, at in matches])
    number = [some[of] for some, (of, _) in zip(asking, answers, strict=True)]
    return np.concatenate(number), np.concatenate([found for _, found in answers])


def digests(keys: Keys) -> npt.NDArray[np.uint64]:
    """A number for each key that depends on all its columns, the same on any rank, (keys,)."""
    out = np.zeros(len(keys), dtype=np.uint64)
    for column in keys.astype(np.uint64).T:
        out = (out + column + np.uint64(1)) * np.uint64(6364136223846793005)
        out ^= out >> np.uint64(29)
    return out


def _by_rank(comm: MPI.Intracomm, keys: Keys) -> list[Indices]:
    """Indices of the keys assigned to each rank, by a digest of their columns."""
    rank = digests(keys) % np.uint64(comm.size)
    return [np.flatnonzero(rank == r) for r in range(comm.size)]


def _matches(keys: Keys, wanted: Keys) -> tuple[Indices, Indices]:
    """Pairs of equal keys: their indices in ``wanted``, and in ``keys``, where keys may repeat."""
    if len(keys) == 0 or len(wanted) == 0 or keys.shape[1] != wanted.shape[1]:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    _, label = np.unique(np.vstack([keys, wanted]), axis=0, return_inverse=True)
    mine, asked = np.split(label.ravel(), [len(keys)])
    order = np.argsort(mine, kind="stable")
    first = np.searchsorted(mine[order], asked, side="left")
    count = np.searchsorted(mine[order], asked, side="right") - first
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return np.repeat(np.arange(len(wanted)), count), order[np.repeat(first, count) + within]
