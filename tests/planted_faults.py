"""Define the faults for planted.py: one line each, and the tests that are expected to detect it."""

import typing


class Fault(typing.NamedTuple):
    """A fault of one line.

    Attributes:
        name: Name of the fault.
        file: File that contains the line.
        old: Text of the line, or a part of the line, that the fault changes; occurs once in the
            file.
        new: Text that replaces it.
        what: Consequence of the fault.
        tests: Tests that are expected to detect it: files, or functions in them. No single cases of
            a function: their names change, and several ranks run only a share of them.
        ranks: Number of ranks needed to detect it.
        hangs: Whether ranks wait for each other for ever, so that a time-out counts as a detection.
    """

    name: str
    file: str
    old: str
    new: str
    what: str
    tests: tuple[str, ...]
    ranks: int = 1
    hangs: bool = False


FAULTS = [
    # --- Blocks added to the matrix, checkpoints
    Fault(
        "motions of other pieces",
        "cpp/tangent/curvature.cpp",
        "motions.subspan(3 * insertion.size() * first)",
        "motions.subspan(0)",
        "all segments take the motion of the points of the first one",
        ("tests/sliding/test_tangent.py",),
    ),
    Fault(
        "unscaled curvature",
        "cpp/tangent/curvature.cpp",
        "block_[r * n + c] = scale_[c] * H[",
        "block_[r * n + c] = H[",
        "finite sliding: curvature of velocity-based bodies lacks Δt",
        ("tests/sliding/test_tangent.py",),
    ),
    Fault(
        "one diagonal for all",
        "qsdolfinx/system/gap_matrices.py",
        "out[:, num + k, num + k] = own",
        "out[:, num + k, num + k] = own[:, :1]",
        "the equations of tangential multipliers have the factor of the normal multipliers",
        ("tests/sliding/test_tangent.py",),
    ),
    Fault(
        "the first of equal keys",
        "qsdolfinx/steps/rendezvous.py",
        "order[np.repeat(first, count) + within]",
        "order[np.repeat(first, count)]",
        "of several values with the same key the first one is returned several times",
        ("tests/steps/test_rendezvous.py",),
    ),
    Fault(
        "every rank reads all",
        "qsdolfinx/steps/checkpoint.py",
        'range(self._comm.rank, content["ranks"], self._comm.size)',
        'range(content["ranks"])',
        "each rank reads every file of a checkpoint, so that values occur several times",
        ("tests/steps/test_rendezvous.py",),
        ranks=2,
    ),
    # --- The extension
    Fault(
        "bent facets",
        "cpp/geometry/facet.cpp",
        "2 * (dN[a][0] * dN[b][1] + dN[a][1] * dN[b][0])",
        "4 * (dN[a][0] * dN[b][1])",
        "mixed second derivatives of degree 2 on triangles: only the tangent of finite sliding",
        ("tests/sliding/test_ray.py::test_hessian",),
    ),
    Fault(
        "third edge",
        "cpp/geometry/projection.cpp",
        "{1 - r, r}",
        "{r, 1 - r}",
        "the nearest point of a triangle's third edge is measured from the wrong end",
        ("tests/pairing/test_projection.py::test_closest_point",),
    ),
    Fault(
        "tie of ranks",
        "cpp/search/search.cpp",
        "if (!std::lexicographical_compare(",
        "if (std::lexicographical_compare(",
        "of equally distant facets, several ranks take the last one, a single rank the first one",
        ("tests/pairing/test_which_facet.py::test_ties_but_for_rounding",),
        ranks=2,
    ),
    Fault(
        "way back",
        "cpp/search/way_out.cpp",
        "a.length + b.length < (1 - equal_tolerance)",
        "a.length < (1 - equal_tolerance)",
        "the visibility test of an overlap leaves out the part on the other side",
        ("tests/pairing/test_shorter_ways_out.py",),
    ),
    Fault(
        "own side",
        "cpp/search/winding.cpp",
        "(dot(normal[p], d) < 0 ? 1 : 0)",
        "(dot(normal[p], d) > 0 ? 1 : 0)",
        "self-contact: the inside test of a point counts its own facet on the wrong side",
        ("tests/contact/test_itself.py",),
    ),
    Fault(
        "rings of the overlay",
        "cpp/pairing/overlay.cpp",
        "share_ * w_[p] * stretch * cut_.area_factor(x)",
        "share_ * w_[p] * stretch",
        "weights of axisymmetric overlays without 2πr",
        (
            "tests/gap/test_axisymmetric.py::test_finite_differences",
            "tests/pairing/test_weights_and_places.py::test_areas_of_warped_facets",
        ),
    ),
    Fault(
        "cover of other ranks",
        "cpp/pairing/cover.cpp",
        "here[name(i)] += sums[i];",
        "here[name(i)] = sums[i];",
        "mortar weights of a node from quadrature points of other ranks are not added",
        ("tests/gap/test_hardly_covered.py::test_what_ranks_cover_of_a_node_adds_up",),
        ranks=2,
    ),
    Fault(
        "shear of curvature",
        "cpp/surface/curvature.cpp",
        "const double k12 = k[1] / std::numbers::sqrt2;",
        "const double k12 = k[1];",
        "mixed component of the fitted curvature is √2 too large",
        ("tests/gap/test_smoothing.py::test_gap_of_concentric_surfaces",),
    ),
    Fault(
        "weights of multipliers' rows",
        "cpp/gap/point_rows.cpp",
        "sum[k * size + c] += force * N[k] * motion[2 * size + c];",
        "sum[k * size + c] -= force * N[k] * motion[2 * size + c];",
        "finite sliding: sign in the tangent of the multiplier constraints where areas change",
        ("tests/sliding/test_tangent.py::test_derivative",),
    ),
    Fault(
        "points of other ranks",
        "cpp/gap/gap.cpp",
        "const int rank = points.slave.owner[p * ns + i];",
        "const int rank = points.slave.owner[p * ns];",
        "contact quadrature points are sent only to the owner of a facet's first vertex",
        ("tests/pairing/test_overlay.py",),
        ranks=2,
    ),
    Fault(
        "bent tractions",
        "cpp/sliding/ray.cpp",
        "alpha == 0 ? Vec2{h11, h12} : Vec2{h12, h22}",
        "alpha == 0 ? Vec2{h11, h22} : Vec2{h22, h12}",
        "finite sliding: two derivatives exchanged in the tangent of friction on curved facets",
        ("tests/sliding/test_ray.py::test_slip_hessian",),
    ),
    Fault(
        "scale of the rows",
        "cpp/tangent/insertion.cpp",
        "factor[r] = value(r) * scale[b];",
        "factor[r] = value(r) * scale[a];",
        "tangent of a velocity-based on a displacement-based body: Δt of the wrong side",
        ("tests/gap/test_velocity.py::test_finite_differences",),
    ),
    Fault(
        "coupling of friction",
        "cpp/tangent/friction.cpp",
        "c[i] * G.coefficient[e * d + j % d]",
        "c[i] * G.coefficient[e * d + i]",
        "∂τ/∂λ takes the wrong component of the normal: only the tangent of friction",
        ("tests/friction/test_friction.py::test_finite_differences",),
    ),
    Fault(
        "records of ranks",
        "cpp/parallel/exchange.cpp",
        "counts_from[sources[i]] = received[i];",
        "counts_from[sources[i]] = received[0];",
        "all ranks are assumed to send as much as the first rank",
        ("tests/surface/test_surface.py::test_same_on_any_number_of_ranks",),
        ranks=2,
    ),
    # --- base
    Fault(
        "first to fail",
        "qsdolfinx/base/collective.py",
        "comm.size if error is None else comm.rank, digest",
        "comm.size if error is None else 0, digest",
        "collective errors: rank 0 is assumed to be the failed rank",
        ("tests/base/test_checked.py::test_one_rank_fails_and_others_disagree",),
        ranks=3,
    ),
    Fault(
        "silence",
        "qsdolfinx/base/messages.py",
        "logger.level > logging.INFO",
        "logger.level >= logging.INFO",
        "messages are not logged at the level INFO",
        ("tests/contact/test_report.py::test_printed_unless_logging_is_set_up",),
    ),
    # --- surface, pairing
    Fault(
        "ghosts of nodal values",
        "qsdolfinx/surface/surface.py",
        "        vector.scatter_forward()\n",
        "        pass\n",
        "functions with nodal values, such as tractions, are zero at ghosts",
        ("tests/surface/test_surface.py::test_functions_of_nodal_values_know_ghosts",),
        ranks=2,
    ),
    Fault(
        "back of a body",
        "qsdolfinx/pairing/pair.py",
        "keep = (np.abs(gap) <= radius.largest) & (np.sum(normal * points.normal, axis=1) < 0)",
        "keep = np.abs(gap) <= radius.largest",
        "the back of a body is paired with an analytic tool",
        ("tests/tools/test_rigid_surface.py::test_what_is_paired",),
    ),
    # --- gap
    Fault(
        "touching",
        "qsdolfinx/gap/laws.py",
        "np.where(gap[:, 0] >= -touching, penalty, 0.0)",
        "np.where(gap[:, 0] > touching, penalty, 0.0)",
        "bodies that just touch have no contact stiffness: only the tangent",
        ("tests/gap/test_at_first.py::test_touching",),
    ),
    Fault(
        "sweeps back",
        "qsdolfinx/gap/extension.py",
        "for sweep in reversed(self._sweeps):",
        "for sweep in self._sweeps:",
        "condensation of redundant multipliers: transposed in the wrong order",
        ("tests/contact/test_held.py::test_forces_of_multipliers_that_follow",),
    ),
    Fault(
        "bent tools",
        "qsdolfinx/gap/shape_points.py",
        'H = np.einsum("fp,pi,pj,fpab->fiajb", force,',
        'H = np.einsum("fp,pi,pj,fpab->fiajb", -force,',
        "finite sliding on round rigid tools: a sign in the tangent",
        ("tests/sliding/test_tangent.py::test_round_tool",),
    ),
    Fault(
        "heat of the master",
        "qsdolfinx/gap/friction_heat.py",
        "b[1].axpy(1 - self._share, into[1])",
        "b[1].axpy(self._share, into[1])",
        "the master gets the slave's share of the frictional heat",
        ("tests/contact/test_scalar.py::test_heat_of_friction",),
    ),
    # --- friction
    Fault(
        "power of Norton's law",
        "qsdolfinx/friction/laws.py",
        "rows.projector + (self.q - 1) * direction",
        "rows.projector + self.q * direction",
        "derivative of viscoplastic friction",
        ("tests/friction/test_friction_laws.py::test_derivatives",),
    ),
    Fault(
        "turned tool",
        "qsdolfinx/gap/facet_cutter.py",
        "before[:, gdim] - turn @ now[:, gdim]",
        "before[:, gdim] - now[:, gdim]",
        "finite sliding: slip on a rigid tool that rotates, away from its centre",
        ("tests/sliding/test_turning.py::test_with_friction_on_a_tool",),
    ),
    # --- contact
    Fault(
        "open and conducting",
        "qsdolfinx/contact/coupling.py",
        "(self._at_points[i], -of_g * opened)",
        "(self._at_points[i], -of_g)",
        "∂h/∂g is not zero at zero distance: only the tangent of conductance",
        ("tests/contact/test_scalar.py::test_tangent",),
    ),
    Fault(
        "tool at the start",
        "qsdolfinx/contact/motion.py",
        "tool = np.zeros_like(slip.state.start) if moved is None else -slip.change(moved)",
        "tool = np.zeros_like(slip.state.start) if moved is None else slip.change(moved)",
        "slip in a step counts the previous displacement of the tool twice",
        ("tests/friction/test_friction_rigid.py::test_steps",),
    ),
    # --- system, linear
    Fault(
        "forces of other ranks",
        "qsdolfinx/system/body.py",
        "            self._b.scatter_reverse(la.InsertMode.add)\n",
        "            pass\n",
        "nodal forces from cells of other ranks are left out",
        ("tests/solve/test_problem.py",),
        ranks=2,
    ),
    Fault(
        "lifting",
        "qsdolfinx/system/body.py",
        "x0=[x], alpha=-1.0)",
        "x0=[x], alpha=1.0)",
        "nonlinear bodies: prescribed values enter the first residual with the wrong sign",
        ("tests/solve/test_units.py::test_long_way_to_contact",),
    ),
    Fault(
        "bubbles",
        "qsdolfinx/linear/condensed.py",
        "out[self.bubbles] = self._z.array_r - self._y.array_r",
        "out[self.bubbles] = self._z.array_r + self._y.array_r",
        "preconditioner of flow: wrong sign of the bubble correction; only iterations",
        ("tests/linear/test_schur.py::test_bubbles_are_eliminated_exactly",),
    ),
    Fault(
        "soft motions of one rank",
        "qsdolfinx/linear/soft_motions.py",
        "left = self._system.comm.allreduce(self._motions @ residual, op=MPI.SUM)",
        "left = self._motions @ residual",
        "residuals of iterative solvers along free rigid motions use one rank's unknowns only",
        ("tests/linear/test_multigrid.py", "tests/linear/test_soft_motions.py"),
        ranks=2,
    ),
    # --- steps
    Fault(
        "order of vertices",
        "qsdolfinx/steps/checkpoint.py",
        "np.sort(nodes[:, vertices], axis=1)",
        "nodes[:, vertices]",
        "checkpoints: edges are identified by vertices in an order that depends on the partition",
        ("tests/steps/test_checkpoint.py::test_functions",),
        ranks=2,
    ),
    Fault(
        "part of a tool's way",
        "qsdolfinx/steps/tool_motion.py",
        "part * (done.displacement + tool.displacement) - done.displacement",
        "part * (done.displacement + tool.displacement)",
        "contact detection within a step of flow: the past motion of tools is applied again",
        ("tests/steps/test_stepper.py::test_pairing_in_the_middle_of_the_step",),
    ),
    Fault(
        "heat of a failed step",
        "qsdolfinx/steps/staggered.py",
        '        """Go back to where the step began."""\n        self.begin()',
        '        """Go back to where the step began."""\n        self.accept()',
        "after a cut-back the temperatures of the failed attempt are kept",
        ("tests/steps/test_staggered.py::test_what_ends_a_step_after_the_heat_leaves_no_trace",),
    ),
    # --- remeshing
    Fault(
        "bounds at ghosts",
        "qsdolfinx/remeshing/bounded.py",
        "        vec.ghostUpdate(PETSc.InsertMode.INSERT_VALUES, PETSc.ScatterMode.FORWARD)\n",
        "",
        "remeshing: bounds of values in cells at other ranks' cells are too narrow",
        ("tests/remeshing/test_transfer.py",),
        ranks=3,
    ),
    Fault(
        "rings of new meshes",
        "qsdolfinx/remeshing/surface_values.py",
        "degree = 2 * new.shape_degree(1) + new.area_degree",
        "degree = 2 * new.shape_degree(1) - 1",
        "remeshing: multipliers are transferred with an inexact quadrature",
        ("tests/remeshing/test_surface_values.py",),
    ),
    # --- tools, output
    Fault(
        "pose after a turn",
        "qsdolfinx/tools/pose.py",
        "step @ self.t + motion.b",
        "self.t + motion.b",
        "rigid tools that have been moved rotate about the wrong point",
        ("tests/tools/test_rigid_motion.py::test_position",),
    ),
    Fault(
        "line of the checkpoint",
        "qsdolfinx/output/history.py",
        'float(line["t"]) < t]',
        'float(line["t"]) <= t]',
        "continued tables contain the first new time twice",
        ("tests/output/test_output.py::test_history",),
    ),
    # --- materials
    Fault(
        "free expansion",
        "qsdolfinx/materials.py",
        "free = (3 * lmbda + 2 * mu) * thermal_strain",
        "free = (3 * lmbda + mu) * thermal_strain",
        "thermal stress of elastic bodies",
        ("tests/test_heat.py::test_free_expansion_has_no_stress",),
    ),
    Fault(
        "energy of hardening",
        "qsdolfinx/plasticity.py",
        "self.hardening / 2 * alpha**2",
        "self.hardening * alpha**2",
        "stored energy of plastic bodies",
        ("tests/test_plasticity.py::test_energy",),
    ),
    Fault(
        "middle of pieces",
        "cpp/sliding/motion.cpp",
        "const Vec2 lever = its - middle, u = t - s;",
        "const Vec2 lever = middle - its, u = t - s;",
        "finite sliding: motion of a segment's middle with its corners",
        ("tests/sliding/test_tangent.py::test_derivative",),
    ),
    Fault(
        "crossings of edges",
        "cpp/sliding/motion.cpp",
        "append(cut.q[a] + s * t, out);",
        "append(cut.q[b] + s * t, out);",
        "finite sliding: positions of segment corners for their motion",
        ("tests/sliding/test_tangent.py::test_derivative",),
    ),
    Fault(
        "rings that grow",
        "cpp/sliding/motion.cpp",
        "at[0] += N[i] / r;",
        "at[0] -= N[i] / r;",
        "finite sliding, axisymmetric: growth of areas with the radius",
        ("tests/sliding/test_tangent.py::test_rings",),
    ),
    Fault(
        "tractions out of plane",
        "cpp/sliding/ray.cpp",
        "normal.add_to(-1 * tau, &turn[3 * columns.along]);",
        "normal.add_to(1 * tau, &turn[3 * columns.along]);",
        "finite sliding: tractions rotate in the wrong direction in the tangent",
        ("tests/sliding/test_ray.py::test_slip_hessian",),
    ),
    Fault(
        "what tractions lean by",
        "cpp/gap/point_rows.cpp",
        "+ c] -= leaning[p] * turn[",
        "+ c] += leaning[p] * turn[",
        "finite sliding: sign in the tangent of the rotation of tangential multipliers",
        ("tests/sliding/test_tangent.py::test_friction",),
    ),
    Fault(
        "slopes before corners",
        "cpp/sliding/rise.cpp",
        "add(&slope.by_nodes[3 * (columns.other + j)], -1 / along, m);",
        "add(&slope.by_nodes[3 * (columns.other + j)], 1 / along, m);",
        "finite sliding: tangent at corners, slope of the opposite surface",
        ("tests/sliding/test_vertices.py::test_derivative",),
    ),
    Fault(
        "normals that turn",
        "qsdolfinx/gap/vertex_normals.py",
        'np.einsum("fkab,fjbc->fkajc", across, by)',
        'np.einsum("fkab,fjbc->fkajc", -across, by)',
        "finite sliding: tangent at corners, rotation of normals with all facets",
        ("tests/sliding/test_vertices.py::test_derivative",),
    ),
    Fault(
        "corners that bear",
        "qsdolfinx/gap/weighted_gap.py",
        "state.vertices = np.where(bears, before, state.vertices)",
        "state.vertices = np.where(bears, 2 * before, state.vertices)",
        "finite sliding: steps start with wrong areas of active corners",
        ("tests/sliding/test_vertices.py::test_vertices_that_bear_keep_their_points",),
    ),
]
