"""Time steps, checkpoints, restarts."""
