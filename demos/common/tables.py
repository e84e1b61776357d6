"""Print the tables of the demos; the table of the patch test is in patch_table.py."""

import numpy as np

from common.command import FORMULATIONS, print_rows, say


def block_on_block(rows):
    """Print the states of the dragged block."""
    print_rows(
        rows,
        shift=("shift", ".4f"),
        ratio=("T / μN", ".6f"),
        stick=("sticks", ".1%"),
        slip=("slips", ".1%"),
        energy=("energy taken", ".6e"),
        iterations=("iterations", ""),
    )


def sliding_wedge(rows, exact, ratio_error):
    """Print the states of the pushed wedge, and the expected F / G."""
    print_rows(
        rows,
        shift=("shift", ".4f"),
        ratio=("F / G", ".8f"),
        contact_ratio=("of contact", ".8f"),
        active=("nodes closed", ""),
        slipping=("slipping", ""),
        iterations=("iterations", ""),
    )
    say(f"closed form {exact:.8f}, ratio_error {ratio_error:.2e}")


def ring_compression(results):
    """Print the change of the inner diameter (%) over reduction, as in Male & Cockcroft's figure.

    Args:
        results: Result and history for each friction factor.
    """
    highest = max(history[-1]["reduction"] for _, history, *_ in results.values())
    reductions = np.arange(0.1, highest + 1e-9, 0.1)
    rows = []
    for factor, (result, history, *_) in results.items():
        known = [[row[key] for row in history] for key in ("reduction", "inner_radius")]
        changes = 100 * (np.interp(reductions, *known) - 1)
        row = {f"{r:.0%}": change for r, change in zip(reductions, changes, strict=True)}
        share = history[-1]["friction"] / history[-1]["work"]
        row |= {"m_bar": factor, "force": result["force"] / 1e3, "share": share}
        rows.append(history[-1] | result | row)
    print_rows(
        rows,
        m_bar=("m_bar", ".2f"),
        **{f"{r:.0%}": (f"{r:.0%}", ".2f") for r in reductions},
        force=("force (kN)", ".1f"),
        share=("friction/work", ".3f"),
        energy_error=("energy error", ".1e"),
        snes_iterations=("iterations", ""),
    )


def cattaneo_mindlin(scene, P, Q, R, stick_radius, centre):
    """Return the results of partial slip and their errors. Collective.

    Args:
        scene: Bodies, contact and closed form.
        P: Normal load.
        Q: Tangential load.
        R: Height above the contact at which P and Q act.
        stick_radius: Half the width of the stick zone.
        centre: Centre of the stick zone.
    """
    contact, exact, out = scene.contact, scene.exact, {}
    for side in scene.bodies:
        force = contact.force(side)
        out[f"P error, {side}"] = abs(force[1]) / P - 1
        out[f"Q error, {side}"] = abs(force[0]) / Q - 1
        out[f"moment / (Q R), {side}"] = contact.moment(side, (0.0, 0.0))[0] / (Q * R)
    length = contact.patch()[0]
    nodes = contact.comm.allreduce(int(np.count_nonzero(contact.active())))
    facet = length / max(nodes, 1)
    return out | {
        "facet of the slave": facet,
        "stick radius": stick_radius,
        "stick radius error, facets": (stick_radius - exact.c) / facet,
        "centre of the stick zone": centre,
        "contact radius error": length / 2 / exact.a - 1,
        "penalty": contact.penalty,
        "dofs": sum(b.V.dofmap.index_map.size_global * 2 for b in scene.bodies.values()),
    }


def upsetting_convergence(result, ratios, norms):
    """Print errors on the last level, and rates, for these ratios and norms."""
    last = result["levels"] - 1
    levels = f"level {last} and rates fitted over {result['levels']} levels"
    say(f"Relative errors on {levels}, as error / rate\n")

    def row(ratio, kind, *keys):
        texts = [f"{result[f'error_{k}_{last}']:.2e} /{result[f'rate_{k}']:5.2f}" for k in keys]
        columns = dict.fromkeys(norms, "") | dict(zip(norms, texts, strict=False))
        return {"ratio": ratio, "kind": kind} | columns

    rows = [row("", "single body", "energy_single")]
    rows += [
        row(ratio, f, *(f"{norm}_{f}_{ratio}" for norm in norms))
        for ratio in ratios
        for f in FORMULATIONS
    ]
    heads = {norm: (norm.replace("_", " "), "") for norm in norms}
    print_rows(rows, ratio=("master:slave", ""), kind=("formulation", ""), **heads)


def check_upsetting(result, ratios):
    """Check that convergence is as expected, and print the conclusions.

    Raises:
        AssertionError: If formulations differ on matching meshes, if the error there is not the
            error of the single body, or if quasi-symmetric contact does not have the smaller error
            in the energy norm on non-matching meshes. At 1:4 tying every slave node makes the
            displacement continuous.
    """
    for level in range(result["levels"]):
        single = result[f"error_energy_single_{level}"]
        for ratio in ratios:
            ms, quasi = (
                result[f"error_energy_{f}_{ratio}_{level}"]
                for f in ("master-slave", "quasi-symmetric")
            )
            if ratio == "1:1":
                assert abs(ms / single - 1) < 1e-2 and abs(quasi / ms - 1) < 1e-6, (ratio, level)
            elif ratio != "1:4":
                assert quasi < ms, (ratio, level)
    say(
        "\nChecked: on matching meshes the formulations agree to 1e-6 and with the single body to"
        "\n1 %; on 2:3, 3:2 and 4:1 quasi-symmetric contact has the smaller error in the energy "
        "norm."
    )
