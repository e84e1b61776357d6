"""The picture of demos/upsetting_convergence.py."""

from plotting import pyplot, save
from upsetting_convergence import CELLS, FORMULATIONS, NORMS

STYLES = dict(zip(FORMULATIONS, ("s-", "^-", "o-"), strict=True))
COLOURS = dict(zip(CELLS, ("black", "tab:blue", "tab:cyan", "tab:green", "tab:red"), strict=True))
LABELS = {
    "energy": "energy norm",
    "slave_traction": "traction of the slave",
    "master_traction": "traction of the master",
}


def plot(result, filename):
    """All errors over h, of what run() returns."""
    figure, axes = pyplot().subplots(
        3, 3, figsize=(10, 9.6), sharex=True, sharey="row", layout="constrained"
    )
    for row, norm in zip(axes, NORMS, strict=True):
        for axis, formulation in zip(row, FORMULATIONS, strict=True):
            draw(axis, result, norm, formulation)
        row[0].set_ylabel(f"relative error, {LABELS[norm]} (-)")
        row[0].set_ylim(bottom=row[0].get_ylim()[0] / 12)  # room for the legends
    for axis, formulation in zip(axes[0], FORMULATIONS, strict=True):
        axis.set_title(formulation)
    for axis in axes[-1]:
        axis.set_xlabel("h of the coarser side / width (-)")
        ticks = [t for t in (0.01, 0.02, 0.05, 0.1, 0.2, 0.5) if inside(axis, t)]
        axis.set_xticks(ticks, [f"{t:g}" for t in ticks])
        axis.tick_params(which="minor", labelbottom=False)
    save(figure, filename)


def inside(axis, x):
    """Whether there is room for a tick."""
    low, high = axis.get_xlim()
    return low <= x <= high


def draw(axis, result, norm, formulation):
    """One norm of one formulation, for all ratios of the meshes."""
    levels = range(result["levels"])
    for ratio, colour in COLOURS.items():
        h = [result[f"h_{ratio}_{i}"] for i in levels]
        error = [result[f"error_{norm}_{formulation}_{ratio}_{i}"] for i in levels]
        rate = round(result[f"rate_{norm}_{formulation}_{ratio}"], 2) + 0.0  # no minus before 0
        label = f"{ratio}, rate {rate:.2f}"
        axis.loglog(h, error, STYLES[formulation], color=colour, label=label)
    axis.legend(fontsize=7, loc="lower right", title="master:slave", title_fontsize=7)
    axis.grid(which="both")
