"""Case 6: surfaces that penetrate each other at the start, or are some elements apart."""

import warnings

import numpy as np
from hard.bodies import NU, Column, Wrong, iterations, solve
from hard.cases import SHORT, Case, Variant
from scenes import largest

import qsdolfinx as qs

#: Facets of the finer side.
H = 0.2
DEPTHS = (1e-6, 1e-2, 0.5, 1.0)
GAPS = (0.5, 3.0, 8.0)


def uniform(scene, shortening):
    """Error of the force of two linear blocks that have to be shorter by this much together."""
    return abs(scene.contact.force("slave")[1] * scene.compliance() / shortening - 1)


def overclosed(variant, depth, **options):
    # Nodal rules have matching meshes here, since the force is to be known.
    n = (5, 4) if variant.quadrature == "overlay" else (5, 5)
    return Column(variant, n=n, gap=-depth * H, **options)


def resolved(variant, depth):
    """An interference fit: the ends stay where they are, and the blocks share the depth."""
    scene = overclosed(variant, depth)
    scene.push(0.0)
    solve(scene.problem())
    if abs(scene.contact.model.overclosure.depth / (depth * H) - 1) > 1e-8:
        raise Wrong(f"a depth of {scene.contact.model.overclosure.depth}")
    return uniform(scene, depth * H)


def ignored(variant, depth):
    """No stress at first, and then that of the load alone, also where contact pairs anew."""
    scene = overclosed(variant, depth, initial_overclosure="ignore")
    height = scene.push(0.0)
    p = scene.problem()
    solve(p)
    errors = [largest(*(u.x.array for u in p.u)) / (depth * H)]
    height.value = -1e-2
    solve(p)
    errors.append(uniform(scene, 1e-2))
    scene.contact.update()  # which has forgotten nothing
    solve(p)
    return max(*errors, uniform(scene, 1e-2))


def refused(variant, depth):
    overclosed(variant, depth, initial_overclosure="error")
    return 0.0


def touching(variant):
    """What only rounding has overclosed is not refused."""
    scene = overclosed(variant, 1e-7, initial_overclosure="error")
    scene.push(-1e-3)
    solve(scene.problem())
    return uniform(scene, 1e-3 + 1e-7 * H)


def shrunk(variant):
    """Large strains, overclosed by an element and shrunk on in five solves, or at once."""
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
    """Pressure at which two blocks of neo-Hooke's solid, in uniaxial strain, share the depth."""
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
    """A gap of some facets, with a search radius that reaches over it."""
    scene = overclosed(variant, -gap, search_radius=1.1 * gap * H)
    scene.push(-gap * H - 1e-2)
    solve(scene.problem())
    return uniform(scene, 1e-2)


def out_of_reach(variant):
    """A gap beyond the search radius, over which the upper block comes down."""
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
    """The same in time steps, which pair anew where the bodies are: the gap comes into reach."""
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
