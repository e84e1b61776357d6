"""Case 6: surfaces that penetrate each other at the start, or are some elements apart."""

import warnings

import numpy as np
from hard.scenes import Check, Column, Wrong, largest, solve

import qsdolfinx as qs

#: Facets of the finer side.
H = 0.2
DEPTHS = (1e-6, 1e-2, 0.5, 1.0)
GAPS = (0.5, 3.0, 8.0)


def uniform(scene, shortening):
    """Error of the state of two linear blocks that have to be shorter by this much together.

    The overlay has the traction at every node; at nodes the force is that of the patch test, and
    only the balance of a uniform state is known.
    """
    pressure = shortening / scene.compliance()
    return abs(scene.contact.force("slave")[1] / scene.L / pressure - 1)


def scene_of(variant, depth, **options):
    # Nodal rules have matching meshes here, since the force is to be known.
    n = (5, 4) if variant.quadrature == "overlay" else (5, 5)
    return Column(variant, n=n, gap=-depth * H, **options)


def resolved(variant, depth):
    """An interference fit: the ends stay where they are, and the blocks share the depth."""
    scene = scene_of(variant, depth)
    scene.push(0.0)
    iterations = solve(scene.problem())
    if abs(scene.contact.overclosure.depth / (depth * H) - 1) > 1e-8:
        raise Wrong(f"a depth of {scene.contact.overclosure.depth}")
    return uniform(scene, depth * H), iterations


def ignored(variant, depth):
    """No stress at first, and then that of the load alone, also where contact pairs anew."""
    scene = scene_of(variant, depth, initial_overclosure="ignore")
    height = scene.push(0.0)
    p = scene.problem()
    iterations = solve(p)
    free = max(largest(u.x.array) for u in p.u) / (depth * H)
    height.value = -1e-2
    error, count = [free], max(iterations, solve(p))
    error.append(uniform(scene, 1e-2))
    scene.contact.update()  # which has forgotten nothing
    count = max(count, solve(p))
    error.append(uniform(scene, 1e-2))
    return max(error), count


def refused(variant, depth):
    scene_of(variant, depth, initial_overclosure="error")
    return 0.0, 0


def touching(variant):
    """What only rounding has overclosed is not refused."""
    scene = scene_of(variant, 1e-7, initial_overclosure="error")
    scene.push(-1e-3)
    iterations = solve(scene.problem())
    return uniform(scene, 1e-3 + 1e-7 * H), iterations


def shrunk(variant):
    """Large strains, overclosed by an element and shrunk on in five solves, or at once."""
    found, iterations = [], 0
    for parts in ((0.8, 0.6, 0.4, 0.2, 0.0), (0.0,)):
        scene = scene_of(variant, 1.0, large=True)
        scene.push(0.0)
        p = scene.problem()
        for part in parts:
            scene.contact.allow_overclosure(part)
            iterations = max(iterations, solve(p))
        found.append(scene.contact.force("slave")[1])
    # Uniaxial strain: the stress of neo-Hooke's solid at a stretch of 0.9 and the compliance.
    return max(abs(found[0] / found[1] - 1), stretched(scene, found[0])), iterations


def stretched(scene, force):
    """Relative difference of a force and that at which both blocks have this depth in common."""
    mu, lmbda = 1 / 2.6, 0.3 / 0.52
    low, high = 0.8, 1.0
    for _ in range(80):
        s = 0.5 * (low + high)  # stretch of each block
        stress = -(mu * (s - 1 / s) + lmbda * np.log(s) / s)
        gap = 0.0 if scene.variant.augmented else stress / scene.contact.penalty
        if 2 * (1 - s) + gap > H:
            low = s
        else:
            high = s
    return abs(force / stress - 1)


def closed(variant, gap):
    """A gap of some facets, with a search radius that reaches over it."""
    scene = scene_of(variant, -gap, search_radius=1.1 * gap * H)
    scene.push(-gap * H - 1e-2)
    iterations = solve(scene.problem())
    return uniform(scene, 1e-2), iterations


def out_of_reach(variant):
    """A gap beyond the search radius, over which the upper block comes down."""
    scene = scene_of(variant, -3.0)
    scene.push(-3.0 * H - 1e-2)
    with warnings.catch_warnings():
        warnings.simplefilter("error", qs.ReachWarning)
        try:
            iterations = solve(scene.problem())
        except qs.ReachWarning as warning:
            raise RuntimeError(f"warned: {warning}") from warning
    return uniform(scene, 1e-2), iterations


def stepped(variant):
    """The same in time steps, which pair anew where the bodies are: the gap comes into reach."""
    scene = scene_of(variant, -3.0)
    height = scene.push(0.0)
    p = scene.problem()

    def drive(t, dt):
        height.value = -t * (3.0 * H + 1e-2)

    stepper = qs.TimeStepper(p, 0.1, drive)
    iterations = 0
    for _ in stepper.run(1.0):
        iterations = max(iterations, stepper.num_iterations)
    return uniform(scene, 1e-2), iterations


def checks(variant):
    case = "6 overclosure and gaps"
    for depth in DEPTHS:
        label = f"overclosed by {depth:g} h"
        yield Check(
            case,
            f"{label}, resolve",
            "force",
            max(1e-6, 1e-8 / depth),
            lambda d=depth: resolved(variant, d),
        )
        yield Check(
            case, f"{label}, ignore", "strain, force", 1e-8, lambda d=depth: ignored(variant, d)
        )
        if depth > 1e-5:
            text = "initial_overclosure: the surfaces penetrate"
            yield Check(case, f"{label}, error", "", 0.0, lambda d=depth: refused(variant, d), text)
    yield Check(case, "overclosed by 1e-7 h, error", "force", 1e-6, lambda: touching(variant))
    yield Check(
        case, "an element, shrunk on, large strains", "force", 1e-6, lambda: shrunk(variant)
    )
    for gap in GAPS:
        yield Check(
            case, f"gap of {gap:g} h, in reach", "force", 1e-6, lambda g=gap: closed(variant, g)
        )
    yield Check(
        case,
        "gap of 3 h, out of reach",
        "",
        0.0,
        lambda: out_of_reach(variant),
        "search_radius",
    )
    yield Check(case, "gap of 3 h, in steps", "force", 1e-6, lambda: stepped(variant))
