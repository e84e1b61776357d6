"""The half ring on a block (ring.py) through GetFEM: its large sliding contact with ray tracing.

Contact is GetFEM's integral brick: an augmented Lagrangian with vectors of multipliers of degree 1
on the slave surface, whose deformed normals are traced to the other surface; and its own Newton
method, with MUMPS. A step that fails is halved.

    python3 bench/peers/install.py getfem --install FOLDER
    FOLDER/getfem/python bench/peers/getfem_ring.py --refine 2 --friction 0.2
"""

import argparse
import json
import pathlib
import sys
import time

import numpy as np

try:
    import getfem as gf
except ModuleNotFoundError:  # --help needs none
    gf = None

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import ring

#: Numbers of the regions of each mesh.
TOUCHING, HELD = 1, 2
#: Share of the greatest traction from which on a node counts as closed.
CLOSED = 0.01

ENERGY = (
    "mu_{0}/2*(Norm_sqr(Id(2)+Grad_u_{0})-2-2*log(Det(Id(2)+Grad_u_{0})))"
    "+la_{0}/2*sqr(log(Det(Id(2)+Grad_u_{0})))"
)


class Part:
    """A body in GetFEM: mesh, displacements, and which of its nodes are which of ours."""

    def __init__(self, body, order):
        self.body = body
        self.mesh = gf.Mesh("empty", 2)
        points = np.asarray(self.mesh.add_point(body.x.T)).ravel()
        # GetFEM counts the corners of a quadrilateral row by row.
        corners = body.x[body.cells[:, [0, 1, 3, 2]]]
        for x in corners:
            self.mesh.add_convex(gf.GeoTrans("GT_QK(2,1)"), x.T)
        node = np.full(points.max() + 1, -1)
        node[points] = np.arange(len(points))
        self.mesh.set_region(TOUCHING, self.faces(node, body.touching))
        self.mesh.set_region(HELD, self.faces(node, None))
        self.u = gf.MeshFem(self.mesh, 2)
        self.u.set_fem(gf.Fem("FEM_QK(2,1)"))
        self.inside = gf.MeshIm(self.mesh, gf.Integ("IM_GAUSS_PARALLELEPIPED(2,3)"))
        self.surface = gf.MeshIm(self.mesh, gf.Integ(f"IM_GAUSS_PARALLELEPIPED(2,{order})"))
        self.dofs = self.find_dofs()

    def faces(self, node, edges):
        """Cells and local numbers of outer faces: of given edges, or between clamped nodes."""
        outer = self.mesh.outer_faces()
        held = set(self.body.held.tolist())
        wanted = None if edges is None else {frozenset(e) for e in edges.tolist()}
        found = []
        for face in outer.T:
            ends = self.mesh.pid_in_faces(face.reshape(2, 1)).ravel()
            pair = frozenset(node[ends].tolist())
            if pair <= held if wanted is None else pair in wanted:
                found.append(face)
        return np.array(found).T

    def find_dofs(self):
        """Numbers of the unknowns of our nodes, (n, 2)."""
        at = np.asarray(self.u.basic_dof_nodes()).T[::2]
        order = [np.lexsort(np.round(x, 9).T) for x in (self.body.x, at)]
        if not np.allclose(self.body.x[order[0]], at[order[1]], rtol=0, atol=1e-12):
            raise RuntimeError("GetFEM's unknowns are not at the nodes")
        dofs = np.empty((len(at), 2), dtype=int)
        dofs[order[0]] = 2 * order[1][:, None] + np.arange(2)
        return dofs


class Scene:
    """The model of both bodies in contact."""

    def __init__(self, p):
        self.p = p
        self.model = gf.Model("real")
        self.parts = {name: Part(body, p.order) for name, body in ring.bodies(p.refine).items()}
        for name, part in self.parts.items():
            self.add_body(name, part)
        self.add_contact()
        held = ("u_ring", HELD, "moved"), ("u_block", HELD, "fixed")
        for _, _, value in held:
            self.model.add_initialized_data(value, [0.0, 0.0])
        for name, region, value in held:
            self.model.add_Dirichlet_condition_with_simplification(name, region, value)

    def add_body(self, name, part):
        for letter, value in zip(("mu", "la"), ring.moduli(name), strict=True):
            self.model.add_initialized_data(f"{letter}_{name}", [value])
        self.model.add_fem_variable(f"u_{name}", part.u)
        self.model.add_nonlinear_term(part.inside, ENERGY.format(name), -1, True)

    def add_contact(self):
        """The brick, with friction only if there is any."""
        model, p = self.model, self.p
        master = {"ring": "block", "block": "ring"}[p.slave]
        slave = self.parts[p.slave]
        on_surface = slave.u.basic_dof_on_region(TOUCHING)
        self.multipliers = gf.MeshFem("partial", slave.u, on_surface)
        model.add_fem_variable("traction", self.multipliers)
        model.add_initialized_data("r", [p.augmentation])
        model.add_initialized_data("f", [p.friction])
        model.add_initialized_data("rate", [1.0])
        version = int(p.symmetric)
        brick = model.add_integral_large_sliding_contact_brick_raytracing(
            "r", p.release, "f", "rate", version
        )
        before = {name: () for name in self.parts}
        if p.friction > 0:
            for name, part in self.parts.items():
                model.add_fem_data(f"before_{name}", part.u)
                before[name] = (f"before_{name}",)
        model.add_slave_contact_boundary_to_large_sliding_contact_brick(
            brick, slave.surface, TOUCHING, f"u_{p.slave}", "traction", *before[p.slave]
        )
        model.add_master_contact_boundary_to_large_sliding_contact_brick(
            brick, self.parts[master].surface, TOUCHING, f"u_{master}", *before[master]
        )

    def values(self, name):
        return np.array(self.model.variable(name)).ravel()

    def state(self):
        return {name: self.values(name) for name in ("u_ring", "u_block", "traction")}

    def restore(self, state):
        for name, values in state.items():
            self.model.set_variable(name, values)

    def forces(self, name):
        """Forces that the stress of a body asks of its nodes."""
        part = self.parts[name]
        values = gf.asm_generic(
            part.inside, 1, ENERGY.format(name), -1, self.model, "select_output", f"u_{name}"
        )
        return np.array(values).ravel()[part.dofs]

    def newton(self, ends):
        """Iterations of Newton's method for a position of the ring's ends, and whether it ended."""
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
        """Go from one position to another, in halves where Newton's method fails.

        Returns:
            Iterations of all attempts, iterations in vain, solved parts; or None if it fails.
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

    def row(self):
        """What is told of a state.

        ``down`` and ``along`` are the force of the ring on the block, as its clamped nodes feel it;
        ``balance`` what the clamped nodes of the ring feel more or less than these, ``inside`` the
        greatest force left at a node that nothing touches. The rest are displacements.
        """
        forces = {name: self.forces(name) for name in self.parts}
        on_ring, on_block = (forces[n][self.parts[n].body.held].sum(axis=0) for n in self.parts)
        inside = [np.delete(forces[n], self.loaded(n), axis=0) for n in self.parts]
        tractions = np.hypot(*self.values("traction").reshape(-1, 2).T)
        found = {
            "down": float(on_block[1]),
            "along": float(-on_block[0]),
            "balance": float(np.abs(on_ring + on_block).max()),
            "inside": float(max(np.abs(f).max() for f in inside)),
            "closed": int((tractions > CLOSED * tractions.max()).sum()),
        }
        for name, part in self.parts.items():
            u = self.values(f"u_{name}")[part.dofs]
            found |= {point: u[node].tolist() for point, node in part.body.tracked.items()}
        return found

    def loaded(self, name):
        """Nodes on which forces act from outside."""
        body = self.parts[name].body
        return np.union1d(body.touching, body.held)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--refine", type=int, default=1, help="all cells are cut by it")
    add("--friction", type=float, default=0.0, help="Coulomb's coefficient")
    add("--slave", choices=("ring", "block"), default="ring", help="surface with multipliers")
    add("--augmentation", type=float, default=1e3, help="r of the augmented Lagrangian")
    add("--release", type=float, default=0.15, help="how far surfaces see each other")
    add("--order", type=int, default=7, help="of the quadrature of the contact")
    add("--symmetric", action="store_true", help="the more symmetric form of the brick")
    add("--search", choices=("simplest", "systematic", "quadratic", "basic"), default="simplest")
    add("--tolerance", type=float, default=1e-9, help="GetFEM's max_res")
    add("--iterations", type=int, default=40, help="of Newton's method, at most")
    add("--halvings", type=int, default=5, help="of a step, at most")
    add("--no-along", dest="along", action="store_false", help="only press")
    add("--output", metavar="NPZ", help="displacements of all nodes and steps")
    add("--verbose", action="store_true", help="GetFEM's own account of Newton's method")
    p = parser.parse_args()
    if gf is None:
        parser.error("needs the package getfem: see the head of this file")
    gf.util_trace_level(1)
    start = time.perf_counter()
    scene = Scene(p)
    setup = time.perf_counter() - start
    rows, position, states = [], (0.0, 0.0), []
    print(
        "step    x_end   y_end      down     along  ring x    ring y   block y"
        "  Newton  in vain  parts  closed  seconds"
    )
    for step, ends in enumerate(ring.path(p.along), 1):
        begun = time.perf_counter()
        done = scene.advance(position, ends)
        seconds = time.perf_counter() - begun
        if done is None:
            print(f"{step:4}{ends[0]:9.3f}{ends[1]:8.3f}  not solved", flush=True)
            break
        position = ends
        counts = dict(zip(("newton", "in_vain", "parts"), done.tolist(), strict=True))
        row = {"step": step, "ends": ends} | scene.row() | counts | {"seconds": seconds}
        print(
            f"{step:4}{ends[0]:9.3f}{ends[1]:8.3f}{row['down']:10.4f}{row['along']:10.4f}"
            f"{row['ring_outside'][0]:8.4f}{row['ring_outside'][1]:10.5f}"
            f"{row['block_middle'][1]:10.5f}"
            f"{row['newton']:8}{row['in_vain']:9}{row['parts']:7}{row['closed']:8}{seconds:9.2f}",
            flush=True,
        )
        rows.append(row)
        states.append({n: scene.values(f"u_{n}")[part.dofs] for n, part in scene.parts.items()})
    if p.output:
        np.savez(p.output, **{n: np.array([s[n] for s in states]) for n in scene.parts})
    result = {
        "program": "getfem",
        "settings": vars(p),
        "setup": setup,
        "steps": rows,
        "solved": len(rows) == len(ring.path(p.along)),
    }
    print("RESULT", json.dumps(result), flush=True)


if __name__ == "__main__":
    main()
