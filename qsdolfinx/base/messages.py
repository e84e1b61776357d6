"""Messages and warnings that reach the user, with nothing set up before there are any."""

from __future__ import annotations

import inspect
import logging
import os
import pathlib
import sys
import warnings

from mpi4py import MPI

logger = logging.getLogger("qsdolfinx")

#: Where the package is.
_PACKAGE = str(pathlib.Path(__file__).parents[1]) + os.sep


class ContactWarning(UserWarning):
    """A contact will hardly do what is meant; the text says what to change."""


def say(comm: MPI.Intracomm, text: str) -> None:
    """Log a message (INFO) on rank 0; print it as long as logging has no handlers."""
    if comm.rank > 0 or logger.level > logging.INFO:
        return
    if not logger.hasHandlers():
        print(f"qsdolfinx: {text}", file=sys.stdout, flush=True)
        return
    if logger.level == logging.NOTSET:
        logger.setLevel(logging.INFO)
    logger.info(text)


def warn(text: str, kind: type[ContactWarning]) -> None:
    """Warn, on all ranks: whoever turns warnings into errors gets one everywhere.

    The warning points to the line that has called the package, however deep it was found.

    Args:
        text: What is wrong and what to do.
        kind: Class of the warning.
    """
    _show_warnings()
    level, frame = 1, inspect.currentframe()
    while frame is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        level, frame = level + 1, frame.f_back
    warnings.warn(text, kind, stacklevel=level)


class _Terminal(logging.Handler):
    """Prints our warnings where logging has captured them and no other handler shows them."""

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        others = [*logging.getLogger("py.warnings").handlers, *logging.getLogger().handlers]
        if any(not isinstance(o, (logging.NullHandler, _Terminal)) for o in others):
            return
        ours = (ContactWarning, *ContactWarning.__subclasses__())
        if MPI.COMM_WORLD.rank == 0 and any(f": {w.__name__}: " in text for w in ours):
            print(text.rstrip(), file=sys.stderr, flush=True)


def _show_warnings() -> None:
    """Make sure that warnings are shown: FFCx, which DOLFINx imports, hands them to logging.

    The only handler there is one that shows nothing.
    """
    python = logging.getLogger("py.warnings")
    if not any(isinstance(handler, _Terminal) for handler in python.handlers):
        python.addHandler(_Terminal())
