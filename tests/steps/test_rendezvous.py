"""Find values by keys that any rank may have, compared with a dictionary of all values."""

import numpy as np
import pytest
from scenes import WORLD

from qsdolfinx.steps.checkpoint import Checkpoint
from qsdolfinx.steps.rendezvous import find


@pytest.mark.parallel
def test_all_values_of_keys_are_found():
    """Keys may occur several times, on several ranks or nowhere; ranks may have or want none."""
    rng = np.random.default_rng(11 + WORLD.rank)
    rank, last = WORLD.rank, WORLD.size - 1
    known = rng.integers(-1, 2, (0 if rank == last and last else 40, 3))
    values = rng.normal(size=(len(known), 2))
    wanted = rng.integers(-1, 3, (0 if rank == 0 and last else 30, 3))
    number, found = find(WORLD, known, values, wanted)
    every = {}
    for keys, of_keys in WORLD.allgather((known, values)):
        for key, value in zip(keys, of_keys, strict=True):
            every.setdefault(tuple(key), []).append(tuple(value))
    for i, key in enumerate(wanted):
        assert sorted(map(tuple, found[number == i])) == sorted(every.get(tuple(key), []))


@pytest.mark.parallel
def test_each_file_of_a_checkpoint_is_read_once(tmp_path_factory, monkeypatch):
    """Each of the files of five ranks is read by one of the ranks of this run."""
    folder = WORLD.bcast(tmp_path_factory.mktemp("files"), root=0) / "state"
    if WORLD.rank == 0:
        folder.mkdir()
        (folder / "checkpoint.json").write_text('{"ranks": 5, "values": {}, "of": {}}')
        for rank in range(5):
            key = np.array([[rank, 1], [rank, 2]])
            np.savez(folder / f"{rank}.npz", **{"p/keys": key, "p/values": 1.0 * key})
    WORLD.barrier()
    opened, load = [], np.load
    monkeypatch.setattr(np, "load", lambda path: opened.append(path.stem) or load(path))
    wanted = np.array([[4, 2], [0, 1], [7, 7]]) if WORLD.rank == 0 else np.array([[2, 1]])
    keys, values = Checkpoint(WORLD, folder).points("p").find(wanted)
    assert np.array_equal(keys, 1.0 * values) and np.array_equal(
        values[:, 1] > 0, [True] * len(keys)
    )
    assert {tuple(k) for k in keys} == {tuple(k) for k in wanted} - {(7, 7)}
    every = [name for of_rank in WORLD.allgather(opened) for name in of_rank]
    assert sorted(every) == ["0", "1", "2", "3", "4"]
    assert Checkpoint(WORLD, folder).points("q") is None
