"""Case 1: stiff or soft bodies and penalties, nearly incompressible bodies, and other units."""

from hard.bodies import Column, Punch, Wrong, solve
from hard.cases import SHORT, Case
from scenes import largest

NAME, PRESSURE = "1 stiffness", 1e-3
RATIOS = (1.0, 1e4, 1e8, 1e-4, 1e-8)
FACTORS = (1e-2, 1.0, 1e2, 1e4, 1e6, 1e8)
#: Units: name and number per metre; E is 210 GPa in newtons per unit².
UNITS = {"mm": 1e3, "µm": 1e6}


def column(variant, **options):
    """Return the error of pressure and displacement of the upper end; the overlay is exact."""
    scene = Column(variant, **variant.exact_gaps, **options)
    pressure = PRESSURE * min(1.0, scene.ratio)
    scene.press(pressure)
    solve(scene.problem())
    error = scene.error(pressure)
    if variant.quadrature == "overlay":
        down = largest(scene.upper.u.x.array)
        error = max(error, abs(down / (pressure * scene.compliance()) - 1))
    return error


def in_units(variant, name):
    """Compare the punch in metres and in another unit."""
    metres, other = (Punch(variant, unit, 210e9) for unit in (1.0, UNITS[name]))
    count, iterations = (solve(scene.problem()) for scene in (metres, other))
    if iterations != count:
        raise Wrong(f"{count} Newton iterations in metres, {iterations} in {name}")
    first, second = metres.state(), other.state()
    error = largest(*(a - b for a, b in zip(first[:2], second[:2], strict=True)))
    return max(error / largest(*first[:2]), largest(first[2] - second[2]) / largest(first[2]))


def cases(variant):
    what = "traction, shortening" if variant.quadrature == "overlay" else "force"
    short = variant in SHORT
    # The allowed error grows with the condition number times the rounding unit.
    for ratio in RATIOS:
        yield Case(
            NAME,
            f"E of the slave / master {ratio:.0e}",
            what,
            max(1e-8, 1e-14 * ratio),
            lambda r=ratio: column(variant, ratio=r),
            short and ratio in (1e-8, 1e8),
            most=10,  # the residual cannot fall below rounding: Newton's method must stop there
        )
    for factor in FACTORS:
        yield Case(
            NAME,
            f"penalty {factor:.0e} E/h",
            what,
            max(1e-7, 1e-14 * factor),
            lambda f=factor: column(variant, penalty=5 * f),
            short and factor in (1e-2, 1e8),
        )
    yield Case(NAME, "nu = 0.4999", what, 1e-8, lambda: column(variant, nu=0.4999), short)
    for name in UNITS:
        label, what = f"{name} against metres", "displacements, force"
        yield Case(NAME, label, what, 1e-8, lambda n=name: in_units(variant, n), short)
