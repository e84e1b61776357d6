"""Progress bars, with tqdm if it is installed."""

from __future__ import annotations

import contextlib
import typing

from mpi4py import MPI


def bar(t_end: float, start: float = 0.0) -> typing.Any:
    """Progress bar over time; None without tqdm."""
    try:
        import tqdm
    except ImportError:
        return None
    form = "{l_bar}{bar}| t = {n:.4g} of {total:.4g}"
    return tqdm.tqdm(total=t_end, initial=start, unit="t", bar_format=form)


@contextlib.contextmanager
def progress(
    comm: MPI.Intracomm, wanted: bool, start: float, t_end: float
) -> typing.Iterator[typing.Callable[[float], None]]:
    """Function to be called with the time after each step; it updates a bar on rank 0 if wanted."""
    shown = bar(t_end, start) if wanted and comm.rank == 0 else None
    try:
        yield lambda t: None if shown is None else shown.update(t - shown.n)
    finally:
        if shown is not None:
            shown.close()
