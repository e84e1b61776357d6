"""Installs the other programs into a folder of their own; the system is left alone.

Kratos and NGSolve come from the Python package index, into a virtual environment; CalculiX and
GetFEM from Debian, their packages and all they depend on unpacked, and started by the C library
that came with them; asimov-contact from its repository, compiled with the DOLFINx of the Python
that runs this. What is needed by hand:

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

#: Debian's releases; the newest that has the package is taken, but first that of the system.
SUITES = "trixie", "bookworm", "bullseye"
OTHER_NAMES = "stable", "testing", "unstable", "sid", "forky"

KEYRINGS = [f"/usr/share/keyrings/debian-archive-keyring.{end}" for end in ("pgp", "gpg")]


class Missing(Exception):
    """A program is not there; the text says why."""


def run(*command, **kwargs):
    """Output of a command.

    Raises:
        Missing: If it fails, with the last line of what it said.
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
    """That of a program which has nothing to do with our own Python; one thread."""
    names = "PYTHONPATH", "PYTHONHOME", "PYTHONSAFEPATH", "PYTHONDONTWRITEBYTECODE"
    kept = {name: value for name, value in os.environ.items() if name not in names}
    return kept | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def python_peer(name, folder, python):
    """Interpreter that can import Kratos or NGSolve.

    Args:
        name: ``"kratos"`` or ``"ngsolve"``.
        folder: Where to install it if it is not there, or None.
        python: Interpreter to make the virtual environment of, or to use as it is without a folder.
    """
    interpreter = pathlib.Path(folder, name, "bin", "python") if folder else python
    check = interpreter, "-c", f"import {MODULES[name]}"
    if not folder:
        run(*check, env=environment())
        return interpreter
    try:
        run(*check, env=environment())
    except Missing:
        # Debian's Python cannot give a virtual environment a pip of its own: its pip fills it.
        run(python, "-m", "venv", "--clear", "--without-pip", pathlib.Path(folder, name))
        pip = python, "-m", "pip", "--python", interpreter, "install", "--quiet"
        run(*pip, "--only-binary", ":all:", "--disable-pip-version-check", *PACKAGES[name])
        run(*check, env=environment())
    return interpreter


def calculix(folder):
    """Command that starts ccx: unpacked into the folder if that is given, or else as on PATH."""
    script = from_debian(folder, "calculix", "ccx", "calculix-ccx", write_script)
    check_ccx(script)
    return str(script)


def getfem(folder, python):
    """Interpreter that can import GetFEM: Debian's, unpacked into the folder if that is given.

    Args:
        folder: Where to unpack it if it is not there, or None.
        python: Interpreter to use as it is without a folder.
    """
    script = python
    if folder:
        script = from_debian(folder, "getfem", "python", "python3-getfem", write_python)
    run(script, "-c", "import getfem", env=environment())
    return str(script)


def from_debian(folder, name, command, package, write):
    """Script that starts a program of Debian; unpacked into the folder where it is not there yet.

    Args:
        folder: Where programs are installed to, or None for the command as on PATH.
        name: Folder of the program in it.
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
    """Raises Missing if it does not start; asked for its version, it ends with an error."""
    said = run("sh", "-c", '"$1" -v 2>&1 || true', "sh", command)
    if "Version" not in said:
        raise Missing(said.strip().split("\n")[-1])


def sources():
    """Releases of Debian to try, the system's own first: name, and address as its apt has it."""
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
    """Download and unpack a package with all it depends on; with an apt state of its own."""
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
    """A script that starts ccx with the libraries that were unpacked beside it."""
    write_start(script, "usr/bin/ccx*")


def write_python(script):
    """The same for Python, which is told where its own modules are."""
    home = script.parent.absolute() / "root" / "usr"
    write_start(
        script, "usr/bin/python3.[0-9][0-9]", f'export PYTHONHOME="{home}" PYTHONNOUSERSITE=1\n'
    )


def write_start(script, pattern, before=""):
    """A script that starts an unpacked program by the C library that came with it.

    Args:
        script: Its path; the packages are in the folder ``root`` beside it.
        pattern: What the program's path matches.
        before: Lines of the script before that.
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
    """Folder of asimov-contact's Python package; None where Python has it already.

    Args:
        folder: Where to compile it if it is not there, or None.
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
    """Our own environment, with a folder of Python packages if one is given; one thread."""
    paths = [str(path or ""), os.environ.get("PYTHONPATH", "")]
    found = {"PYTHONPATH": os.pathsep.join(p for p in paths if p), "OMP_NUM_THREADS": "1"}
    kept = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    return kept | found


def compile_asimov(path, source):
    """Compile the library and its Python package, which is put there, beside the library."""
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
    """What starts each program, or the reason why it is missing.

    That is a command prefix, or a folder of Python's path for asimov-contact.

    Args:
        names: The programs.
        folder: Where they are, or are installed to; None takes what the system has.
        python: Interpreter for Kratos and NGSolve, or None for the one that runs this.
        say: Told what is looked for.
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
    parser.add_argument("--install", metavar="FOLDER", help="install here what is missing")
    parser.add_argument("--python", help="interpreter for Kratos and NGSolve")
    p = parser.parse_args()
    for name, how in prepare(p.names, p.install, p.python, print).items():
        print(f"{name}: {f'missing: {how}' if isinstance(how, Missing) else how}")


if __name__ == "__main__":
    main()
