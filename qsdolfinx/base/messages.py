"""Messages and warnings for the user; nothing is set up before the first one."""

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

#: Description of the present time step.
_when: contextvars.ContextVar[str] = contextvars.ContextVar("when", default="")

#: Folder of the package.
_PACKAGE = str(pathlib.Path(__file__).parents[1]) + os.sep


class ContactWarning(UserWarning):
    """A contact probably does not do what is intended; the text says what to change."""


def say(comm: MPI.Intracomm, text: str) -> None:
    """Log a message (INFO) on rank 0; print it if logging has no handlers."""
    if comm.rank > 0 or logger.level > logging.INFO:
        return
    if not logger.hasHandlers():
        print(f"qsdolfinx: {text}", file=sys.stdout, flush=True)
        return
    # The levels of parent loggers are ignored: to suppress messages, set the level of this logger.
    logger.handle(logger.makeRecord(logger.name, logging.INFO, __file__, 0, text, (), None))


@contextlib.contextmanager
def during(when: str) -> typing.Iterator[None]:
    """Add the time to warnings inside the block, such as ``"step 3, t = 0.2"``."""
    token = _when.set(when)
    try:
        yield
    finally:
        _when.reset(token)


def warn(text: str, kind: type[ContactWarning]) -> None:
    """Warn on all ranks: if warnings are turned into errors, all ranks raise one.

    The warning refers to the line that has called the package, whatever the depth of the call.

    Args:
        text: Problem and remedy.
        kind: Class of the warning.
    """
    when = _when.get()
    with _shown():
        warnings.warn(f"{when}: {text}" if when else text, kind, stacklevel=_level())


def _level() -> int:
    """Stack level, relative to the caller, of the line that has called the package."""
    level, frame = 0, inspect.currentframe()
    while frame is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        level, frame = level + 1, frame.f_back
    return level


def renamed(old: str, new: str, given: typing.Any, other: typing.Any) -> typing.Any:
    """Value of a renamed argument: by the old name with a warning, else by the new name.

    Args:
        old: Old name.
        new: New name.
        given: Value by the old name, None if not given.
        other: Value by the new name, None if not given.

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
    """Print warnings of the package that logging has captured and no other handler shows."""

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
    """Show warnings: FFCx, imported by DOLFINx, redirects them to logging, where none is shown.

    The handler is installed for the warning only.
    """
    python, handler = logging.getLogger("py.warnings"), _Terminal()
    python.addHandler(handler)
    try:
        yield
    finally:
        python.removeHandler(handler)
