#!/usr/bin/env python3
"""Change the numeric constants of the package, and check that the tests named for them fail.

    python3 tests/constants.py              all of constants_table.py
    python3 tests/constants.py --only WORDS some of them, by words in their files and names

Each changed value must be noticed: a case of a named test fails with it, which passes without it.
The tests run on one rank, each again with every change, in the same process
(changed_constants.py): nothing is built or copied, and no file is changed.
"""

from __future__ import annotations

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from constants_table import CHANGED, Changed  # noqa: E402


def run(file: str, wanted: list[Changed], timeout: float) -> tuple[list[list[object]], str]:
    """Run the tests of one file with all changes that they should notice.

    Returns:
        For each run the test, the constant (empty without a change), the index of the value and
        whether it failed; and the printed output.
    """
    with tempfile.TemporaryDirectory() as folder:
        results = pathlib.Path(folder) / "results"
        environment = {
            "QSDOLFINX_CHANGED_RESULTS": str(results),
            "QSDOLFINX_CHANGED": json.dumps([each.constant for each in wanted]),
        }
        pytest = ["python3", "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:warnings"]
        sites = f"PYTHONPATH={HERE}:" + os.environ.get("QSDOLFINX_SITE", "$PYTHONPATH")
        command = ["scripts/with-dolfinx", "sh", "-c", f'export {sites}; exec "$@"', "sh", *pytest]
        command += ["-p", "changed_constants", f"tests/{file}"]
        try:
            done = subprocess.run(
                command,
                cwd=HERE.parent,
                capture_output=True,
                text=True,
                timeout=timeout,
                env=os.environ | environment,
            )
            text = done.stdout + done.stderr
        except subprocess.TimeoutExpired:
            text = f"no end within {timeout:.0f} s"
        lines = results.read_text().splitlines() if results.exists() else []
        return [json.loads(line) for line in lines], text


def main() -> int:
    """Parse the arguments, and change the constants that they select."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--only", nargs="+", metavar="WORDS", help="words in files and names")
    parser.add_argument("--timeout", type=float, default=1800, help="seconds for a file (1800)")
    given = parser.parse_args()
    wanted = [each for each in CHANGED if any(w in each.constant for w in given.only or [""])]
    if not wanted:
        parser.error(f"--only: no constant has {' or '.join(given.only)} in its file and name")
    noticed: dict[tuple[str, int], str] = {}
    broken: list[str] = []
    missed = 0
    files = list(dict.fromkeys(t.partition("::")[0] for each in wanted for t in each.tests))
    print("| constant | changed to | noticed by |\n|---|---|---|", flush=True)
    for k, file in enumerate(files):
        here = [each for each in wanted if any(t.partition("::")[0] == file for t in each.tests)]
        results, text = run(file, here, given.timeout)
        for test, constant, value, failed in results:
            if failed and constant:
                noticed.setdefault((str(constant), int(str(value))), str(test))
            elif failed:
                broken.append(f"{test} fails without a change")
        if not results:
            broken.append(f"{file}: no test has run: {text[-1000:]}")
        for each in here:
            if all(t.partition("::")[0] in files[: k + 1] for t in each.tests):
                for i, value in enumerate(each.values):
                    by = noticed.get((each.constant, i))
                    missed += by is None
                    said = f"`{by}`" if by else "**not noticed**"
                    print(f"| `{each.constant}` | {value} | {said} |", flush=True)
    print("\n".join(["", *broken]))
    total = sum(len(each.values) for each in wanted)
    print(f"{total - missed} of {total} changes of {len(wanted)} constants noticed.")
    return 1 if missed or broken else 0


if __name__ == "__main__":
    sys.exit(main())
