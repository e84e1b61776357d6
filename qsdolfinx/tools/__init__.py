"""Rigid tools: surfaces without unknowns."""
