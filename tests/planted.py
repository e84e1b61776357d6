#!/usr/bin/env python3
"""Plant faults of one line in a copy of the repository, and check that the tests detect them.

    python3 tests/planted.py                    all of planted_faults.py; prints a table in Markdown
    python3 tests/planted.py --only tie silence some of them, by words of their names
    python3 tests/planted.py --clean            the same tests without a fault: they have to pass
    python3 tests/planted.py --tests ELSEWHERE  the tests of another repository, such as fewer ones

Each fault has a few tests that are expected to detect it. They run as ``make test`` runs them, with
the markers and the shares of each number of ranks that it uses, so that a fault is detected here if
``make test`` detects it. If these tests do not detect the fault, or if none of them is in a share,
all tests of their files run. With ``--whole``, a fault that is still not detected is tried with all
tests of their files, of their folders and then with all tests; with ``--try`` only with the tests
named there.

A fault is an error if its line is missing or if the changed sources do not build. A time-out is an
error, too, unless the fault is declared as one with which ranks wait for each other. The copy and
its build stay in the folder for temporary files, so that the next run builds only what has changed.
Nothing is changed in the repository from which this is started.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import hashlib
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import typing

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from planted_faults import FAULTS, Fault  # noqa: E402

#: Numbers of ranks that `make test` uses.
RANKS = (1, 2, 3)

#: Exit codes of pytest if no test has run: no such function, or all were deselected.
NO_SUCH_TEST, NO_TESTS = 4, 5

#: A line of pytest about a failed test.
FAILED = re.compile(r"^(tests/\S+?\.py\S*?(?:\[.*\])?) (?:FAILED|ERROR)\b", re.MULTILINE)


class StaleError(Exception):
    """The line of a fault is missing, or occurs more than once."""


class BuildError(Exception):
    """The package cannot be built."""


class Outcome(typing.NamedTuple):
    """Result of one run of tests.

    Attributes:
        failed: The first test that failed; what happened instead if that test is not known; None if
            all passed.
        ran: Whether any test has run.
        in_time: Whether the run ended before the limit.
        text: Printed output.
    """

    failed: str | None
    ran: bool
    in_time: bool
    text: str


class Result(typing.NamedTuple):
    """Result of one fault.

    Attributes:
        fault: The fault.
        noticed: Whether a test failed.
        by: Name of that test, or what happened.
        seconds: Duration of the test runs.
        error: Whether the fault could not be tested: it is stale, or the tests did not end.
    """

    fault: Fault
    noticed: bool
    by: str
    seconds: float
    error: bool = False


class Copy:
    """Copy of the tracked files of a repository, and its build.

    Args:
        repo: Repository to be copied.
        tests: Repository from which the tests are taken.
        timeout: Time limit of one run of tests (seconds).
    """

    def __init__(self, repo: pathlib.Path, tests: pathlib.Path, timeout: float) -> None:
        self._timeout = timeout
        mark = hashlib.sha256(str(HERE.parent).encode()).hexdigest()[:8]
        self.folder = pathlib.Path(tempfile.gettempdir()) / f"qsdolfinx-planted-{mark}"
        self._site = self.folder.with_name(self.folder.name + "-site")
        self.folder.mkdir(exist_ok=True)
        self._lock = (self.folder.with_name(self.folder.name + ".lock")).open("w")
        fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        files = {name: repo for name in tracked(repo) if not name.startswith("tests/")}
        files |= {name: tests for name in tracked(tests) if name.startswith("tests/")}
        for path in sorted(self.folder.rglob("*"), reverse=True):
            if path.is_file() and str(path.relative_to(self.folder)) not in files:
                path.unlink()
        for name, root in files.items():
            there = self.folder / name
            there.parent.mkdir(parents=True, exist_ok=True)
            if not there.exists() or there.read_bytes() != (root / name).read_bytes():
                shutil.copy(root / name, there)
        dealt = "--share" in (self.folder / "tests/conftest.py").read_text()
        self._share = ["--share"] if dealt else []
        shutil.rmtree(self._site, ignore_errors=True)
        # Faults in Python are planted in this copy of the build, without building again.
        shutil.copytree(self._build(), self._site)

    def _build(self) -> pathlib.Path:
        """Build the package from the unchanged sources; return its folder."""
        ask = "import pathlib, qsdolfinx; print(pathlib.Path(qsdolfinx.__file__).parents[1])"
        command = ["scripts/with-dolfinx", "python3", "-c", ask]
        done = subprocess.run(command, cwd=self.folder, capture_output=True, text=True)
        if done.returncode:
            raise BuildError(done.stderr[-2000:])
        return pathlib.Path(done.stdout.strip().splitlines()[-1])

    @contextlib.contextmanager
    def planted(self, fault: Fault | None) -> typing.Iterator[pathlib.Path]:
        """Return the folder of the package with a fault, or without one."""
        if fault is None:
            yield self._site
            return
        source = self.folder / fault.file
        text = source.read_text() if source.exists() else ""
        if text.count(fault.old) != 1:
            raise StaleError(f"{fault.file} has {text.count(fault.old)} times {fault.old!r}")
        is_python = fault.file.startswith("qsdolfinx/")
        files = [self._site / fault.file, source] if is_python else [source]
        try:
            for file in files:
                file.write_text(text.replace(fault.old, fault.new))
            yield self._site if is_python else self._build()
        finally:
            for file in files:
                file.write_text(text)

    def test(
        self, site: pathlib.Path, tests: typing.Sequence[str], ranks: int, first: bool, limit: float
    ) -> Outcome:
        """Run tests.

        Args:
            site: Folder of the package.
            tests: Files, folders or functions; all if there are none.
            ranks: Number of MPI ranks.
            first: Whether to stop at the first failed test.
            limit: Seconds after which the run is stopped.
        """
        run = [] if ranks == 1 else ["mpirun", "-n", str(ranks)]
        pytest = ["python3", "-m", "pytest", "-v", "--tb=short", "-p", "no:cacheprovider", *tests]
        pytest += self._share
        command = ["scripts/with-dolfinx", "env", f"PYTHONPATH={site}", *run, *pytest]
        with tempfile.TemporaryFile("w+", errors="replace") as out:
            process = subprocess.Popen(
                [*command, "-x"] if first else command,
                cwd=self.folder,
                env=os.environ | {"QSDOLFINX_NO_BUILD": "1", "PYTHONDONTWRITEBYTECODE": "1"},
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            try:
                code: int | None = process.wait(limit)
            except subprocess.TimeoutExpired:
                code = None
            finally:
                stop(process)
            out.seek(0)
            text = out.read()
        failed = FAILED.search(text)
        if failed:
            return Outcome(failed[1].removeprefix("tests/"), True, code is not None, text)
        if code is None:
            return Outcome(None, True, False, text)
        if code in (NO_SUCH_TEST, NO_TESTS):
            return Outcome(None, False, True, text)
        return Outcome(None if code == 0 else f"(ends with code {code})", True, True, text)

    def find(self, fault: Fault, whole: bool) -> tuple[str | None, str]:
        """Return the test that detects a fault, and a remark.

        Raises:
            StaleError: If the line of the fault is missing.
            BuildError: If the package with the fault cannot be built.
            TimeoutError: If the tests do not end, and the fault is not declared to cause this.
        """
        with self.planted(fault) as site:
            for ranks, tests, said in self._stages(fault, whole):
                limit = self._timeout if said == "" else 20 * self._timeout
                outcome = self.test(site, tests, ranks, True, limit)
                if not outcome.in_time and outcome.failed is None:
                    if fault.hangs:
                        return "(hang)", said
                    raise TimeoutError(f"no end within {limit:.0f} s: {outcome.text[-300:]}")
                if outcome.failed is not None:
                    return outcome.failed, said + (f" on {ranks}" if ranks > 1 else "")
        return None, ""

    def _stages(
        self, fault: Fault, whole: bool
    ) -> typing.Iterator[tuple[int, typing.Sequence[str], str]]:
        """Yield ranks and tests to try one after the other, and a remark about them."""
        order = sorted(RANKS, key=lambda ranks: (ranks != fault.ranks, ranks))
        order = order if self._share else [fault.ranks]
        for ranks in order:
            yield ranks, fault.tests, ""
        names = dict.fromkeys(test.partition("::")[0] for test in fault.tests)
        files = [name for name in names if (self.folder / name).exists()]
        if files:
            for ranks in order:
                yield ranks, files, "in the file"
        if whole:
            folders = [name for name in dict.fromkeys(name.rpartition("/")[0] for name in names)
                       if (self.folder / name).exists() and name != "tests"]  # fmt: skip
            if folders:
                yield fault.ranks, folders, "in the folder"
            for ranks in RANKS:
                yield ranks, (), f"in all tests of {ranks}"


def tracked(repo: pathlib.Path) -> list[str]:
    """Return the files of a repository that are tracked by git and exist."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=repo, capture_output=True, check=True)
    names = listed.stdout.decode().split("\0")
    return [name for name in names if name and (repo / name).is_file()]


def stop(process: subprocess.Popen[bytes]) -> None:
    """End a process and all processes that it has started."""
    for how in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, how)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(10)
            return


def try_out(copy: Copy, fault: Fault, whole: bool) -> Result:
    """Plant one fault and run its tests."""
    start = time.monotonic()

    def result(noticed: bool, by: str, error: bool = False) -> Result:
        return Result(fault, noticed, by, time.monotonic() - start, error)

    try:
        by, where = copy.find(fault, whole)
    except StaleError as error:
        return result(False, f"STALE: {error}", True)
    except BuildError:
        return result(False, "DOES NOT BUILD", True)
    except TimeoutError as error:
        return result(False, f"TIME-OUT: {error}", True)
    if by is None:
        return result(False, "**not noticed**")
    return result(True, f"`{by}`" + (f" {where}" if where else ""))


def check_clean(copy: Copy, faults: typing.Sequence[Fault], timeout: float) -> int:
    """Run the tests of all faults without any fault, once for each number of ranks."""
    bad = 0
    for ranks in RANKS:
        tests = list(dict.fromkeys(t for f in faults for t in f.tests))
        # A file includes its functions.
        tests = [t for t in tests if "::" not in t or t.partition("::")[0] not in tests]
        if not tests:
            continue
        start = time.monotonic()
        with copy.planted(None) as site:
            outcome = copy.test(site, tests, ranks, False, 20 * timeout)
        good = outcome.failed is None and outcome.ran and outcome.in_time
        lines = [line for line in outcome.text.splitlines() if line.strip()]
        told = " ".join(
            line.strip("= ") for line in lines if " passed" in line or " failed" in line
        )
        print(f"{ranks} ranks: {told or 'no end'}, {time.monotonic() - start:.0f} s", flush=True)
        if not good:
            bad += 1
            print("\n".join(lines[-40:]))
    return bad


def row(result: Result) -> str:
    """Return a line of the table."""
    fault = result.fault
    cells = fault.name, f"`{fault.file}`", fault.what, str(fault.ranks), result.by
    return "| " + " | ".join((*cells, f"{result.seconds:.0f}")) + " |"


def main() -> int:
    """Parse the arguments, and run the faults that they select."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--list", action="store_true", help="only print the faults")
    parser.add_argument("--only", nargs="+", metavar="WORDS", help="words in names of faults")
    parser.add_argument("--clean", action="store_true", help="run the tests without a fault")
    parser.add_argument("--whole", action="store_true", help="try all tests on missed faults")
    parser.add_argument("--repo", type=pathlib.Path, default=HERE.parent, help="to plant faults in")
    parser.add_argument("--tests", type=pathlib.Path, help="repository with other tests")
    parser.add_argument("--try", nargs="+", metavar="TESTS", dest="others", help="only these tests")
    parser.add_argument("--timeout", type=float, default=300, help="seconds for a few tests (300)")
    given = parser.parse_args()
    words = given.only or [""]
    faults = [fault for fault in FAULTS if any(word in fault.name for word in words)]
    if not faults:
        parser.error(f"--only: no fault has {' or '.join(words)} in its name")
    if given.others:
        faults = [fault._replace(tests=tuple(given.others)) for fault in faults]
    if given.list:
        for fault in faults:
            print(f"{fault.name}: {fault.file}: {fault.what}\n    - {fault.old.strip()}")
            print(f"    + {fault.new.strip()}\n    {fault.ranks} ranks: {', '.join(fault.tests)}")
        return 0
    repo = given.repo.resolve()
    try:
        copy = Copy(repo, (given.tests or repo).resolve(), given.timeout)
    except BlockingIOError:
        parser.error("another run uses the copy")
    except BuildError as error:
        parser.error(f"cannot be built: {error}")
    if given.clean:
        return check_clean(copy, faults, given.timeout)
    print("| fault | file | what is wrong | ranks | noticed by | s |")
    print("|---|---|---|---|---|---|", flush=True)
    results = []
    for fault in faults:
        results.append(try_out(copy, fault, given.whole))
        print(row(results[-1]), flush=True)
    noticed, errors = (sum(getattr(r, a) for r in results) for a in ("noticed", "error"))
    print(f"\n{noticed} of {len(results)} noticed, {errors} could not be tested.")
    return 0 if noticed == len(results) else 1


if __name__ == "__main__":
    sys.exit(main())
