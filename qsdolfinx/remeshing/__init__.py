"""Remeshing of deformed bodies, and transfer of fields and history variables."""
