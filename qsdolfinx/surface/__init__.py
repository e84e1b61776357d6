"""Contact surfaces: facets of a body's boundary with the unknowns of their trace."""
