"""Build the closed-die demo on a given mesh of the billet, also after remeshing."""

import dataclasses
import pathlib
import tempfile

import numpy as np

import ufl
from dolfinx import fem

import qsdolfinx as qs
from qsdolfinx.compat import interpolation_points

from closed_die_tools import DIES, FLASH, LAND, billet_size, cavity, skin, write_stl
from common.bodies import facets_at, fix, integral
from forming_bodies import NortonHoff

K, M = 50.0, 0.15  # MPa sᵐ at START, -
SOFTENING, START, DIE = 2.7e-3, 1100.0, 200.0  # 1/K, initial °C of the billet, °C of the dies
CONDUCTIVITY, CAPACITY = 30.0, 5.0  # mW/(mm K), mJ/(mm³ K)
TOUCHING, HALF = 20.0, 20.0  # mW/(mm² K), MPa: largest conductance; pressure for half
TO_HEAT = 0.9  # part of the plastic work that becomes heat
TO_BILLET = 0.5  # part of the heat of friction that goes into the billet
SPEED = 100.0  # speed of the press, mm/s
MU, M_BAR, ALPHA = 0.2, 0.4, 0.3  # Coulomb's coefficient, friction factor, Norton's factor
RATE = 5.0  # 1/s, strain rate of the flow stress that limits friction
RADIUS = 17.0  # radius of the billet, mm


def read_dies(comm, size):
    """Make the lower and the upper die from STL files with facets of a size, the upper one raised.

    Returns:
        The lower and the upper die.
    """
    dies = []
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(comm.bcast(folder))
        for die in DIES:
            if comm.rank == 0:
                write_stl(die, folder / f"{die}.stl", size)
            dies.append(qs.RigidSurface.from_stl(comm, folder / f"{die}.stl"))
        comm.barrier()
    return dies


def stroke_of(flash):
    """Compute the stroke from contact with the billet, which stands on the web, to closed dies."""
    webs = DIES["lower"][2][1] + DIES["upper"][2][1]
    return billet_size(RADIUS, flash) - webs - FLASH


def raise_die(die, way):
    """Raise a die above its position with closed dies."""
    die.position = np.column_stack([np.eye(3), [0.0, 0.0, way]])


def friction_law(name, msh):
    """Return the friction law of contact with a die; None for no friction."""
    flow_stress = fem.Constant(msh, K * np.sqrt(3) ** (M + 1) * RATE**M)
    return {
        "none": lambda: None,
        "norton": lambda: qs.Norton(ALPHA, K, M),
        "coulomb-tresca": lambda: qs.CoulombTresca(MU, M_BAR, flow_stress),
    }[name]()


def measure_of(msh):
    """Return the measure of the residual; UFL would estimate far more points for a power."""
    return ufl.Measure("dx", msh, metadata={"quadrature_degree": 6})


@dataclasses.dataclass
class Scene:
    """A billet on one mesh between the dies: everything that remeshing replaces.

    Attributes:
        billet: Form, unknowns and conditions of the billet.
        strain: Equivalent strain, one value per cell.
        contacts: Contacts of the whole outer surface with the lower and the upper die.
        problem: The mechanical problem.
        heat: The heat problem; its temperature (°C) is solved for after the velocity.
    """

    billet: NortonHoff
    strain: fem.Function
    contacts: list[qs.Contact]
    problem: qs.ContactProblem
    heat: qs.Staggered

    def __post_init__(self):
        points = interpolation_points(self.strain.function_space)
        self._rate = fem.Expression(self.billet.rate, points)
        self._now, self.power = fem.Function(self.strain.function_space), 0.0
        self.warmed = self.cooled = 0.0
        self._power = fem.form(
            ufl.inner(self.billet.stress, self.billet.strain_rate) * measure_of(self.mesh)
        )

    @property
    def mesh(self):
        """The billet's mesh."""
        return self.billet.mesh

    def measure(self):
        """Measure rates and heat on the mesh on which the velocity was solved. Collective."""
        self._now.interpolate(self._rate)
        self.power = self.mesh.comm.allreduce(fem.assemble_scalar(self._power))
        now, before = self.heat.problem.u[0], self.heat.before[0]
        self.warmed = integral(self.mesh, CAPACITY * (now - before) * ufl.dx(self.mesh))
        self.cooled = self.into_dies()

    def advance(self, dt):
        """Add a step to the strain."""
        self.strain.x.array[:] += dt * self._now.x.array

    @property
    def temperature(self):
        """°C, at the vertices, at the end of the last step."""
        return self.heat.before[0]

    def into_dies(self):
        """Compute the heat flow (mW) into the dies, without the heat of friction. Collective."""
        friction = sum(contact.step_dissipation() / contact.dt for contact in self.contacts)
        out = -sum(contact.flow("slave") for contact in self.heat.problem.contacts)
        return out + TO_BILLET * friction

    def num_unknowns(self):
        """Number of unknowns of velocity and pressure on all ranks."""
        dofmap = self.billet.W.dofmap
        return dofmap.index_map.size_global * dofmap.index_map_bs

    def push(self):
        """Compute the force of the press on the quarter (N). Collective."""
        return -self.contacts[1].force("slave")[2]

    def penetration(self):
        """Compute the largest penetration of the two surfaces. Collective."""
        return max(contact.penetration() for contact in self.contacts)

    def filled(self, way):
        """Compute the filled share of the cavity for a distance to closed dies. Collective.

        The cavity is the space between the dies within the land.
        """
        x = ufl.SpatialCoordinate(self.mesh)
        inside = ufl.conditional(ufl.lt(x[0] ** 2 + x[1] ** 2, LAND**2), 1.0, 0.0)
        dx = ufl.Measure("dx", self.mesh, metadata={"quadrature_degree": 6})
        whole = cavity() + np.pi * LAND**2 * way
        return 4 * integral(self.mesh, inside * dx) / whole


def build(msh, dies, dt, penalty, friction="coulomb-tresca", solver="auto"):
    """Build the billet on a mesh, its contacts with both dies, and the problem.

    Args:
        msh: Mesh of a quarter of the billet.
        dies: Lower and upper die.
        dt: First step.
        penalty: Contact penalty (MPa/mm). It is given because the automatic penalty would be
            computed from the viscosity at the start of the first solve.
        friction: "coulomb-tresca", "norton" or "none".
        solver: Linear solver.
    """
    temperature = fem.Function(fem.functionspace(msh, ("Lagrange", 1)), name="temperature")
    temperature.x.array[:] = START
    consistency = K * ufl.exp(-SOFTENING * (temperature - START))
    billet = NortonHoff(msh, consistency, M, slow=1e-3 * RATE)
    V = billet.W.sub(0)
    billet.bcs = [fix(V, axis, facets_at(msh, axis, 0.0)) for axis in (0, 1)]
    surface = billet.surface(skin(msh))
    contacts = [
        qs.Contact(
            surface,
            die,
            unknown="velocity",
            dt=dt,
            penalty=penalty,
            enforcement="penalty",
            constraints="points",
            friction=friction_law(friction, msh),
        )
        for die in dies
    ]
    problem = qs.ContactProblem(
        [billet.F], [billet.w], contacts, [billet.bcs], linear_solver=solver
    )
    strain = fem.Function(fem.functionspace(msh, ("DG", 0)), name="strain")
    return Scene(billet, strain, contacts, problem, build_heat(billet, temperature, contacts, dt))


def build_heat(billet, before, contacts, dt):
    """Build the heat problem: plastic work, friction, and heat flow into the dies in contact.

    Args:
        billet: The billet.
        before: Temperature of the billet at the start of a step.
        contacts: Contacts with both dies.
        dt: First step.
    """
    V, step = before.function_space, fem.Constant(billet.mesh, dt)
    now = fem.Function(V, name="temperature")
    source = qs.materials.plastic_heat(billet.stress, ufl.split(billet.w)[0], TO_HEAT)
    dx = measure_of(billet.mesh)
    F = qs.materials.heat(now, CONDUCTIVITY, CAPACITY, before, step, source, dx=dx)
    surface = qs.Surface(V, facets=contacts[0].slave.facets)

    def h(p, g):
        return TOUCHING * p / (p + HALF)

    across = [
        qs.Contact(
            surface,
            contact.master,
            law=qs.Conductance(h, tool=DIE, friction=TO_BILLET if contact.friction else None),
            mechanics=contact,
            dt=dt if contact.friction else None,
        )
        for contact in contacts
    ]
    return qs.Staggered(qs.ContactProblem([F], [now], across), [before], step)
