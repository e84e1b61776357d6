"""Weighted gap at the nodes of the slave, and the contact laws that give its multipliers."""
