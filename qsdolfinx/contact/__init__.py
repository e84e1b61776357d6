"""Contact of two surfaces: its terms in the equations, and what there is to read of it."""
