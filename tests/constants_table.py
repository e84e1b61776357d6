"""Define for constants.py which tests notice a change of a constant."""

import typing


class Changed(typing.NamedTuple):
    """A constant of the package, changed values, and tests that fail with each of them.

    Attributes:
        constant: File of the package, and name.
        values: Changed values; each has to be noticed.
        tests: Functions, in the folder of the tests; each value is noticed by one of their cases.
    """

    constant: str
    values: tuple[object, ...]
    tests: tuple[str, ...]


CHANGED = [
    Changed(
        "base/rounding.py:NOTICED",
        (0.001, 0.1),
        ("contact/test_warnings.py::test_a_corner_that_sinks",),
    ),
    Changed(
        "contact/advice.py:COARSE",
        (0.01, 1.0),
        (
            "contact/test_warnings.py::test_chords_that_do_not_matter",
            "contact/test_warnings.py::test_chords_of_a_fit",
        ),
    ),
    Changed(
        "contact/advice.py:DEEP",
        (0.025, 2.5),
        (
            "contact/test_warnings.py::test_nothing_to_warn_of",
            "contact/test_warnings.py::test_out_of_reach",
        ),
    ),
    Changed("contact/advice.py:FEW", (1.0,), ("contact/test_warnings.py::test_inverted_tool",)),
    Changed(
        "contact/advice.py:FINER",
        (0.2, 0.9),
        (
            "contact/test_warnings.py::test_finer_master",
            "contact/test_warnings.py::test_nothing_to_warn_of",
        ),
    ),
    Changed(
        "contact/advice.py:THIN", (0.04, 4.0), ("contact/test_warnings.py::test_chords_of_a_fit",)
    ),
    Changed(
        "contact/between_nodes.py:BETWEEN",
        (0.8,),
        ("contact/test_between_nodes.py::test_edge_without_a_force",),
    ),
    Changed(
        "contact/held.py:MOST",
        (9.0,),
        ("contact/test_held.py::test_a_quarter_is_a_quarter_of_the_whole",),
    ),
    Changed(
        "contact/orientation.py:CLOSE", (5.0,), ("contact/test_orientation.py::test_smaller_tool",)
    ),
    Changed(
        "contact/orientation.py:FURTHER",
        (30.0,),
        ("contact/test_orientation.py::test_tool_on_a_body",),
    ),
    Changed(
        "contact/orientation.py:MOST", (9.0,), ("contact/test_orientation.py::test_tool_on_a_body",)
    ),
    Changed(
        "contact/orientation.py:WITHIN",
        (20.0,),
        ("contact/test_orientation.py::test_no_false_alarm",),
    ),
    Changed(
        "contact/penalty.py:AUGMENTED_FACTORS",
        ({False: 1.0, True: 3.0}, {False: 10.0, True: 30.0}),
        ("contact/test_penalty.py::test_ratios",),
    ),
    Changed(
        "contact/penalty.py:FACTORS",
        ({"nodal": 10.0, "overlay": 5.0}, {"nodal": 100.0, "overlay": 50.0}),
        ("contact/test_penalty.py::test_ratios",),
    ),
    Changed(
        "contact/penalty.py:FOLLOWING_FACTOR",
        (0.03, 3.0),
        ("contact/test_penalty.py::test_points",),
    ),
    Changed(
        "contact/penalty.py:MODERATE",
        (3.0,),
        ("contact/test_report.py::test_conditioning_of_iterative_solvers",),
    ),
    Changed(
        "contact/penalty.py:POINTS_FACTOR", (0.4, 40.0), ("contact/test_penalty.py::test_points",)
    ),
    Changed(
        "contact/penalty.py:SLIPS_FACTOR", (0.15, 15.0), ("contact/test_penalty.py::test_points",)
    ),
    Changed(
        "friction/history.py:SAME_RATE",
        (0.01, 1.0),
        ("friction/test_slow_rates.py::test_first_step_with_slip",),
    ),
    Changed(
        "friction/history.py:SLOW",
        (1e-05, 0.1),
        ("friction/test_slow_rates.py::test_a_small_part_of_the_largest_rate",),
    ),
    Changed(
        "friction/history.py:SLOWER",
        (1.0, 50.0),
        ("friction/test_slow_rates.py::test_later_steps",),
    ),
    Changed(
        "friction/of_points.py:DEGREE", (1, 4), ("friction/test_smooth_rest.py::test_polynomials",)
    ),
    Changed(
        "friction/of_points.py:FARTHEST",
        (0.2, 20.0),
        ("friction/test_smooth_rest.py::test_far_away",),
    ),
    Changed(
        "friction/of_points.py:LEAST_SHARE",
        (1e-09,),
        ("friction/test_smooth_rest.py::test_few_points",),
    ),
    Changed(
        "friction/of_points.py:LEAST_SPREAD",
        (0.1,),
        ("friction/test_smooth_rest.py::test_far_away",),
    ),
    Changed(
        "linear/krylov.py:LEAST",
        (10, 300),
        ("linear/test_tolerances.py::test_numbers_of_iterations",),
    ),
    Changed(
        "linear/krylov.py:LOOSE",
        (0.0001, 0.01),
        ("linear/test_tolerances.py::test_solves_before_the_last_one",),
    ),
    Changed(
        "linear/krylov.py:LOOSE_OF_FLOW",
        (1e-07, 1e-05),
        ("linear/test_tolerances.py::test_solves_before_the_last_one",),
    ),
    Changed(
        "linear/krylov.py:LOOSE_OF_LINEAR",
        (0.003, 0.3),
        ("linear/test_tolerances.py::test_solves_before_the_last_one",),
    ),
    Changed(
        "linear/krylov.py:NEAR",
        (1e-08, 0.001),
        ("linear/test_tolerances.py::test_one_solve_where_two_take_longer",),
    ),
    Changed(
        "linear/krylov.py:SAFETY",
        (0.03, 3.0),
        ("linear/test_tolerances.py::test_the_last_solve_ends_newtons_method",),
    ),
    Changed(
        "linear/krylov.py:SAFETY_LINEAR",
        (0.3, 3.0),
        ("linear/test_tolerances.py::test_the_last_solve_ends_newtons_method",),
    ),
    Changed(
        "linear/krylov.py:TIGHTER",
        (0.01, 1.0),
        ("linear/test_tolerances.py::test_residuals_that_stall",),
    ),
    Changed("linear/krylov.py:_LOOSEST", (0.01, 1.0), ("linear/test_tolerances.py::test_bounds",)),
    Changed("linear/presets.py:EXACT", (1e-10, 1e-06), ("linear/test_tolerances.py::test_bounds",)),
    Changed(
        "linear/presets.py:PATIENCE",
        (10, 1000),
        ("linear/test_tolerances.py::test_numbers_of_iterations",),
    ),
    Changed(
        "linear/presets.py:PATIENCE_AT",
        (500, 50000),
        ("linear/test_tolerances.py::test_numbers_of_iterations",),
    ),
    Changed(
        "linear/presets.py:TIGHTEST", (1e-14, 1e-10), ("linear/test_tolerances.py::test_bounds",)
    ),
    Changed(
        "linear/solver.py:MAX_FAILURES",
        (2, 20),
        ("linear/test_tolerances.py::test_a_direct_solver_takes_over_for_a_while",),
    ),
    Changed(
        "pairing/pair.py:LEAST_COVER",
        (1.0,),
        ("gap/test_hardly_covered.py::test_multipliers_are_pressures",),
    ),
    Changed(
        "remeshing/remesh.py:SIZES",
        ((1.0,), (0.5, 1.0)),
        ("remeshing/test_remesh.py::test_the_worst_cell_is_as_wanted",),
    ),
    Changed(
        "remeshing/restore.py:EXACT",
        (0.0001,),
        ("remeshing/test_remesh.py::test_section_keeps_volume_lines_and_tags",),
    ),
    Changed(
        "remeshing/restore.py:FAR",
        (0.0001,),
        ("remeshing/test_remesh.py::test_section_keeps_volume_lines_and_tags",),
    ),
    Changed(
        "remeshing/retriangulate.py:STEP",
        (3.0,),
        ("remeshing/test_remesh.py::test_ten_times_in_a_row",),
    ),
    Changed(
        "remeshing/triangulation.py:LEAST_SHAPE",
        (0.9,),
        ("remeshing/test_triangulation.py::test_coarse_surfaces_keep_their_shape",),
    ),
    Changed(
        "remeshing/triangulation.py:LONG",
        (0.8, 3.0),
        ("remeshing/test_triangulation.py::test_long_edges_are_split",),
    ),
    Changed(
        "remeshing/triangulation.py:SHORT",
        (0.2,),
        ("remeshing/test_triangulation.py::test_short_edges_are_collapsed",),
    ),
    Changed(
        "remeshing/triangulation.py:TURNS",
        (-1.0, 0.9999),
        ("remeshing/test_triangulation.py::test_coarse_surfaces_keep_their_shape",),
    ),
    Changed(
        "solve/chord_pressure.py:NOTICED",
        (0.01, 1.0),
        ("contact/test_warnings.py::test_chords_and_pressure",),
    ),
    Changed(
        "solve/chord_pressure.py:OPENS",
        (0.2,),
        ("contact/test_warnings.py::test_chords_beside_the_approach",),
    ),
    Changed(
        "solve/mixing.py:LEFT",
        (0.05, 0.9),
        ("solve/test_mixing.py::test_residuals_that_say_nothing",),
    ),
    Changed("solve/mixing.py:MOST", (1,), ("solve/test_mixing.py::test_what_is_left_out",)),
    Changed(
        "solve/mixing.py:SLOWLY",
        (0.0001, 0.9),
        (
            "solve/test_mixing.py::test_what_is_left_out",
            "solve/test_mixing.py::test_residuals_that_say_nothing",
        ),
    ),
    Changed(
        "solve/no_progress.py:SAME",
        (0.0001, 0.3),
        (
            "solve/test_no_progress.py::test_iterates_that_repeat",
            "solve/test_no_progress.py::test_what_is_no_cycle",
        ),
    ),
    Changed(
        "solve/one_newton.py:MAX_HALVINGS",
        (80,),
        ("solve/test_tool_balance.py::test_a_step_that_bodies_cannot_follow",),
    ),
    Changed(
        "solve/unsupported.py:ALONG",
        (1.0,),
        ("solve/test_unsupported.py::test_rotation_on_a_cylinder",),
    ),
    Changed(
        "solve/unsupported.py:NOTICED",
        (0.2,),
        ("solve/test_unsupported.py::test_rotation_on_a_cylinder",),
    ),
    Changed("steps/prediction.py:NOTHING", (1e-05,), ("steps/test_swinging.py::test_what_swings",)),
    Changed("surface/facets.py:SHARP", (1.5,), ("tools/test_elevate.py::test_unstructured",)),
    Changed(
        "system/condensed_rows.py:PROXIMAL",
        (1e-10,),
        ("contact/test_edges_of_tools.py::test_many_tips",),
    ),
    Changed(
        "system/normal_rows.py:LEAST",
        (0.5, 50.0),
        ("contact/test_penalty.py::test_factors_of_constraints",),
    ),
    Changed(
        "system/normal_rows.py:LEAST_PROXIMAL",
        (1e-12, 1e-08),
        ("contact/test_penalty.py::test_factors_of_constraints",),
    ),
    Changed(
        "system/normal_rows.py:USUAL",
        (10.0, 1000.0),
        ("contact/test_penalty.py::test_factors_of_constraints",),
    ),
    Changed(
        "tools/heights.py:COARSEST",
        (0.01, 1.4),
        ("tools/test_elevate.py::test_circles", "gap/test_curved_facets.py::test_refused"),
    ),
    Changed(
        "tools/smooth.py:ITERATIONS",
        (3,),
        ("gap/test_curved_facets.py::test_fit_of_cones_in_any_direction",),
    ),
]

#: Constants on which results do not depend, and the test that changes them and shows it.
INDEPENDENT = {
    "base/rounding.py:ROUNDING": "base/test_rounding.py::test_by_a_factor",
    "base/rounding.py:SOLVED": "base/test_rounding.py::test_by_a_factor",
    "base/rounding.py:SINGLE": "base/test_rounding.py::test_by_a_factor",
    "friction/filled.py:OF_PRESSURE": (
        "friction/test_edge_of_contact.py::test_results_do_not_depend_on_the_way"
    ),
    "system/free_motion.py:SHIFT": "system/test_hold.py::test_shift_does_not_matter",
}

#: Numbers that others have given to something: error codes, and places in files. And numbers that
#: only distinguish states.
NAMES_OF_OTHERS = (
    "base/interrupt.py:IN_PYTHON",
    "base/reasons.py:NOT_FINITE",
    "contact/bridged.py:CLOSED",
    "contact/bridged.py:NARROWLY_OPEN",
    "contact/bridged.py:OPEN",
    "linear/factors_again.py:OF_A_LIBRARY",
    "linear/saddle_factors.py:SHORT_OF_MEMORY",
    "remeshing/fill.py:LINE",
    "remeshing/fill.py:TETRAHEDRON",
    "remeshing/fill.py:TRIANGLE",
    "remeshing/mmg.py:SECTIONS",
    "solve/lost.py:_TRANSLATIONS",
    "solve/snes.py:LOST",
    "solve/snes.py:NOT_BALANCED",
    "solve/snes.py:NOT_CLOSED",
    "solve/snes.py:NO_PROGRESS",
    "solve/snes.py:OF_USER",
    "solve/snes.py:UNKNOWN_TYPE",
    "tools/stl.py:_START",
)

#: Constants whose change no quick test notices so far. The list may only become shorter.
WITHOUT = (
    "contact/between_nodes.py:UNEVEN",
    "contact/bridged.py:NARROW",
    "contact/conduction.py:NOTHING",
    "contact/coupling.py:STEP",
    "contact/creases.py:NOTICED",
    "contact/crossing.py:OUTSIDE",
    "contact/crossing.py:PATH",
    "contact/model.py:FOLLOWING_REACH",
    "contact/model.py:LEAST_PART",
    "contact/overclosed.py:FLAT",
    "contact/penalty.py:EXTREME",
    "contact/report.py:CLOSED",
    "contact/slid.py:NEARBY",
    "contact/soft_at_nodes.py:COARSE_MASTER",
    "contact/soft_at_nodes.py:STIFF",
    "contact/turned.py:NOTICED",
    "friction/dissipation.py:RIGID",
    "friction/filled.py:STEEP",
    "friction/slip.py:OF_RATES",
    "friction/slip.py:SAME_COVER",
    "gap/following.py:LEAST_CARRIED",
    "gap/following.py:LEAST_COVER",
    "gap/following.py:MOST_TURNED",
    "gap/overclosure.py:EVEN",
    "linear/hierarchy.py:STALE",
    "linear/multigrid.py:CONTACT_WEIGHT",
    "linear/presets.py:EXTRA_MEMORY",
    "linear/presets.py:GMRES_RESTART",
    "linear/presets.py:LARGE",
    "linear/presets.py:LARGE_FLOW",
    "linear/saddle.py:CRAWLING",
    "linear/saddle.py:SOFTEST",
    "linear/saddle_factors.py:MOST_MEMORY",
    "linear/soft_motions.py:SOFT",
    "linear/solver.py:INNER",
    "linear/solver.py:LARGEST",
    "linear/stop.py:EVERY",
    "pairing/ahead.py:DEEPEST",
    "pairing/ahead.py:INCLINED",
    "pairing/ahead.py:PARALLEL",
    "pairing/ahead.py:PRESSED_FLAT",
    "pairing/crossings.py:AT_END",
    "pairing/crossings.py:BENDS",
    "pairing/crossings.py:SAMPLED",
    "pairing/crossings.py:WAYS",
    "pairing/distance.py:BESIDE",
    "pairing/distance.py:DEGREE",
    "pairing/distance.py:OF_ITSELF",
    "remeshing/bounded.py:EXACT",
    "remeshing/bounded.py:SAMPLES",
    "remeshing/contact_values.py:LARGEST",
    "remeshing/features.py:FEW",
    "remeshing/features.py:ROUNDING",
    "remeshing/features.py:SHORT",
    "remeshing/fill.py:GOOD",
    "remeshing/fill.py:LEAST_QUALITY",
    "remeshing/lattice.py:SPACING",
    "remeshing/lattice.py:TURN",
    "remeshing/mmg.py:OFF",
    "remeshing/remesh.py:MOST_CELLS",
    "remeshing/remesh.py:VOLUME",
    "remeshing/respace.py:HALF",
    "remeshing/retriangulate.py:FEW",
    "remeshing/retriangulate.py:NEARLY_ONE",
    "remeshing/retriangulate.py:POOR",
    "remeshing/retriangulate.py:SAME_SIDE",
    "remeshing/transfer.py:ASIDE",
    "remeshing/transfer.py:LARGE",
    "remeshing/triangulation.py:OFF_LINE",
    "solve/at_once.py:MOST_OTHERS",
    "solve/balance.py:LITTLE",
    "solve/balance.py:MOST_REFINED",
    "solve/balance.py:RTOL_TOOLS",
    "solve/balance.py:SLOW",
    "solve/balance.py:SOME",
    "solve/balance.py:SPRINGS",
    "solve/continuation.py:FACTOR",
    "solve/continuation.py:SMALLEST_STEP",
    "solve/convergence.py:FLOWN",
    "solve/convergence.py:RESTING",
    "solve/convergence.py:ROUNDING",
    "solve/convergence.py:UNDEFORMED",
    "solve/first_guess.py:BALANCED",
    "solve/one_newton.py:AT_REST",
    "solve/one_newton.py:FALL",
    "solve/one_newton.py:MOST_ASKED",
    "solve/one_newton.py:MOST_SOFT",
    "solve/one_newton.py:POOR",
    "solve/one_newton.py:SMALL",
    "solve/one_newton.py:SOFT",
    "solve/onset.py:LEAST_SHARE",
    "solve/problem.py:MAX_RATES",
    "solve/stabilisation.py:VANISHING",
    "steps/hand_over.py:JUMP",
    "steps/pairings.py:FAR",
    "steps/pairings.py:FAR_FLOWING",
    "steps/pairings.py:FAR_TURNED",
    "steps/pairings.py:TURNED",
    "steps/stepper.py:MORE_PAIRINGS",
    "system/derivative.py:REGULAR",
    "system/equations.py:UNBALANCED",
    "system/friction_at_points.py:GUESSED",
    "tools/heights.py:OFF",
    "tools/touching.py:SAME_WALL",
)
