"""Contact of two surfaces: its terms in the equations, and its results."""
