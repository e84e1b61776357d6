"""What bench/speed_report.py says of the numbers: sentences, with whatever they show put in."""

import numpy as np
from speed_cases import Kind
from speed_front import FLOOR, NEAR, USELESS, faults, standings
from speed_tables import comparisons, name, number, ratio_table, ratios

PRESENT = Kind("quasi-symmetric", "nodal", "penalty")
OVERLAY = Kind("quasi-symmetric", "overlay", "penalty")
AUGMENTED = Kind("quasi-symmetric", "overlay", "augmented-lagrangian")
MASTER_SLAVE = Kind("master-slave", "overlay", "penalty")
#: Error, in that of the overlay, with which the nodal rule is called enough.
ENOUGH = 1.5


def listed(texts, none="none"):
    """Words with commas."""
    return ", ".join(texts) or none


def verdict(results, kind, among=None):
    """Whether a kind is on the front or near it everywhere, and where it is not."""
    found = [(title, standings(r, m, among)[kind]) for r, m, title in comparisons(results)]
    everywhere = far_from([(title, at.distance) for title, at in found])
    best = far_from([(title, at.at_best) for title, at in found])
    answer = "no" if everywhere else "yes"
    return (
        f"**{name(kind)}: {answer}**, "
        f"in {len(found) - len(everywhere)} of {len(found)} comparisons on all levels"
        f"{', not in ' + listed(everywhere) if everywhere else ''}; "
        f"in {len(found) - len(best)} on its most accurate level alone"
        f"{', not in ' + listed(best) if best else ''}."
    )


def far_from(distances):
    """Comparisons in which a kind is not near the front, with how far it is."""
    return [
        f"{title} ({f'{value:.2f}' if np.isfinite(value) else 'no solution'})"
        for title, value in distances
        if value > NEAR
    ]


def ranking(results, among, mean):
    """Kinds with a mean of their distances from the front of these; the best first."""
    found = {}
    for result, measure, _ in comparisons(results):
        for kind, at in standings(result, measure, among).items():
            found.setdefault(kind, []).append(at.distance)
    return sorted((mean(values), kind) for kind, values in found.items())


def choice(results, usable):
    """What to take: lines of Markdown."""
    if not usable:
        return ["- No kind of contact is usable in every case."]
    lines = [
        f"- **What to take of the {len(usable)} kinds that are usable in all cases**, by their "
        "distance from these kinds' front, the best first:"
    ]
    for text, mean in (
        ("geometric mean of the comparisons", lambda values: np.exp(np.mean(np.log(values)))),
        ("worst comparison", max),
    ):
        ranks = ranking(results, usable, mean)
        near = [f"**{name(k)}** ({v:.2f})" for v, k in ranks if v <= NEAR * ranks[0][0]]
        rest = [f"{name(k)} ({v:.2f})" for v, k in ranks[len(near) :]]
        equal = ", equal within 10 %" if len(near) > 1 else ""
        lines.append(f"  - {text}: {listed(near)}{equal}; then {listed(rest)}.")
    return lines


def never_near(results):
    """Kinds that are neither on the front nor near it in any comparison."""
    best = {}
    for result, measure, _ in comparisons(results):
        for kind, at in standings(result, measure).items():
            best[kind] = best.get(kind, False) or at.on_front > 0 or at.distance <= NEAR
    return [kind for kind, near in best.items() if not near]


def nodal_enough(results):
    """Where the nodal rule will do."""
    enough, not_enough = [], []
    for title, (error, time) in ratios(results, PRESENT, OVERLAY).items():
        shown = f"{error:.1f}" if error < 1e3 else number(error)
        text = f"{title} ({shown} times the error in {time:.2f} times the time)"
        (enough if error <= ENOUGH else not_enough).append(text)
    return (
        f"- **When nodal quasi-symmetric contact is enough**, with at most {ENOUGH} times the "
        f"error of the overlay, both with a penalty on the finest level: "
        f"{listed(enough, 'in none of the cases')}. When not: {listed(not_enough)}."
    )


def gains(results, kind, other, what):
    """Where one kind is at least 10 % more accurate than another one, and where less."""
    found = ratios(results, kind, other)
    times = [time for _, time in found.values()]
    better = [f"{t} ({1 / e:.1f} times)" for t, (e, _) in found.items() if e * NEAR < 1]
    worse = [f"{t} ({e:.1f} times)" for t, (e, _) in found.items() if e > NEAR]
    return (
        f"- **{what}** ({name(kind)} against {name(other)}, finest level): less error in "
        f"{listed(better, 'none of the cases')}; more in {listed(worse, 'none of the cases')}. "
        f"It takes {min(times):.2f} to {max(times):.2f} times the time."
    )


def words(results):
    """The answer: lines of Markdown."""
    said = faults(results)
    usable = [kind for kind, reasons in said.items() if not reasons]
    lines = [
        *choice(results, usable),
        "- **On the front of all 16 kinds, or within 10 % of it, for the worse of the two sides?**",
        *(f"  - {verdict(results, kind)}" for kind in (AUGMENTED, OVERLAY, MASTER_SLAVE, PRESENT)),
    ]
    among = [kind for kind in (AUGMENTED, OVERLAY, MASTER_SLAVE, PRESENT) if kind in usable]
    if among:
        lines += ["- **The same among the kinds that are usable in all cases?**"]
        lines += [f"  - {verdict(results, kind, usable)}" for kind in among]
    lines += [
        gains(results, AUGMENTED, OVERLAY, "What the augmented Lagrangian buys"),
        gains(results, OVERLAY, MASTER_SLAVE, "What the second side buys on the overlay"),
        nodal_enough(results),
        "- **Dominated everywhere** by more than 10 %, without a point on any front: "
        f"{listed(map(name, never_near(results)))}.",
        "- **Not usable in some case**, for lack of a solution or for an error above "
        f"{100 * USELESS:.0f} % on the finest level:",
    ]
    return lines + [f"  - {name(k)}: {'; '.join(r)}" for k, r in said.items() if r]


def pairs(results):
    """Table of the ratios that the words speak of."""
    columns = {
        "QS overlay: AL against penalty": (AUGMENTED, OVERLAY),
        "overlay, penalty: QS against master-slave": (OVERLAY, MASTER_SLAVE),
        "QS, penalty: nodal against overlay": (PRESENT, OVERLAY),
    }
    return ratio_table(results, columns)


def floor_note():
    """On exact results."""
    return f"Errors below {number(FLOOR)}, to which multipliers are augmented, count as exact."
