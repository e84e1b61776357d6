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
    Changed("contact/model.py:BEYOND_REACH", (0.5,), ("contact/test_law_signs.py::test_peeling",)),
    Changed(
        "contact/passed.py:THIN",
        (0.01,),
        ("contact/test_passing.py::test_sheet_of_a_twohundredth_of_a_facet",),
    ),
    Changed("contact/slid.py:TURNS", (3.0,), ("contact/test_turned.py::test_turned_in_a_solve",)),
    Changed(
        "contact/tool_corners.py:CARRIED",
        (2.0,),
        ("sliding/test_tool_corners.py::test_loaded_corner",),
    ),
    Changed(
        "contact/tool_corners.py:CORNER",
        (1.5,),
        ("sliding/test_tool_corners.py::test_deep_corner",),
    ),
    Changed(
        "contact/tool_corners.py:DEEP", (1.0,), ("sliding/test_tool_corners.py::test_deep_corner",)
    ),
    Changed(
        "contact/tool_corners.py:FINER",
        (0.9,),
        ("sliding/test_tool_corners.py::test_deep_corner",),
    ),
    Changed(
        "contact/tool_corners.py:NARROW",
        (0.01, 2.0),
        (
            "sliding/test_tool_corners.py::test_deep_corner",
            "sliding/test_tool_corners.py::test_wide_contact",
        ),
    ),
    Changed(
        "contact/tool_corners.py:ROUNDED",
        (0.5,),
        ("sliding/test_tool_corners.py::test_loaded_corner",),
    ),
    Changed(
        "contact/tool_corners.py:UNMOVED",
        (10.0,),
        ("sliding/test_tool_corners.py::test_deep_corner",),
    ),
    Changed(
        "contact/turned.py:MISDIRECTED",
        (1e-9, 3.0),
        (
            "contact/test_turned.py::test_turned_a_little",
            "contact/test_turned.py::test_turned_in_a_solve",
        ),
    ),
    Changed(
        "gap/law_samples.py:ALIKE",
        (1e6,),
        ("contact/test_law_signs.py::test_wrong_law",),
    ),
    Changed("gap/law_samples.py:ENDED", (0.9,), ("contact/test_law_signs.py::test_peeling",)),
    Changed(
        "contact/between_nodes.py:BETWEEN",
        (0.8,),
        ("contact/test_between_nodes.py::test_edge_without_a_force",),
    ),
    Changed(
        "contact/between_nodes.py:UNEVEN",
        (0.0,),
        ("contact/test_between_nodes.py::test_nothing_to_warn_of",),
    ),
    Changed(
        "contact/bridged.py:NARROW",
        (1e-09,),
        ("contact/test_bridged.py::test_they_slip_as_their_neighbours",),
    ),
    Changed(
        "contact/conduction.py:NOTHING",
        (10.0,),
        ("contact/test_scalar.py::test_gaps_beyond_the_search_radius",),
    ),
    Changed("contact/coupling.py:STEP", (0.1, 1e-15), ("contact/test_scalar.py::test_tangent",)),
    Changed(
        "contact/creases.py:NOTICED", (2.0,), ("sliding/test_deep_edges.py::test_between_nodes",)
    ),
    Changed(
        "contact/crossing.py:OUTSIDE",
        (-1.0,),
        ("contact/test_reach.py::test_what_has_passed_through_counts",),
    ),
    Changed(
        "contact/held.py:MOST",
        (9.0,),
        ("contact/test_held.py::test_a_quarter_is_a_quarter_of_the_whole",),
    ),
    Changed(
        "contact/model.py:FOLLOWING_REACH",
        (1.0, 40.0),
        ("contact/test_penalty.py::test_search_distance",),
    ),
    Changed(
        "contact/model.py:LEAST_PART",
        (1e-05, 0.1),
        ("contact/test_penalty.py::test_penalties_that_are_as_soft_as_multipliers",),
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
        "contact/overclosed.py:FLAT", (10.0,), ("gap/test_overclosed_sliding.py::test_uneven",)
    ),
    Changed(
        "contact/penalty.py:AUGMENTED_FACTORS",
        ({False: 1.0, True: 3.0}, {False: 10.0, True: 30.0}),
        ("contact/test_penalty.py::test_ratios",),
    ),
    Changed(
        "contact/penalty.py:EXTREME",
        (1000000000.0,),
        ("contact/test_report.py::test_conditioning_of_direct_solvers",),
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
        "contact/slid.py:NEARBY",
        (0.05, 5.0),
        (
            "gap/test_overclosed_sliding.py::test_a_round_tool_slides",
            "gap/test_overclosed_sliding.py::test_uneven",
        ),
    ),
    Changed(
        "contact/soft_at_nodes.py:COARSE_MASTER",
        (0.05, 6.0),
        ("contact/test_warnings.py::test_soft_penalty_at_nodes_of_a_finer_slave",),
    ),
    Changed(
        "contact/soft_at_nodes.py:STIFF",
        (0.01, 10000.0),
        ("contact/test_warnings.py::test_soft_penalty_at_nodes_of_a_finer_slave",),
    ),
    Changed(
        "contact/turned.py:NOTICED", (10.0,), ("steps/test_ties.py::test_rings_turned_by_hand",)
    ),
    Changed(
        "friction/dissipation.py:RIGID",
        (0.001,),
        ("friction/test_dissipation.py::test_row_that_leaves",),
    ),
    Changed(
        "friction/filled.py:STEEP", (0.001,), ("friction/test_friction_at_points.py::test_restart",)
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
        "friction/slip.py:SAME_COVER",
        (10.0,),
        ("friction/test_dissipation.py::test_energy_under_an_edge",),
    ),
    Changed(
        "gap/facet_cutter.py:SKIN",
        (0.1,),
        ("sliding/test_kept_pairs.py::test_block_dragged_in_steps",),
    ),
    Changed(
        "gap/following.py:MOST_TURNED",
        (1.0, 3.14159),
        ("gap/test_arcs.py::test_arcs", "gap/test_arcs.py::test_half_a_turn"),
    ),
    Changed("gap/turning.py:STEP", (0.1, 1e-320), ("gap/test_tie_across_gap.py::test_derivative",)),
    Changed("gap/overclosure.py:EVEN", (0.9,), ("gap/test_overclosed_sliding.py::test_uneven",)),
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
        (0.001, 0.3),
        ("linear/test_tolerances.py::test_solves_before_the_last_one",),
    ),
    Changed(
        "linear/krylov.py:NEAR",
        (1e-08, 0.001),
        ("linear/test_tolerances.py::test_one_solve_where_two_take_longer",),
    ),
    Changed(
        "linear/krylov.py:UNCHANGED",
        (1e-6, 1e-3),
        ("linear/test_tolerances.py::test_ties_that_move",),
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
    Changed(
        "system/symmetry.py:SAME",
        (1e-18, 1.0),
        ("linear/test_multigrid.py::test_storage_of_a_soft_part",),
    ),
    Changed(
        "system/consistent_mass.py:LESS_LUMPED",
        (1.0, 200.0),
        ("linear/test_consistent_mass.py::test_fewer_iterations",),
    ),
    Changed(
        "linear/multigrid.py:CONTACT_WEIGHT",
        (30.0,),
        ("linear/test_presets.py::test_multigrid_over_the_size",),
    ),
    Changed("linear/presets.py:EXACT", (1e-10, 1e-06), ("linear/test_tolerances.py::test_bounds",)),
    Changed(
        "linear/presets.py:EXTRA_MEMORY",
        (10, 1000),
        ("linear/test_tolerances.py::test_memory_for_factors",),
    ),
    Changed(
        "linear/presets.py:GMRES_RESTART",
        (10, 1000),
        ("linear/test_tolerances.py::test_inner_solver",),
    ),
    Changed(
        "linear/presets.py:LARGE",
        ({2: 1000, 3: 2500}, {2: 1000000, 3: 250}),
        ("linear/test_tolerances.py::test_which_solver",),
    ),
    Changed(
        "linear/presets.py:LARGE_FLOW",
        ({2: 1000, 3: 10000}, {2: 1000000, 3: 1000}),
        ("linear/test_tolerances.py::test_which_solver",),
    ),
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
        "linear/soft_motions.py:SOFT",
        (1e-15,),
        ("linear/test_soft_motions.py::test_only_where_they_are_free",),
    ),
    Changed(
        "linear/solver.py:INNER", (0.001, 0.1), ("linear/test_tolerances.py::test_inner_solver",)
    ),
    Changed(
        "linear/solver.py:LARGEST",
        ({2: 200000, 3: 200000}, {2: 2000000, 3: 2000000}),
        ("linear/test_tolerances.py::test_factors_that_fit_into_memory",),
    ),
    Changed(
        "linear/solver.py:MAX_FAILURES",
        (2, 20),
        ("linear/test_tolerances.py::test_a_direct_solver_takes_over_for_a_while",),
    ),
    Changed(
        "linear/stop.py:EVERY",
        (1, 50),
        ("linear/test_tolerances.py::test_interrupts_are_looked_for",),
    ),
    Changed("pairing/ahead.py:DEEPEST", (0.05, 5.0), ("pairing/test_inclined.py::test_far_sides",)),
    Changed("pairing/ahead.py:INCLINED", (0.1, 1.0), ("pairing/test_inclined.py::test_towards",)),
    Changed("pairing/ahead.py:PARALLEL", (0.0001, 0.1), ("pairing/test_inclined.py::test_flat",)),
    Changed(
        "pairing/ahead.py:PRESSED_FLAT",
        (0.99999, 0.9),
        ("pairing/test_inclined.py::test_pressed_flat",),
    ),
    Changed(
        "pairing/crossings.py:AT_END",
        (1e-9, 0.45),
        (
            "contact/test_edges.py::test_crossings_near_nodes",
            "contact/test_edges_of_tools.py::test_turned_edge",
        ),
    ),
    Changed(
        "pairing/crossings.py:BENDS", (50.0,), ("contact/test_edges.py::test_between_crossings",)
    ),
    Changed(
        "pairing/crossings.py:SAMPLED", (10.0,), ("sliding/test_deep_edges.py::test_between_nodes",)
    ),
    Changed(
        "pairing/crossings.py:WAYS", (2000.0,), ("contact/test_edges_of_tools.py::test_steep_wall",)
    ),
    Changed(
        "pairing/distance.py:BESIDE",
        (0.001,),
        ("pairing/test_depth.py::test_points_beside_a_corner",),
    ),
    Changed(
        "pairing/distance.py:DEGREE",
        (0, 20),
        ("pairing/test_depth.py::test_several_points_of_a_facet",),
    ),
    Changed(
        "pairing/distance.py:OF_ITSELF", (2,), ("contact/test_itself.py::test_depth_at_a_tip",)
    ),
    Changed(
        "pairing/pair.py:LEAST_COVER",
        (1.0,),
        ("gap/test_hardly_covered.py::test_multipliers_are_pressures",),
    ),
    Changed(
        "remeshing/bounded.py:EXACT",
        (0.01,),
        ("remeshing/test_transfer.py::test_values_in_cells_stay_in_bounds_and_keep_integrals",),
    ),
    Changed(
        "remeshing/bounded.py:SAMPLES",
        (1,),
        ("remeshing/test_transfer.py::test_large_cells_have_the_means_of_small_ones",),
    ),
    Changed(
        "remeshing/contact_values.py:LARGEST",
        (1.0, 15.0),
        ("remeshing/test_surface_values.py::test_moderate_corrections",),
    ),
    Changed(
        "remeshing/features.py:FEW",
        (1, 1000),
        ("remeshing/test_triangulation.py::test_planes_of_many_triangles",),
    ),
    Changed(
        "remeshing/features.py:ROUNDING",
        (1e-18, 0.001),
        ("remeshing/test_triangulation.py::test_levels_of_planes",),
    ),
    Changed(
        "remeshing/features.py:SHORT",
        (1.0, 4.0),
        ("remeshing/test_triangulation.py::test_short_lines_are_noise",),
    ),
    Changed(
        "remeshing/fill.py:LEAST_QUALITY",
        (0.0001, 0.5),
        ("remeshing/test_triangulation.py::test_flat_cells_are_refused",),
    ),
    Changed(
        "remeshing/lattice.py:SPACING",
        (1e-13, 0.1),
        ("remeshing/test_triangulation.py::test_lattice",),
    ),
    Changed(
        "remeshing/lattice.py:TURN", (0.5, 1.0), ("remeshing/test_triangulation.py::test_lattice",)
    ),
    Changed(
        "remeshing/remesh.py:MOST_CELLS",
        (2000000000000.0,),
        ("remeshing/test_strangers.py::test_refused",),
    ),
    Changed(
        "remeshing/remesh.py:SIZES",
        ((1.0,), (0.5, 1.0)),
        ("remeshing/test_remesh.py::test_the_worst_cell_is_as_wanted",),
    ),
    Changed(
        "remeshing/remesh.py:VOLUME",
        (1e-5, 1e-3),
        ("remeshing/test_remesh.py::test_volume_that_cannot_be_restored",),
    ),
    Changed(
        "remeshing/respace.py:HALF",
        (0.0001, 0.1),
        ("remeshing/test_triangulation.py::test_number_of_segments",),
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
        "remeshing/retriangulate.py:NEARLY_ONE",
        (0.0001, 0.9),
        ("remeshing/test_triangulation.py::test_nodes_on_two_planes",),
    ),
    Changed(
        "remeshing/retriangulate.py:STEP",
        (3.0,),
        ("remeshing/test_remesh.py::test_ten_times_in_a_row",),
    ),
    Changed(
        "remeshing/transfer.py:ASIDE",
        (3.0,),
        ("remeshing/test_transfer.py::test_values_in_cells_stay_in_bounds_and_keep_integrals",),
    ),
    Changed(
        "remeshing/triangulation.py:LEAST_SHAPE",
        (0.9,),
        ("remeshing/test_triangulation.py::test_short_edges_are_collapsed",),
    ),
    Changed(
        "remeshing/triangulation.py:LONG",
        (0.8, 3.0),
        ("remeshing/test_triangulation.py::test_long_edges_are_split",),
    ),
    Changed(
        "remeshing/triangulation.py:OFF_LINE",
        (0.0,),
        ("remeshing/test_triangulation.py::test_lines_keep_their_shape",),
    ),
    Changed(
        "remeshing/triangulation.py:SHORT",
        (0.2,),
        ("remeshing/test_triangulation.py::test_short_edges_are_collapsed",),
    ),
    Changed(
        "remeshing/triangulation.py:TURNS",
        (-1.0, 0.9999),
        (
            "remeshing/test_triangulation.py::test_coarse_surfaces_keep_their_shape",
            "remeshing/test_triangulation.py::test_short_edges_are_collapsed",
        ),
    ),
    Changed(
        "solve/at_once.py:MOST_OTHERS", (0,), ("sliding/test_vertices.py::test_pad_with_walls",)
    ),
    Changed(
        "solve/balance.py:LITTLE",
        (1e-06, 1.0),
        ("solve/test_regularisation.py::test_far_from_a_solution",),
    ),
    Changed(
        "solve/balance.py:RTOL_TOOLS",
        (1e-20,),
        ("solve/test_tool_balance.py::test_friction_that_sticks",),
    ),
    Changed(
        "solve/balance.py:SLOW",
        (0.05, 5.0),
        ("solve/test_regularisation.py::test_residuals_that_fall_slowly",),
    ),
    Changed(
        "solve/balance.py:SOME",
        (1, 60),
        ("solve/test_regularisation.py::test_residuals_that_fall_slowly",),
    ),
    Changed(
        "solve/balance.py:SPRINGS",
        (1e-07, 0.1),
        ("solve/test_regularisation.py::test_springs_of_unsupported_bodies",),
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
        "solve/continuation.py:FACTOR",
        (1.2, 40.0),
        ("solve/test_continuation_steps.py::test_factors",),
    ),
    Changed(
        "solve/continuation.py:SMALLEST_STEP",
        (0.5, 0.0001),
        ("solve/test_continuation_steps.py::test_steps_that_fail",),
    ),
    Changed(
        "solve/convergence.py:FLOWN",
        (1.0, 1000000000000.0),
        ("solve/test_small_loads.py::test_sizes_of_displacements",),
    ),
    Changed(
        "solve/convergence.py:RESTING",
        (1e-20,),
        ("solve/test_small_loads.py::test_moved_far",),
    ),
    Changed(
        "solve/convergence.py:ROUNDING",
        (1000000000.0,),
        ("solve/test_small_loads.py::test_rounding_does_not_end_other_solves",),
    ),
    Changed(
        "solve/convergence.py:UNDEFORMED",
        (1e-08, 0.1),
        ("solve/test_small_loads.py::test_sizes_of_displacements",),
    ),
    Changed(
        "solve/first_guess.py:BALANCED",
        (1000000000.0,),
        ("solve/test_first_guess.py::test_rests_at_once",),
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
        "solve/one_newton.py:MAX_HALVINGS", (1,), ("solve/test_viscoplastic.py::test_sticking",)
    ),
    Changed(
        "solve/one_newton.py:FAR_OFF",
        (1e6,),
        ("problems/test_leaf_spring.py::test_two_leaves",),
    ),
    Changed(
        "solve/one_newton.py:SOFT",
        ((1.0, 1.0),),
        ("problems/test_leaf_spring.py::test_two_leaves",),
    ),
    Changed(
        "solve/onset.py:LEAST_SHARE",
        (0.9,),
        ("friction/test_first_contact.py::test_steps_in_which_bodies_meet",),
    ),
    Changed(
        "solve/snap_through.py:CORRECTED",
        (2.0,),
        (
            "problems/test_rubber.py::test_roller",
            "steps/test_snap_through.py::test_arch_under_a_force",
        ),
    ),
    Changed(
        "solve/snap_through.py:OF_STORED",
        (1.0,),
        (
            "sliding/test_leaning.py::test_pressed_and_dragged",
            "steps/test_snap_through.py::test_arch_under_a_force",
        ),
    ),
    Changed(
        "solve/snap_through.py:OF_STORED_BEYOND",
        (0.2,),
        (
            "sliding/test_turning.py::test_without_friction",
            "steps/test_snap_through.py::test_snap_back",
        ),
    ),
    Changed(
        "solve/snap_through.py:OF_WORK",
        (1.0,),
        ("steps/test_snap_through.py::test_arch_under_a_force",),
    ),
    Changed(
        "solve/stabilisation.py:VANISHING",
        (1e-06, 1.0),
        ("solve/test_regularisation.py::test_stabilisation_by_default",),
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
    Changed(
        "solve/watchdog.py:CLOSE",
        (1.0,),
        ("solve/test_watchdog.py::test_full_steps_and_returns",),
    ),
    Changed(
        "solve/watchdog.py:PATIENCE",
        (20,),
        ("solve/test_watchdog.py::test_sharp_punch_that_is_dragged",),
    ),
    Changed(
        "solve/watchdog.py:SHORT",
        (0.02,),
        ("solve/test_watchdog.py::test_sharp_punch_that_is_dragged",),
    ),
    Changed(
        "solve/watchdog.py:TRIAL",
        (1,),
        ("solve/test_watchdog.py::test_sharp_punch_that_is_dragged",),
    ),
    Changed(
        "steps/hand_over.py:JUMP",
        (1e-09,),
        ("remeshing/test_steps.py::test_a_jump_of_forces_is_told",),
    ),
    Changed("steps/pairings.py:FAR", (0.005, 0.5), ("steps/test_pairs_again.py::test_sliding",)),
    Changed(
        "steps/pairings.py:FAR_FLOWING", (0.05, 2.5), ("steps/test_pairs_again.py::test_sliding",)
    ),
    Changed(
        "steps/pairings.py:FAR_TURNED", (0.002, 0.2), ("steps/test_pairs_again.py::test_rotation",)
    ),
    Changed("steps/pairings.py:TURNED", (0.001, 0.1), ("steps/test_pairs_again.py::test_ties",)),
    Changed("steps/prediction.py:NOTHING", (1e-05,), ("steps/test_swinging.py::test_what_swings",)),
    Changed(
        "steps/stepper.py:MORE_PAIRINGS",
        (0,),
        ("steps/test_large_steps.py::test_blocks_that_turn_together",),
    ),
    Changed("surface/facets.py:SHARP", (1.5,), ("tools/test_elevate.py::test_unstructured",)),
    Changed(
        "system/condensed_rows.py:PROXIMAL",
        (1e-08, 0.01),
        ("solve/test_regularisation.py::test_points_are_compliant_far_from_a_solution",),
    ),
    Changed(
        "system/derivative.py:REGULAR",
        (1e-14, 1e-08),
        ("solve/test_regularisation.py::test_springs_of_unsupported_bodies",),
    ),
    Changed(
        "system/equations.py:UNBALANCED",
        (1000.0,),
        ("system/test_equations.py::test_what_the_caller_gives",),
    ),
    Changed(
        "system/estimated_degree.py:FEW",
        (10_000, 1_000_000),
        (
            "system/test_compiling.py::test_estimated_degree",
            "system/test_compiling.py::test_degree_that_does_not_matter",
        ),
    ),
    Changed(
        "system/estimated_degree.py:WASTE",
        (2.0, 200.0),
        (
            "system/test_compiling.py::test_estimated_degree",
            "system/test_compiling.py::test_degree_that_does_not_matter",
        ),
    ),
    Changed(
        "system/friction_at_points.py:GUESSED", (1000.0,), ("sliding/test_points.py::test_guess",)
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
    Changed("tools/heights.py:OFF", (100.0,), ("tools/test_elevate.py::test_refused",)),
    Changed(
        "tools/smooth.py:ITERATIONS",
        (3,),
        ("gap/test_curved_facets.py::test_fit_of_cones_in_any_direction",),
    ),
    Changed("tools/touching.py:SAME_WALL", (0.35,), ("tools/test_touching.py::test_walls",)),
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
    "solve/snes.py:LAW_NOT_FINITE",
    "solve/snes.py:LOST",
    "solve/snes.py:NOT_BALANCED",
    "solve/snes.py:NOT_CLOSED",
    "solve/snes.py:NO_PROGRESS",
    "solve/snes.py:OF_USER",
    "solve/snes.py:UNKNOWN_TYPE",
    "tools/stl.py:_START",
)
