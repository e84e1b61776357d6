"""PETSc options of the linear solver ``"schur"``."""

from __future__ import annotations

import typing

#: Of the velocities: ``qsdolfinx.linear.schur_velocity``, with multigrid on what bubbles leave.
_VELOCITY: dict[str, typing.Any] = {
    "ksp_type": "preonly",
    "pc_type": "python",
    "vertices_pc_type": "gamg",
    "vertices_pc_gamg_threshold": 0.02,
    "vertices_pc_gamg_aggressive_coarsening": 1,
    "vertices_mg_levels_ksp_type": "chebyshev",
    # Aggregates of two nodes leave zeros on the diagonal, which others divide by.
    "vertices_mg_levels_pc_type": "jacobi",
}

#: Of the pressures: a mass matrix, on which a few steps of Chebyshev's are exact enough.
_PRESSURE: dict[str, typing.Any] = {
    "ksp_type": "preonly",
    "pc_type": "ksp",  # a KSP right here would iterate on the Schur complement itself
    "ksp_ksp_type": "chebyshev",
    "ksp_ksp_max_it": 4,
    "ksp_ksp_norm_type": "none",
    "ksp_pc_type": "jacobi",
}

SCHUR: dict[str, typing.Any] = {
    "ksp_type": "fgmres",
    "ksp_rtol": 1e-8,
    "ksp_gmres_restart": 100,
    "ksp_max_it": 500,  # a step that asks for more is a wild one, and better damped
    "pc_type": "fieldsplit",
    "pc_fieldsplit_type": "schur",
    "pc_fieldsplit_schur_fact_type": "upper",
}
SCHUR |= {f"fieldsplit_velocity_{key}": value for key, value in _VELOCITY.items()}
SCHUR |= {f"fieldsplit_pressure_{key}": value for key, value in _PRESSURE.items()}
