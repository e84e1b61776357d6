"""Linear solvers by name."""
