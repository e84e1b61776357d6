"""Messages and warnings that reach the user, with nothing set up before there are any."""

from __future__ import annotations

import contextlib
import contextvars
import inspect
import logging
import os
import pathlib
import sys
import typing
import warnings

from mpi4py import MPI

logger = logging.getLogger("qsdolfinx")

#: Time step that is being made, in words.
_when: contextvars.ContextVar[str] = contextvars.ContextVar("when", default="")

#: Where the package is.
_PACKAGE = str(pathlib.Path(__file__).parents[1]) + os.sep


class ContactWarning(UserWarning):
    """A contact probably does not do what is intended; the text says what to change."""


def say(comm: MPI.Intracomm, text: str) -> None:
    """Log a message (INFO) on rank 0; print it as long as logging has no handlers."""
    if comm.rank > 0 or logger.level > logging.INFO:
        return
    if not logger.hasHandlers():
        print(f"qsdolfinx: {text}", file=sys.stdout, flush=True)
        return
    # Whatever the level of the loggers above: who is silent by a level says so to this one.
    logger.handle(logger.makeRecord(logger.name, logging.INFO, __file__, 0, text, (), None))


@contextlib.contextmanager
def during(when: str) -> typing.Iterator[None]:
    """Let warnings inside the block say when they came, such as ``"step 3, t = 0.2"``."""
    token = _when.set(when)
    try:
        yield
    finally:
        _when.reset(token)


def warn(text: str, kind: type[ContactWarning]) -> None:
    """Warn, on all ranks: whoever turns warnings into errors gets one everywhere.

    The warning points to the line that has called the package, however deep it was found.

    Args:
        text: What is wrong and what to do.
        kind: Class of the warning.
    """
    when = _when.get()
    with _shown():
        warnings.warn(f"{when}: {text}" if when else text, kind, stacklevel=_level())


def _level() -> int:
    """Stack level, seen from whoever calls this, of the line that has called the package."""
    level, frame = 0, inspect.currentframe()
    while frame is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        level, frame = level + 1, frame.f_back
    return level


def renamed(old: str, new: str, given: typing.Any, other: typing.Any) -> typing.Any:
    """An argument by its name of before, with a warning; or the other, if that is None.

    Args:
        old: Name of before.
        new: Name now.
        given: Value by the old name, None for none.
        other: Value by the new one, None for none.

    Raises:
        ValueError: If both are given.
    """
    if given is None:
        return other
    if other is not None:
        raise ValueError(f"{old}, {new}: are the same; give {new} alone")
    warnings.warn(f"{old}= is {new}= now", DeprecationWarning, stacklevel=_level())
    return given


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


@contextlib.contextmanager
def _shown() -> typing.Iterator[None]:
    """Show warnings: FFCx, which DOLFINx imports, hands them to logging, where nothing shows them.

    Our handler is there for the warning alone.
    """
    python, handler = logging.getLogger("py.warnings"), _Terminal()
    python.addHandler(handler)
    try:
        yield
    finally:
        python.removeHandler(handler)
