"""Install the other programs into a separate folder; the system is not changed.

Kratos and NGSolve come from the Python package index, into a virtual environment. CalculiX and
GetFEM come from Debian: their packages and all dependencies are unpacked, and start with the C
library of these packages. asimov-contact comes from its repository, compiled with the DOLFINx of
the Python that runs this script. To install one program:

    python3 bench/peers/install.py getfem --install FOLDER
"""

import argparse
import os
import pathlib
import re
import shutil
import subprocess
import sys

PACKAGES = {
    "kratos": [
        "KratosMultiphysics",
        "KratosContactStructuralMechanicsApplication",
        "KratosLinearSolversApplication",
    ],
    "ngsolve": ["ngsolve"],
}
MODULES = {
    "kratos": "KratosMultiphysics.ContactStructuralMechanicsApplication",
    "ngsolve": "ngsolve",
}

#: Source of asimov-contact, for DOLFINx 0.9.
ASIMOV = "https://github.com/Wells-Group/asimov-contact", "v0.9.0"

#: Debian's releases; the newest one with the package is used, but the system's own is tried first.
SUITES = "trixie", "bookworm", "bullseye"
OTHER_NAMES = "stable", "testing", "unstable", "sid", "forky"

KEYRINGS = [f"/usr/share/keyrings/debian-archive-keyring.{end}" for end in ("pgp", "gpg")]


class Missing(Exception):
    """A program is not available; the text says why."""


def run(*command, **kwargs):
    """Return the output of a command.

    Raises:
        Missing: If the command fails, with the last line of its output.
    """
    try:
        done = subprocess.run(
            [str(c) for c in command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
            **kwargs,
        )
    except OSError as error:
        raise Missing(f"{command[0]}: {error.strerror}") from error
    if done.returncode != 0:
        errors = [line for line in done.stdout.split("\n") if line.strip()] or ["no output"]
        told = [line for line in errors if "error" in line.lower() or line.startswith("E:")]
        raise Missing(f"{pathlib.Path(str(command[0])).name}: {(told or errors)[-1].strip()}")
    return done.stdout


def environment():
    """Return an environment independent of our own Python; one thread."""
    names = "PYTHONPATH", "PYTHONHOME", "PYTHONSAFEPATH", "PYTHONDONTWRITEBYTECODE"
    kept = {name: value for name, value in os.environ.items() if name not in names}
    return kept | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def python_peer(name, folder, python):
    """Return an interpreter that can import Kratos or NGSolve.

    Args:
        name: ``"kratos"`` or ``"ngsolve"``.
        folder: Folder to install it into if it is not there, or None.
        python: Interpreter for making the virtual environment, or, without a folder, for direct
            use.
    """
    interpreter = pathlib.Path(folder, name, "bin", "python") if folder else python
    check = interpreter, "-c", f"import {MODULES[name]}"
    if not folder:
        run(*check, env=environment())
        return interpreter
    try:
        run(*check, env=environment())
    except Missing:
        # Debian's Python cannot put pip into a virtual environment: its own pip installs into it.
        run(python, "-m", "venv", "--clear", "--without-pip", pathlib.Path(folder, name))
        pip = python, "-m", "pip", "--python", interpreter, "install", "--quiet"
        run(*pip, "--only-binary", ":all:", "--disable-pip-version-check", *PACKAGES[name])
        run(*check, env=environment())
    return interpreter


def calculix(folder):
    """Return a command that starts ccx: unpacked into the folder if given, otherwise on PATH."""
    script = from_debian(folder, "calculix", "ccx", "calculix-ccx", write_script)
    check_ccx(script)
    return str(script)


def getfem(folder, python):
    """Return an interpreter that can import GetFEM: Debian's, unpacked into the folder if given.

    Args:
        folder: Folder to unpack it into if it is not there, or None.
        python: Interpreter for direct use, without a folder.
    """
    script = python
    if folder:
        script = from_debian(folder, "getfem", "python", "python3-getfem", write_python)
    run(script, "-c", "import getfem", env=environment())
    return str(script)


def from_debian(folder, name, command, package, write):
    """Return a script that starts a program of Debian; unpack the program if it is not there yet.

    Args:
        folder: Folder of all programs, or None for the command on PATH.
        name: Name of the program's folder in it.
        command: Name of the script.
        package: Debian's package.
        write: Called with the script's path to write it.
    """
    if not folder:
        return command
    script = pathlib.Path(folder, name, command)
    if not script.exists():
        reasons = []
        keys = [k for k in KEYRINGS if pathlib.Path(k).exists()]
        signed = f"[signed-by={keys[0]}] " if keys else ""
        for suite, uri in sources():
            try:
                unpack(script.parent, f"deb {signed}{uri} {suite} main\n", package)
                break
            except Missing as reason:
                reasons.append(f"{suite}: {reason}")
        else:
            raise Missing("; ".join(reasons) or "no Debian package source in apt's settings")
        write(script)
    return script


def check_ccx(command):
    """Raise Missing if the program does not start; its version option ends with an error."""
    said = run("sh", "-c", '"$1" -v 2>&1 || true', "sh", command)
    if "Version" not in said:
        raise Missing(said.strip().split("\n")[-1])


def sources():
    """Return releases of Debian to try, the system's own first: name, and address for apt."""
    found = {}
    for line in run("apt-get", "--print-uris", "-o", "Debug::NoLocking=true", "update").split("\n"):
        match = re.match("'(.+)/dists/([^/]+)/InRelease'", line)
        if match and match[2] in (*SUITES, *OTHER_NAMES):
            found.setdefault(match[2], match[1])
    own = list(found)
    return [
        (suite, found.get(suite, found[own[0]])) for suite in dict.fromkeys((*own, *SUITES)) if own
    ]


def unpack(folder, source, package):
    """Download and unpack a package with all its dependencies, with a separate apt state."""
    apt = folder.absolute() / "apt"
    for name in ("lists/partial", "archives/partial", "parts"):
        (apt / name).mkdir(parents=True, exist_ok=True)
    (apt / "status").write_text("")  # as if nothing were installed
    (apt / "sources.list").write_text(source)
    settings = {
        "Dir::State": apt,
        "Dir::State::lists": apt / "lists",
        "Dir::State::status": apt / "status",
        "Dir::Cache": apt,
        "Dir::Etc::sourcelist": apt / "sources.list",
        "Dir::Etc::sourceparts": apt / "parts",
        "APT::Sandbox::User": "root",
        "APT::Get::AllowUnauthenticated": "false",
    }
    options = [item for key, value in settings.items() for item in ("-o", f"{key}={value}")]
    run("apt-get", *options, "update")
    wanted = "--download-only", "--no-install-recommends", "install", package
    run("apt-get", *options, "--yes", *wanted)
    for archive in sorted((apt / "archives").glob("*.deb")):
        run("dpkg-deb", "--extract", archive, folder / "root")


def write_script(script):
    """Write a script that starts ccx with the unpacked libraries."""
    write_start(script, "usr/bin/ccx*")


def write_python(script):
    """Write a script that starts Python with the unpacked libraries and its own modules."""
    home = script.parent.absolute() / "root" / "usr"
    write_start(
        script, "usr/bin/python3.[0-9][0-9]", f'export PYTHONHOME="{home}" PYTHONNOUSERSITE=1\n'
    )


def write_start(script, pattern, before=""):
    """Write a script that starts an unpacked program with the C library that came with it.

    Args:
        script: Path of the script; the packages are in the folder ``root`` beside it.
        pattern: Pattern of the program's path.
        before: Lines of the script before the start of the program.
    """
    root = script.parent.absolute() / "root"
    loaders = [p for p in root.glob("**/ld-linux*.so.*") if p.is_file() and not p.is_symlink()]
    binaries = list(root.glob(pattern))
    if not loaders or not binaries:
        raise Missing(f"the packages have no C library or no {pattern}")
    folders = {p.parent for p in root.glob("**/lib*.so.*")}
    path = ":".join(str(p) for p in sorted(folders, key=lambda p: len(p.parts)))
    script.write_text(
        f'#!/bin/sh\n{before}exec "{loaders[0]}" --library-path "{path}" "{binaries[0]}" "$@"\n'
    )
    script.chmod(0o755)


def asimov(folder, source):
    """Return the folder of asimov-contact's Python package; None if Python has it already.

    Args:
        folder: Folder to compile it in if it is not there, or None.
        source: Folder of its source, or None to clone it.
    """
    path = pathlib.Path(folder, "asimov", "python").absolute() if folder else None
    check = sys.executable, "-c", "import dolfinx_contact"
    if not folder:
        run(*check)
        return None
    try:
        run(*check, env=with_path(path))
    except Missing:
        compile_asimov(path, source)
        run(*check, env=with_path(path))
    return path


def with_path(path):
    """Return our own environment, with a folder of Python packages if one is given; one thread."""
    paths = [str(path or ""), os.environ.get("PYTHONPATH", "")]
    found = {"PYTHONPATH": os.pathsep.join(p for p in paths if p), "OMP_NUM_THREADS": "1"}
    kept = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    return kept | found


def compile_asimov(path, source):
    """Compile the library and its Python package; the package is put beside the library."""
    root = path.parent
    run(sys.executable, "-c", "import dolfinx")
    shutil.rmtree(root, ignore_errors=True)
    if not source:
        source = root / "source"
        clone = "git", "clone", "--depth", "1", "--branch", ASIMOV[1], ASIMOV[0]
        try:
            run(*clone, source)
        except Missing as reason:
            raise Missing(f"{reason} ({' '.join(clone)}, then --asimov-source)") from reason
    source, build = pathlib.Path(source), root / "build"
    release = f"-DCMAKE_INSTALL_PREFIX={root}", "-DCMAKE_BUILD_TYPE=Release"
    run("cmake", "-S", source / "cpp", "-B", build, *release)
    cores = str(len(os.sched_getaffinity(0)))
    run("cmake", "--build", build, "--target", "install", "--parallel", cores)
    found = f"-Ccmake.define.DOLFINX_CONTACT_DIR={root / 'share' / 'dolfinx_contact'}"
    pip = sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"
    run(*pip, "--no-build-isolation", "--no-deps", "--target", path, found, source / "python")
    shutil.rmtree(build)


def prepare(names, folder, python, say, source=None):
    """Return what starts each program, or the reason why it is missing.

    A program is started by a command prefix; for asimov-contact the value is a folder of Python's
    path.

    Args:
        names: Names of the programs.
        folder: Folder of the installed programs; with None the system's programs are used.
        python: Interpreter for Kratos and NGSolve, or None for the one that runs this script.
        say: Function that reports the progress.
        source: Folder of asimov-contact's source, or None to clone it.
    """
    python = python or sys.executable
    found = {}
    for name in names:
        say(f"looking for {name}")
        try:
            if name == "calculix":
                found[name] = calculix(folder)
            elif name == "getfem":
                found[name] = getfem(folder, python)
            elif name == "asimov":
                found[name] = asimov(folder, source)
            else:
                found[name] = python_peer(name, folder, python)
        except Missing as reason:
            found[name] = reason
    return found


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = *PACKAGES, "calculix", "getfem", "asimov"
    parser.add_argument("names", nargs="+", choices=names, metavar="NAME", help=", ".join(names))
    parser.add_argument("--install", metavar="FOLDER", help="folder for missing programs")
    parser.add_argument("--python", help="interpreter for Kratos and NGSolve")
    p = parser.parse_args()
    for name, how in prepare(p.names, p.install, p.python, print).items():
        print(f"{name}: {f'missing: {how}' if isinstance(how, Missing) else how}")


if __name__ == "__main__":
    main()
