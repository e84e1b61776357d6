"""Random histories for the auditor: the number of a history defines it, on any number of ranks."""

import dataclasses
import typing

import numpy as np
from scenes import PARTITIONS

SEED = 21

#: Materials of velocity-based bodies.
FLOWS = ("viscous", "mini")


class Waypoint(typing.NamedTuple):
    """Position of the upper end, of a body or a tool, at a time.

    Attributes:
        down: Downward displacement, as a fraction of the depth.
        along: Sliding displacement, as a fraction of the slide.
        turned: Rotation, as a fraction of the turn.
        carried: Common rotation of everything, as a fraction of the carry.
        pushed: Force of a force-controlled tool, as a fraction of its largest force.
    """

    down: float = 0.0
    along: float = 0.0
    turned: float = 0.0
    carried: float = 0.0
    pushed: float = 1.0


@dataclasses.dataclass(frozen=True)
class History:
    """Random parameters of a history; lengths are multiples of ``L``.

    Attributes:
        number: Number of the history.
        gdim: Dimension of space.
        cells: Cell shapes of the lower and the upper body.
        n: Numbers of cells of the two along each axis.
        degree: Degree of the displacements.
        materials: ``"elastic"``, ``"neo"`` (neo-Hookean), ``"viscous"`` or ``"mini"`` (Norton-Hoff)
            for the lower and the upper body; for the upper body also the shape of a rigid tool.
        driven: Whether the tool is force-controlled.
        swapped: Whether the lower body is the slave.
        curvature: Curvature of the lower face of the upper body, or of the sphere, in units of 1 /
            L.
        wave: Height of waves on both faces.
        gap: Initial gap.
        depth: Downward displacement of the upper end beyond the gap.
        slide: Sliding distance of the upper end.
        turn: Angle of the rotation of the upper end, radians.
        carry: Angle of the common rotation of everything.
        axis: Axis of the rotation of the upper end.
        ratio: Modulus of the upper body over the modulus of the lower body.
        nu: Poisson's ratio of both.
        m: Rate sensitivity of Norton-Hoff bodies.
        words: Events, step by step.
        path: Waypoints, one for each unit of time, from t = 1 on.
        tied: Whether the bodies are tied.
        friction: ``""``, ``"coulomb"``, ``"tresca"`` or ``"norton"``.
        mu: Coefficient of Coulomb's law; for the other laws a fraction of the modulus.
        stiff: Penalty over modulus of the lower body / L; None for the automatic penalty.
        options: Options of the contact.
        stepping: Options of the stepper.
        solver: Name of the solver.
        refused: Step whose first attempt is made to fail; 0 for none.
        restarted: Unit of time after which the history is saved and continued; 0 for none.
        partitions: Partitions of the two meshes.
        E: Modulus of the lower body.
        L: Unit of length.
    """

    number: int
    gdim: int
    cells: tuple[str, str]
    n: tuple[tuple[int, ...], tuple[int, ...]]
    degree: int
    materials: tuple[str, str]
    driven: bool
    swapped: bool
    curvature: float
    wave: float
    gap: float
    depth: float
    slide: float
    turn: float
    carry: float
    axis: tuple[float, float, float]
    ratio: float
    nu: float
    m: float
    words: str
    path: tuple[Waypoint, ...]
    tied: bool
    friction: str
    mu: float
    stiff: float | None
    options: dict
    stepping: dict
    solver: str
    refused: int
    restarted: int
    partitions: tuple[str, str]
    E: float
    L: float

    @property
    def has_tool(self):
        return self.materials[1] in TOOLS

    @property
    def flows(self):
        """Whether each body is velocity-based."""
        return [m in FLOWS for m in self.materials[: 1 if self.has_tool else 2]]

    def __str__(self):
        upper = self.materials[1] if self.has_tool else f"{self.cells[1]} {self.n[1]}"
        o = self.options
        words = [f"{self.cells[0]} {self.n[0]}", upper, *self.materials]
        words += [o["formulation"], o["quadrature"], o.get("constraints", "nodes")]
        words += [o["enforcement"], f"P{self.degree}", self.solver, self.words, self.friction]
        for name in ("driven", "swapped", "tied"):
            words += [name] * getattr(self, name)
        for name in ("mu", "curvature", "wave", "gap", "depth", "slide", "turn", "carry", "ratio",
                     "nu", "stiff", "refused", "restarted", "E", "L"):  # fmt: skip
            value = getattr(self, name)
            words += [f"{name}={value:.3g}"] if value else []
        return ", ".join([word for word in words if word] + [str(self.stepping)])


TOOLS = ("plane", "sphere", "facets")


def random_history(number, units=False):
    """Make the history of a number; with unusual units or with units near 1."""
    rng = np.random.default_rng([SEED, number])
    gdim = int(rng.choice([2, 2, 3]))
    simplices, others = [("triangle", "quadrilateral"), ("tetrahedron", "hexahedron")][gdim - 2]
    cells = [str(c) for c in rng.choice([simplices, others], 2)]
    quadrature = str(rng.choice(["nodal", "overlay"]))
    degree = 2 if quadrature == "overlay" and rng.random() < 0.3 else 1
    lower = str(rng.choice(["elastic", "elastic", "neo", "neo", "viscous", "mini"]))
    upper = str(rng.choice([*TOOLS, "elastic", "neo", "viscous"]))
    materials = (lower, upper)
    if lower == "mini":
        cells[0] = simplices
    flows, has_tool = set(materials) & set(FLOWS), upper in TOOLS
    if flows:
        degree = 1
    tied = bool(rng.random() < 0.2)
    formulations = ["master-slave", "quasi-symmetric", "quasi-symmetric", "double-pass"]
    formulation = str(rng.choice(formulations[: 3 if has_tool else 4]))
    augmented = formulation != "double-pass" and rng.random() < 0.4
    most = {(2, 1): 6, (2, 2): 4, (3, 1): 3, (3, 2): 2}[gdim, degree]
    options = {
        "formulation": formulation,
        "quadrature": quadrature,
        "enforcement": "augmented-lagrangian" if augmented else "penalty",
    }
    if quadrature == "overlay" and not tied:
        options["constraints"] = str(rng.choice(["nodes", "points"]))
    kinds = ["", "", "coulomb", "coulomb", "tresca", "norton"]
    friction = "" if tied else str(rng.choice(kinds))
    driven = has_tool and not tied and rng.random() < 0.3
    solvers = ["direct", "auto", "auto", "fieldsplit"] + ["amg"] * augmented
    if lower == "mini":
        solvers = ["direct", "auto"]
    may_be_carried = "elastic" not in materials and not driven
    words, path = random_path(rng, tied or driven, driven, may_be_carried)
    axis = np.array([0.0, 0.0, 1.0]) if gdim == 2 else rng.choice(np.eye(3)[[0, 1, 2, 2]])
    spins = upper == "sphere" or (gdim == 3 and axis[2] == 1)
    stepping = {
        "theta": float(rng.choice([0.0, 0.5, 0.5, 1.0])),
        "num_pairings": int(rng.choice([1, 1, 2])),
    }
    limits = ({}, {}, {"max_slip": 0.3}, {"max_rotation": 0.06})
    if not tied:
        stepping |= limits[rng.integers(len(limits))]
    powers = rng.uniform(-1, 1, 2) * ((12, 6) if units else (0.5, 0.5)) - (0, 3 if units else 0)
    return History(
        number=number,
        gdim=gdim,
        cells=(cells[0], cells[1]),
        n=tuple(tuple(int(k) for k in rng.integers(2, most + 1, gdim)) for _ in range(2)),
        degree=degree,
        materials=materials,
        driven=bool(driven),
        swapped=bool(not has_tool and rng.random() < 0.4),
        curvature=float(rng.uniform(0.1, 0.5)) if upper == "sphere" or rng.random() < 0.3 else 0.0,
        wave=float(rng.choice([0, 0, 0, 0.01])),
        gap=gap_of(rng, tied, driven, number),
        depth=float(rng.uniform(0.005, 0.03)),
        slide=float(10 ** rng.uniform(-3, -1.5 if tied else -0.9)),
        turn=float(rng.choice([-1, 1]) * rng.uniform(0.02, 0.1 if spins else 0.03)),
        carry=float(rng.choice([-1, 1]) * rng.uniform(0.02, 0.12)) if may_be_carried else 0.0,
        axis=tuple(float(a) for a in axis),
        ratio=float(10 ** rng.choice([-1, -0.3, 0, 0.3, 1])),
        nu=float(rng.choice([0.0, 0.3, 0.45])),
        m=float(rng.choice([1.0, 0.6])),
        words=words,
        path=path,
        tied=tied,
        friction=friction,
        mu=float(rng.uniform(0.05, 0.6)) * (1.0 if friction in ("", "coulomb") else 0.01),
        stiff=None if rng.random() < 0.6 else float(10 ** rng.uniform(1, 3)),
        options=options,
        stepping=stepping,
        solver=str(rng.choice(solvers)),
        refused=int(rng.choice([0, 0, 1, 2, 3])),
        restarted=int(rng.choice([0, 0, 1, 2, len(path) - 1])),
        partitions=tuple(str(p) for p in rng.choice(list(PARTITIONS), 2)),
        E=float(10 ** powers[0]),
        L=float(10 ** powers[1]),
    )


def gap_of(rng, tied, driven, number):
    """Return the initial gap between the bodies: ties reach across wide gaps."""
    if not tied:
        return 0.0 if driven else float(rng.choice([0.0, 0.0, 0.003, 0.01]))
    other = np.random.default_rng([SEED, number, 1])
    return float(other.uniform(0.05, 0.3)) if other.random() < 0.5 else 0.0


def random_path(rng, stays, driven, may_be_carried):
    """Return words and waypoints of 3 to 8 steps; ``stays`` if contact is to be kept."""
    at, words, path = Waypoint(), [], []
    count = int(rng.integers(3, 9)) if rng.random() < 0.3 else int(rng.integers(3, 6))
    for i in range(count):
        choice = ["press", "slide", "slide", "turn", "press"]
        choice += [] if stays else ["lift", "lose"]
        choice += ["carry"] * may_be_carried
        word = "press" if i == 0 else str(rng.choice(choice))
        if at.down <= 0 and i > 0:
            word = "press again"
        if word.startswith("press"):
            down = float(rng.uniform(0.6, 1.0)) + (0.3 if at.down > 0.6 else 0.0)
            both = 0.3 if rng.random() < 0.3 else 0.0
            at = at._replace(down=down, along=at.along + both)
        elif word == "slide":
            at = at._replace(along=at.along + float(rng.choice([1.0, 0.5, -0.5])))
        elif word == "lift":
            at = at._replace(down=0.3 * at.down)
        elif word == "lose":
            at = at._replace(down=-1.0)
        elif word == "turn":
            at = at._replace(turned=at.turned + float(rng.choice([1.0, 0.5, -0.5])))
        else:
            at = at._replace(carried=at.carried + 1.0)
        if driven:
            at = at._replace(pushed=float(rng.uniform(0.3, 1.0)))
        words.append(word)
        path.append(at)
    return ", ".join(words), tuple(path)
