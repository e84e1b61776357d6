"""Presets of linear solvers by name, and the automatic choice."""

from __future__ import annotations

import typing

#: Memory (%) beyond MUMPS' estimate, relative to this. Delayed pivots, such as those of the
#: pressure in incompressible flow, need more memory; on several ranks the amount also depends on
#: timing.
EXTRA_MEMORY = 100

#: Relative tolerance of a linear solve outside Newton's method, and the smallest tolerance of any
#: solve: with less than some 1e-13, rounding would keep it from being reached.
EXACT, TIGHTEST = 1e-8, 1e-12

#: Aggregation with the rigid modes. Without smoothed prolongators its set-up costs a fifth. The
#: W-cycle compensates for the lack of smoothing, and for contact, which is stiff compared with the
#: coarse levels.
AGGREGATION: dict[str, typing.Any] = {
    "pc_type": "gamg",
    "pc_gamg_agg_nsmooths": 0,
    "pc_gamg_threshold": 0.02,
    "pc_gamg_aggressive_coarsening": 1,
    "pc_gamg_coarse_eq_limit": 1000,
    "pc_mg_cycle_type": "w",
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_pc_type": "jacobi",
}

#: Options below the first coarse matrix, on which two W-cycles are made. Sweeps cost little there.
_BELOW = AGGREGATION | {
    "ksp_type": "richardson",
    "ksp_max_it": 2,
    "ksp_norm_type": "none",
    "pc_gamg_aggressive_coarsening": 0,
    "pc_gamg_reuse_interpolation": True,
    "mg_levels_ksp_max_it": 4,
}

#: Prefix of the options of each body's first coarsening, after the problem's.
FIRST = "aggregation_"

#: Options of this coarsening alone; no systems are solved with its matrices.
_FIRST = AGGREGATION | {
    "pc_gamg_parallel_coarse_grid_solver": True,  # otherwise the whole matrix moves to one rank
    "mg_levels_ksp_type": "richardson",
    "mg_levels_pc_type": "none",
    "mg_coarse_ksp_type": "preonly",
    "mg_coarse_pc_type": "none",
}

#: :class:`qsdolfinx.linear.multigrid.Multigrid`.
_TWO_LEVELS: dict[str, typing.Any] = {
    "pc_type": "mg",
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_ksp_max_it": 2,
    "mg_levels_pc_type": "jacobi",
}
_TWO_LEVELS |= {f"mg_coarse_{key}": value for key, value in _BELOW.items()}
_TWO_LEVELS |= {FIRST + key: value for key, value in _FIRST.items()}

#: Options of all iterative presets for displacements.
KRYLOV: dict[str, typing.Any] = {
    "ksp_type": "cg",  # GMRES where the tangent is not symmetric
    "ksp_rtol": EXACT,  # between Newton steps; in them it depends on the residual
    "ksp_max_it": 1000,  # then a direct solver is the fallback
}

#: Iterations to EXACT in the time of a direct solver, for this number of unknowns. The number of
#: iterations grows with the third root of the number of unknowns.
PATIENCE, PATIENCE_AT = 100, 5_000

#: Number of iterations after which GMRES restarts. With few, it stagnates; each takes a vector of
#: memory.
GMRES_RESTART = 100

#: Prefixes of the options of the velocities' multigrid and of the pressures, after the problem's.
VELOCITY, PRESSURE = "velocity_", "pressure_"

#: :class:`qsdolfinx.linear.schur.Schur`.
_SCHUR: dict[str, typing.Any] = {
    "ksp_type": "fgmres",
    "ksp_rtol": EXACT,
    "ksp_gmres_restart": GMRES_RESTART,
    "ksp_max_it": 500,  # a step that needs more is unreliable, and better damped
    "pc_type": "python",
    # A mass matrix, for which a few Chebyshev steps are accurate enough.
    "pressure_ksp_type": "chebyshev",
    "pressure_ksp_max_it": 4,
    "pressure_ksp_norm_type": "none",
    "pressure_pc_type": "jacobi",
}
#: With the pressures, fewer sweeps on coarse levels are enough, but varying viscosities need more
#: smoothing.
_VELOCITY = _TWO_LEVELS | {
    "mg_coarse_mg_levels_ksp_max_it": 2,
    "mg_levels_ksp_max_it": 4,
    f"{FIRST}pc_gamg_agg_nsmooths": 1,
}
_SCHUR |= {VELOCITY + key: value for key, value in _VELOCITY.items()}

PRESETS: dict[str, dict[str, typing.Any]] = {
    "direct": {
        "ksp_type": "preonly",
        "pc_type": "lu",
        "pc_factor_mat_solver_type": "mumps",
        "mat_mumps_icntl_14": EXTRA_MEMORY,
    },
    "amg": KRYLOV | _TWO_LEVELS,
    # One V-cycle for each body, forward and backward over the bodies.
    "fieldsplit": KRYLOV
    | {"pc_type": "fieldsplit", "pc_fieldsplit_type": "symmetric_multiplicative"},
    "schur": _SCHUR,
}

#: Presets whose Krylov solver is prepared by :class:`qsdolfinx.linear.krylov.Krylov`.
ITERATIVE = ("amg", "fieldsplit", "schur")

#: Options of each body's block with "fieldsplit", after "fieldsplit_I_".
BLOCK: dict[str, typing.Any] = {"ksp_type": "preonly"} | AGGREGATION

#: Number of unknowns from which multigrid is chosen, by dimension of space: it is faster above. See
#: ``bench/solvers.py``.
LARGE = {2: 1_000_000, 3: 2_500}

#: The same number for velocity–pressure bodies and "schur", by dimension; without unknowns inside
#: cells.
LARGE_FLOW = {2: 1_000_000, 3: 10_000}


def patience(unknowns: int) -> int:
    """Iterations after which a direct solver would have been faster, for "auto"."""
    return round(PATIENCE * max(1.0, unknowns / PATIENCE_AT) ** (1 / 3))


def pick(
    unknowns: int,
    dim: int,
    has_modes: bool,
    kind: str,
    is_flow: bool = False,
) -> tuple[str, str]:
    """Choose the preset for a problem; returns its name and the reason.

    Args:
        unknowns: Number of unknowns, over all ranks; for flow without unknowns inside cells.
        dim: Dimension of space.
        has_modes: Whether all bodies have displacements or velocities only.
        kind: ``"mpi"`` or ``"nest"``, the matrix that the solver sees.
        is_flow: Whether there are velocity–pressure bodies, for ``"schur"``.
    """
    if is_flow and kind == "mpi":
        large = LARGE_FLOW[dim]
        if unknowns < large:
            return "direct", f"{unknowns} unknowns of flow in {dim}D are fewer than {large}"
        reason = f"{unknowns} unknowns of velocity and pressure in {dim}D, bubbles aside, are"
        return "schur", f"{reason} {large} or more"
    if not has_modes:
        return "direct", "a body has other unknowns than displacements"
    what, large = f"{unknowns} unknowns in {dim}D are", LARGE[dim]
    if unknowns < large:
        return "direct", f"{what} fewer than {large}"
    return "amg" if kind == "mpi" else "fieldsplit", f"{what} {large} or more"
