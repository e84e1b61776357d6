"""Table and picture of the patch test, see patch_test.py."""

import numpy as np
from patch_test import STRESS, Parameters, normal_traction, run

PAPER = {  # load: mean and maximum error, in %
    "pressure": {"quasi-symmetric": (3.6, 8.3), "master-slave": (8.0, 22.0)},
    "displacement": {"quasi-symmetric": (4.8, 10.9), "master-slave": (10.0, 24.8)},
}
CONCLUSION = """\
The percentages need not be the paper's: its meshes are shown in a figure but not published, and
the error depends on where the nodes of one side lie on the facets of the other. What can be
compared is the ratio of the two formulations. Checked: in every row the mean and maximum errors of
quasi-symmetric contact are below those of master-slave contact; with overlay quadrature they are
those of the arithmetic."""
MESHES = (("tetrahedron", 4, 3), ("tetrahedron", 8, 3), ("hexahedron", 4, 3), ("hexahedron", 8, 3))


KINDS = {
    "quasi-symmetric": {"formulation": "quasi-symmetric"},
    "master-slave": {"formulation": "master-slave"},
    "overlay": {"formulation": "quasi-symmetric", "quadrature": "overlay"},
}


def table(comm):
    """Print cases 1 and 2 beside the paper's Table 1, and check that quasi-symmetric is better.

    Raises:
        AssertionError: If in any row an error with quasi-symmetric contact is not the smaller, or
            that with overlay quadrature is above 1e-9.
    """

    def say(line=""):
        if comm.rank == 0:
            print(line, flush=True)

    def errors(result, side):
        return 100 * result[f"{side}_mean_error"], 100 * result[f"{side}_max_error"]

    say("Error of the normal stress in the cells at the interface, mean / maximum in %")
    say("(master × slave cells along an edge)")
    say()
    head = "".join(f"{kind:>22}" for kind in ("quasi-symmetric", "master-slave"))
    say(f"{'case':34}{head}{'ratio':>14}{'overlay':>20}")
    for case, (load, paper) in enumerate(PAPER.items(), start=1):
        qs_errors, ms_errors = paper["quasi-symmetric"], paper["master-slave"]
        say_row(say, f"{case}. {load}: the paper's meshes", qs_errors, ms_errors)
        for cell, n_master, n_slave in MESHES:
            results = [
                run(Parameters(n_master, n_slave, cell, load=load, **kind), comm)[0]
                for kind in KINDS.values()
            ]
            for side in ("slave", "master"):
                quasi, ms, exact = (errors(result, side) for result in results)
                say_row(say, f"   {cell} {n_master} × {n_slave}, {side}", quasi, ms, exact)
                assert all(q < m for q, m in zip(quasi, ms, strict=True)), (
                    "quasi-symmetric is not better"
                )
                assert max(exact) < 1e-7, "overlay is not exact"
    say()
    say(CONCLUSION)


def say_row(say, name, qs_errors, ms_errors, exact=None):
    """Print one row of the table."""
    columns = [f"{mean:9.3f} /{maximum:8.3f}" for mean, maximum in (qs_errors, ms_errors)]
    ratios = [q / m for q, m in zip(qs_errors, ms_errors, strict=True)]
    last = "" if exact is None else f"{exact[0]:10.0e} /{exact[1]:7.0e}"
    say(f"{name:34}{columns[0]:>22}{columns[1]:>22}{ratios[0]:8.2f} /{ratios[1]:5.2f}{last:>20}")


# --- Picture


def plot(comm, filename, cell="tetrahedron", n_master=8, n_slave=3):
    """Draw the contact traction that both sides receive, with both formulations."""
    panels = []
    for name in ("master-slave", "quasi-symmetric", "overlay"):
        _, contact = run(Parameters(n_master, n_slave, cell, **KINDS[name]), comm)
        for side in ("slave", "master"):
            x = (contact.slave if side == "slave" else contact.master).node_x
            values = np.abs(normal_traction(contact, side, np.array([0.0, 0.0, 1.0])) / STRESS)
            parts = comm.gather((x, values))  # small, and for the picture only
            if comm.rank == 0:
                panels.append(
                    (name, side, *(np.concatenate(part) for part in zip(*parts, strict=True)))
                )
    if comm.rank > 0:
        return
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, 2, figsize=(8.6, 11.2), layout="constrained")
    for axis, (name, side, x, values) in zip(axes.flat, panels, strict=True):
        n = n_slave if side == "slave" else n_master
        order = np.lexsort((x[:, 0], x[:, 1]))
        grid = values[order].reshape(n + 1, n + 1)
        ticks = np.linspace(0, 1, n + 1)
        image = axis.pcolormesh(
            ticks, ticks, grid, shading="gouraud", cmap="RdBu_r", vmin=0, vmax=2
        )
        axis.plot(*np.meshgrid(ticks, ticks), ".", color="black", markersize=3)
        worst = 100 * np.max(np.abs(values - 1))
        text = f"{worst:.0f}" if worst > 1 else f"{worst:.0e}"
        axis.set_title(f"{name}, {side} side, {n} × {n}\nlargest error {text} %", fontsize=10)
        axis.set_aspect("equal")
    label = "contact traction / applied pressure (exact: 1; cut off at 2)"
    figure.colorbar(image, ax=axes, label=label, shrink=0.8)
    figure.savefig(filename, dpi=120)
    print(f"\n{filename}: contact traction on both sides")
