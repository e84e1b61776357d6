"""Run bodies in large sliding contact through GetFEM: its integral brick with ray tracing.

Contact is an augmented Lagrangian with vector-valued multipliers of degree 1 on slave surfaces,
whose deformed normals are traced to the opposite surfaces. Newton's method is GetFEM's own, with
MUMPS. A step that fails is halved.
"""

import argparse
import json
import time

import numpy as np

try:
    import getfem as gf
except ModuleNotFoundError:  # --help does not need GetFEM
    gf = None

#: Number of the region that may come into contact.
TOUCHING = 1

ENERGY = (
    "mu_{0}/2*(Norm_sqr(Id(2)+Grad_u_{0})-2-2*log(Det(Id(2)+Grad_u_{0})))"
    "+la_{0}/2*sqr(log(Det(Id(2)+Grad_u_{0})))"
)


class Part:
    """A body in GetFEM: mesh, displacements, and the map between its nodes and ours.

    Args:
        body: The body.
        order: Order of the quadrature of the contact.
    """

    def __init__(self, body, order):
        self.body = body
        self.mesh = gf.Mesh("empty", 2)
        points = np.asarray(self.mesh.add_point(body.x.T)).ravel()
        # GetFEM counts the corners of a quadrilateral row by row.
        corners = body.x[body.cells[:, [0, 1, 3, 2]]]
        for x in corners:
            self.mesh.add_convex(gf.GeoTrans("GT_QK(2,1)"), x.T)
        self.node = np.full(points.max() + 1, -1)
        self.node[points] = np.arange(len(points))
        self.mark_edges(TOUCHING, body.touching)
        self.u = gf.MeshFem(self.mesh, 2)
        self.u.set_fem(gf.Fem("FEM_QK(2,1)"))
        self.inside = gf.MeshIm(self.mesh, gf.Integ("IM_GAUSS_PARALLELEPIPED(2,3)"))
        self.surface = gf.MeshIm(self.mesh, gf.Integ(f"IM_GAUSS_PARALLELEPIPED(2,{order})"))
        self.dofs = self.find_dofs()

    def mark_edges(self, region, edges):
        """Make a region of the outer edges with the given nodes."""
        self._mark(region, {frozenset(e) for e in edges.tolist()}.__contains__)

    def mark_between(self, region, nodes):
        """Make a region of all outer edges between the given nodes."""
        self._mark(region, set(nodes.tolist()).issuperset)

    def _mark(self, region, wanted):
        """Make a region of the outer faces whose set of nodes satisfies ``wanted``."""
        found = []
        for face in self.mesh.outer_faces().T:
            ends = self.mesh.pid_in_faces(face.reshape(2, 1)).ravel()
            if wanted(frozenset(self.node[ends].tolist())):
                found.append(face)
        self.mesh.set_region(region, np.array(found).T)

    def find_dofs(self):
        """Return the numbers of the unknowns of our nodes, (n, 2)."""
        at = np.asarray(self.u.basic_dof_nodes()).T[::2]
        order = [np.lexsort(np.round(x, 9).T) for x in (self.body.x, at)]
        if not np.allclose(self.body.x[order[0]], at[order[1]], rtol=0, atol=1e-12):
            raise RuntimeError("GetFEM's unknowns are not at the nodes")
        dofs = np.empty((len(at), 2), dtype=int)
        dofs[order[0]] = 2 * order[1][:, None] + np.arange(2)
        return dofs


class Scene:
    """The model of bodies in contact.

    Derived classes add boundaries to the brick and clamp regions, with the data ``moved`` for the
    moved region. They report a state by ``row`` and ``line``.

    Args:
        p: Arguments, see arguments().
        parts: Bodies by name.
        moduli: μ and λ by name.
    """

    HEADER = ""

    def __init__(self, p, parts, moduli):
        self.p, self.parts = p, parts
        self.model = gf.Model("real")
        self.unknowns = [f"u_{name}" for name in parts] + ["traction"]
        for name, part in parts.items():
            self.add_body(name, part, moduli[name])

    def add_body(self, name, part, moduli):
        for letter, value in zip(("mu", "la"), moduli, strict=True):
            self.model.add_initialized_data(f"{letter}_{name}", [value])
        self.model.add_fem_variable(f"u_{name}", part.u)
        self.model.add_nonlinear_term(part.inside, ENERGY.format(name), -1, True)

    def add_brick(self, slave, region=TOUCHING):
        """Add the brick, and multipliers on a region of a part; with friction only if not zero.

        Returns:
            The number of the brick, and the further names that boundaries of parts need.
        """
        model, p = self.model, self.p
        slave = self.parts[slave]
        on_surface = slave.u.basic_dof_on_region(region)
        self.multipliers = gf.MeshFem("partial", slave.u, on_surface)
        model.add_fem_variable("traction", self.multipliers)
        model.add_initialized_data("r", [p.augmentation])
        model.add_initialized_data("f", [p.friction])
        model.add_initialized_data("rate", [1.0])
        brick = model.add_integral_large_sliding_contact_brick_raytracing(
            "r", p.release, "f", "rate", int(p.symmetric)
        )
        before = {name: () for name in self.parts}
        if p.friction > 0:
            for name, part in self.parts.items():
                model.add_fem_data(f"before_{name}", part.u)
                before[name] = (f"before_{name}",)
        return brick, before

    def clamp(self, name, region, value):
        """Prescribe the displacement of a region by the data of this name, initially 0."""
        self.model.add_initialized_data(value, [0.0, 0.0])
        self.model.add_Dirichlet_condition_with_simplification(f"u_{name}", region, value)

    def values(self, name):
        return np.array(self.model.variable(name)).ravel()

    def state(self):
        return {name: self.values(name) for name in self.unknowns}

    def restore(self, state):
        for name, values in state.items():
            self.model.set_variable(name, values)

    def forces(self, name):
        """Return the nodal forces of the stress of a body."""
        part = self.parts[name]
        values = gf.asm_generic(
            part.inside, 1, ENERGY.format(name), -1, self.model, "select_output", f"u_{name}"
        )
        return np.array(values).ravel()[part.dofs]

    def newton(self, ends):
        """Run Newton's method for a position of the moved region; return iterations and success."""
        self.model.set_variable("moved", list(ends))
        arguments = ["lsolver", "mumps", "lsearch", self.p.search]
        limits = ["max_iter", self.p.iterations, "max_res", self.p.tolerance]
        try:
            count, ended = self.model.solve(*arguments, *limits, *["noisy"] * self.p.verbose)
        except RuntimeError as error:
            print(f"  {str(error).strip().splitlines()[-1]}", flush=True)
            return self.p.iterations, False
        return count, bool(ended) and all(np.isfinite(v).all() for v in self.state().values())

    def advance(self, start, end, depth=0):
        """Move from one position to another, in halves if Newton's method fails.

        Returns:
            Iterations of all attempts, iterations of failed attempts, number of solved parts; None
                if it fails.
        """
        saved = self.state()
        if self.p.friction > 0:
            for name in self.parts:
                self.model.set_variable(f"before_{name}", saved[f"u_{name}"])
        count, ended = self.newton(end)
        if ended:
            return np.array([count, 0, 1])
        self.restore(saved)
        if depth == self.p.halvings:
            return None
        total = np.array([count, count, 0])
        middle = tuple((a + b) / 2 for a, b in zip(start, end, strict=True))
        for part in ((start, middle), (middle, end)):
            done = self.advance(*part, depth + 1)
            if done is None:
                self.restore(saved)
                return None
            total += done
        return total

    def displacements(self, name):
        """Return the displacements of the nodes of a body."""
        return self.values(f"u_{name}")[self.parts[name].dofs]


def arguments(text, release):
    """Make a parser with the options of all jobs."""
    parser = argparse.ArgumentParser(
        description=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--refine", type=int, default=1, help="refinement factor of all cells")
    add("--friction", type=float, default=0.0, help="Coulomb's coefficient")
    add("--augmentation", type=float, default=1e3, help="r of the augmented Lagrangian")
    add("--release", type=float, default=release, help="search distance of contact")
    add("--order", type=int, default=7, help="quadrature order of the contact")
    add("--symmetric", action="store_true", help="the more symmetric form of the brick")
    add("--search", choices=("simplest", "systematic", "quadratic", "basic"), default="simplest")
    add("--tolerance", type=float, default=1e-9, help="GetFEM's max_res")
    add("--iterations", type=int, default=40, help="most iterations of Newton's method")
    add("--halvings", type=int, default=5, help="most halvings of a step")
    add("--no-along", dest="along", action="store_false", help="only press, without sliding")
    add("--output", metavar="NPZ", help="file of displacements, all nodes and steps")
    add("--verbose", action="store_true", help="print GetFEM's Newton log")
    return parser


def run(make_scene, p, path):
    """Follow a path of positions; print a table and a line RESULT {json}.

    Args:
        make_scene: The class of the scene.
        p: Arguments.
        path: Positions of the moved region.
    """
    gf.util_trace_level(1)
    start = time.perf_counter()
    scene = make_scene(p)
    setup = time.perf_counter() - start
    rows, position, states = [], (0.0, 0.0), []
    print(scene.HEADER)
    for step, ends in enumerate(path, 1):
        begun = time.perf_counter()
        done = scene.advance(position, ends)
        seconds = time.perf_counter() - begun
        if done is None:
            print(f"{step:4}{ends[0]:9.3f}{ends[1]:8.3f}  not solved", flush=True)
            break
        position = ends
        counts = dict(zip(("newton", "in_vain", "parts"), done.tolist(), strict=True))
        row = {"step": step, "ends": ends} | scene.row() | counts | {"seconds": seconds}
        print(scene.line(row), flush=True)
        rows.append(row)
        states.append({name: scene.displacements(name) for name in scene.parts})
    if p.output:
        np.savez(p.output, **{n: np.array([s[n] for s in states]) for n in scene.parts})
    result = {
        "program": "getfem",
        "settings": vars(p),
        "setup": setup,
        "steps": rows,
        "solved": len(rows) == len(path),
    }
    print(f"{sum(row['seconds'] for row in rows):.1f} s")
    print("RESULT", json.dumps(result, default=float), flush=True)
