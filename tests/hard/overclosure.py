"""Case 6: surfaces with an initial penetration, or some elements apart."""

import warnings

import numpy as np
from hard.bodies import NU, Column, Wrong, iterations, solve
from hard.cases import SHORT, Case, Variant
from scenes import largest

import qsdolfinx as qs

#: Gaps in facets of the finer side.
H = 0.2
DEPTHS = (1e-6, 1e-2, 0.5, 1.0)
GAPS = (0.5, 3.0, 8.0)


def uniform(scene, shortening):
    """Return the error of the force of two linear blocks with a total shortening."""
    return abs(scene.contact.force("slave")[1] * scene.compliance() / shortening - 1)


def overclosed(variant, depth, **options):
    # Nodal quadrature has matching meshes here, so that the force is known.
    n = (5, 4) if variant.quadrature == "overlay" else (5, 5)
    return Column(variant, n=n, gap=-depth * H, **options)


def resolved(variant, depth):
    """An interference fit: the ends stay fixed, and the blocks share the overclosure."""
    scene = overclosed(variant, depth)
    scene.push(0.0)
    solve(scene.problem())
    if abs(scene.contact.model.overclosure.depth / (depth * H) - 1) > 1e-8:
        raise Wrong(f"a depth of {scene.contact.model.overclosure.depth}")
    return uniform(scene, depth * H)


def ignored(variant, depth):
    """No stress at first, then that of the load alone, also after the contact pairs are updated."""
    scene = overclosed(variant, depth, initial_overclosure="ignore")
    height = scene.push(0.0)
    p = scene.problem()
    solve(p)
    errors = [largest(*(u.x.array for u in p.u)) / (depth * H)]
    height.value = -1e-2
    solve(p)
    errors.append(uniform(scene, 1e-2))
    scene.contact.update()  # which keeps the adjustment
    solve(p)
    return max(*errors, uniform(scene, 1e-2))


def refused(variant, depth):
    overclosed(variant, depth, initial_overclosure="error")
    return 0.0


def touching(variant):
    """Penetrations at rounding level are not refused."""
    scene = overclosed(variant, 1e-7, initial_overclosure="error")
    scene.push(-1e-3)
    solve(scene.problem())
    return uniform(scene, 1e-3 + 1e-7 * H)


def shrunk(variant):
    """Large strains, an overclosure of an element, shrunk on in five solves or in one."""
    found = []
    for parts in ((0.8, 0.6, 0.4, 0.2, 0.0), (0.0,)):
        scene = overclosed(variant, 1.0, large=True)
        scene.push(0.0)
        p = scene.problem()
        for part in parts:
            scene.contact.allow_overclosure(part)
            solve(p)
        found.append(scene.contact.force("slave")[1])
    return max(abs(found[0] / found[1] - 1), abs(found[0] / stretched(scene) - 1))


def stretched(scene):
    """Return the pressure of two neo-Hookean blocks, in uniaxial strain, that share the depth."""
    mu, lmbda = 1 / 2 / (1 + NU), NU / (1 + NU) / (1 - 2 * NU)
    low, high = 0.8, 1.0
    for _ in range(80):
        s = 0.5 * (low + high)  # stretch of each block
        stress = -(mu * (s - 1 / s) + lmbda * np.log(s) / s)
        gap = 0.0 if scene.variant.augmented else stress / scene.contact.penalty
        if 2 * (1 - s) + gap > H:
            low = s
        else:
            high = s
    return stress


def closed(variant, gap):
    """A gap of some facets, within the search radius."""
    scene = overclosed(variant, -gap, search_radius=1.1 * gap * H)
    scene.push(-gap * H - 1e-2)
    solve(scene.problem())
    return uniform(scene, 1e-2)


def out_of_reach(variant):
    """A gap beyond the search radius, which the upper block closes."""
    scene = overclosed(variant, -3.0)
    scene.push(-3.0 * H - 1e-2)
    with warnings.catch_warnings():
        warnings.simplefilter("error", qs.ReachWarning)
        try:
            solve(scene.problem())
        except qs.ReachWarning as warning:
            raise RuntimeError(f"warned: {warning}") from warning
    return uniform(scene, 1e-2)


def stepped(variant):
    """The same in time steps, which update the contact pairs: the gap comes within the radius."""
    scene = overclosed(variant, -3.0)
    height = scene.push(0.0)

    def drive(t, dt):
        height.value = -t * (3.0 * H + 1e-2)

    stepper = qs.TimeStepper(scene.problem(), 0.1, drive)
    for _ in stepper.run(1.0):
        iterations.append(stepper.num_iterations)
    return uniform(scene, 1e-2)


def cases(variant):
    def case(label, what, allowed, run, *given, short=False, refusal=""):
        name = "6 overclosure and gaps"
        return Case(
            name, label, what, allowed, lambda: run(variant, *given), short, refusal=refusal
        )

    for depth in DEPTHS:
        label, short = f"overclosed by {depth:g} h", depth == 0.5
        bound = max(1e-6, 1e-8 / depth)
        yield case(f"{label}, resolve", "force", bound, resolved, depth, short=short)
        yield case(f"{label}, ignore", "strain, force", 1e-8, ignored, depth, short=short)
        if depth > 1e-5:
            refusal = "initial_overclosure: the surfaces penetrate"
            yield case(f"{label}, error", "", 0.0, refused, depth, refusal=refusal)
    yield case("overclosed by 1e-7 h, error", "force", 1e-6, touching)
    label, short = "an element, shrunk on, large strains", variant in (SHORT[0], SHORT[2])
    yield case(label, "force", 1e-6, shrunk, short=short)
    reached = variant in (Variant(), Variant("double-pass", "nodal"))
    for gap in GAPS:
        short = reached and gap == 3.0
        yield case(f"gap of {gap:g} h, in reach", "force", 1e-6, closed, gap, short=short)
    options = {"short": reached, "refusal": "search_radius"}
    yield case("gap of 3 h, out of reach", "", 0.0, out_of_reach, **options)
    yield case("gap of 3 h, in steps", "force", 1e-6, stepped, short=reached)
