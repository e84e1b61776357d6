"""scikit-build-core's build backend, which looks first for what the extension is built against.

DOLFINx, PETSc and MPI have to be those that qsdolfinx will run with, so that they cannot be had as
build requirements: where they are missing, this says what to install, in one line.
"""

import functools
import sys
from importlib.util import find_spec

from scikit_build_core import build

NEEDED = ("dolfinx", "petsc4py", "mpi4py", "nanobind")
MESSAGE = (
    "qsdolfinx is built against the DOLFINx of the environment, and this one has no {missing}: "
    "install DOLFINx 0.9 or later (Debian: apt install python3-dolfinx-real petsc-dev; "
    'conda: -c conda-forge fenics-dolfinx "petsc=*=real*"), nanobind and scikit-build-core, '
    "and then run pip install --no-build-isolation --no-deps, as isolated builds see none of them"
)


def with_dolfinx(hook):
    """The hook, or an end with the message."""

    @functools.wraps(hook)
    def checked(*args, **kwargs):
        if missing := [name for name in NEEDED if not find_spec(name)]:
            sys.exit(MESSAGE.format(missing=", ".join(missing)))
        return hook(*args, **kwargs)

    return checked


get_requires_for_build_sdist = build.get_requires_for_build_sdist
build_sdist = build.build_sdist
get_requires_for_build_wheel = with_dolfinx(build.get_requires_for_build_wheel)
prepare_metadata_for_build_wheel = with_dolfinx(build.prepare_metadata_for_build_wheel)
build_wheel = with_dolfinx(build.build_wheel)
get_requires_for_build_editable = with_dolfinx(build.get_requires_for_build_editable)
prepare_metadata_for_build_editable = with_dolfinx(build.prepare_metadata_for_build_editable)
build_editable = with_dolfinx(build.build_editable)
