"""Run a job through CalculiX: write its input, run ccx, read its output.

Surface-to-surface penalty contact, linear pressure-overclosure; C3D8, fully integrated. Only ccx is
measured, not the writing of its input.

    python3 bench/peers/calculix.py --sizes 22,18 --ccx ccx --linear "ITERATIVE CHOLESKY"
"""

import argparse
import os
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile
import time

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import jobs


def lines(rows):
    return "\n".join(", ".join(map(str, row)) for row in rows)


def write_body(out, name, body, first_node, first_cell):
    """Nodes, cells, contact face and held nodes of a body; A is the lower body."""
    numbers = np.arange(len(body.x)) + first_node
    out.write("*NODE, NSET=ALL\n")
    # ccx reads at most 20 characters of a number.
    np.savetxt(out, np.column_stack([numbers, body.x]), fmt="%d, %.13g, %.13g, %.13g")
    cells = np.column_stack([np.arange(len(body.cells)) + first_cell, body.cells])
    cells[:, 1:] += first_node
    out.write(f"*ELEMENT, TYPE=C3D8, ELSET={name}\n")
    np.savetxt(out, cells, fmt="%d", delimiter=", ")
    held = body.low if name == "A" else body.high
    for kind, quads in [("HELD", held), *((f"PLANE{k}", q) for k, q in body.planes.items())]:
        nodes = np.unique(quads) + first_node
        out.write(f"*NSET, NSET={kind}{name}\n{lines(nodes[:, None])}\n")
    # Faces S1 and S2 have the first and the last four nodes.
    touching, side = (body.high_cells, "S2") if name == "A" else (body.low_cells, "S1")
    out.write(f"*SURFACE, NAME=FACE{name}, TYPE=ELEMENT\n")
    out.write(f"{lines([(c + first_cell, side) for c in touching])}\n")


def write_deck(path, job, sizes, penalty, linear, slave, output=False):
    """Write the input file; the bodies are named A, below, and B.

    Args:
        path: Path of the file.
        job: Module of the job.
        sizes: Numbers of cells along an edge of A and B.
        penalty: Stress per length.
        linear: Name of the linear solver, with its options.
        slave: Name of the slave.
        output: Whether displacements are printed.
    """
    bodies = job.bodies(sizes)
    printed = "*NODE PRINT, NSET=ALL\nU\n" if output else ""
    first_node, first_cell = 1, 1
    with open(path, "w") as out:
        for name, body, modulus in zip("AB", bodies, job.E, strict=True):
            write_body(out, name, body, first_node, first_cell)
            out.write(f"*MATERIAL, NAME=M{name}\n*ELASTIC\n{modulus}, {job.NU}\n")
            out.write(f"*SOLID SECTION, ELSET={name}, MATERIAL=M{name}\n")
            first_node += len(body.x)
            first_cell += len(body.cells)
        master = "B" if slave == "A" else "A"
        planes = [(f"PLANE{k}{name}", k + 1) for name in "AB" for k in bodies[0].planes]
        held = [("HELDA", 1, 3), ("HELDB", 1, 2), *((name, k, k) for name, k in planes)]
        out.write(f"""*SURFACE INTERACTION, NAME=I
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR
{penalty:.17g}
*CONTACT PAIR, INTERACTION=I, TYPE=SURFACE TO SURFACE
FACE{slave}, FACE{master}
*BOUNDARY
{lines(held)}
*STEP, INC=100
*STATIC, SOLVER={linear}
1., 1.
*BOUNDARY
HELDB, 3, 3, {job.PRESS}
*NODE PRINT, NSET=HELDA, TOTALS=ONLY
RF
{printed}*END STEP
""")


def read_displacements(text):
    """Return the displacements of all nodes in the last output of ccx, or None."""
    blocks = text.split("displacements (vx,vy,vz)")[1:]
    if not blocks:
        return None
    rows = re.findall(r"^ *(\d+)((?: +-?\d\.\d+E[+-]\d+){3}) *$", blocks[-1], re.M)
    return [[float(value) for value in values.split()] for _, values in rows]


def run(command, folder):
    """Run ccx on job.inp; return its output, user + system seconds, wall seconds, peak MiB."""
    environment = {"OMP_NUM_THREADS": "1"} | dict(os.environ)
    start = time.perf_counter()
    with open(folder / "log", "w") as log:
        process = subprocess.Popen(
            [*shlex.split(command), "-i", "job"],
            cwd=folder,
            stdout=log,
            stderr=subprocess.STDOUT,
            env=environment,
        )
        _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    wall = time.perf_counter() - start
    text = (folder / "log").read_text(errors="replace")
    if process.returncode != 0 or "Job finished" not in text:
        errors = [line.strip() for line in text.split("\n") if "ERROR" in line]
        raise SystemExit(errors[-1] if errors else f"ccx ended with {process.returncode}")
    return text, usage.ru_utime + usage.ru_stime, wall, usage.ru_maxrss / 1024


def main():
    parser = argparse.ArgumentParser()
    jobs.add_arguments(parser)
    parser.add_argument("--ccx", default="ccx")
    parser.add_argument("--linear", default="ITERATIVE CHOLESKY")
    parser.add_argument("--factor", type=float, default=10.0, help="penalty over E/h")
    parser.add_argument("--slave", choices=("lower", "upper"), default="upper")
    p = jobs.parse(parser)
    penalty = jobs.penalty(p.job, p.sizes, p.factor)
    slave = "BA"[p.slave == "lower"]
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        deck = p.job, p.sizes, penalty, p.linear, slave, bool(p.output)
        write_deck(folder / "job.inp", *deck)
        text, cpu, wall, peak = run(p.ccx, folder)
        printed = (folder / "job.dat").read_text()
    total = re.findall(r"^((?: +-?\d\.\d+E[+-]\d+){3}) *$", printed, re.M)
    version = re.search(r"Version ([\w.]+)", text)
    jobs.report(
        p.output,
        read_displacements(printed),
        force=float(total[-1].split()[2]),
        newton=len(re.findall(r"^ *iteration +\d+ *$", text, re.M)),
        krylov=sum(int(n) for n in re.findall(r"# of iterations = *(\d+)", text)),
        cpu=cpu,
        wall=wall,
        peak=peak,
        version=version and version.group(1),
    )


if __name__ == "__main__":
    main()
