"""The weighted gap at the slave's nodes, and the laws that turn it into multipliers."""
