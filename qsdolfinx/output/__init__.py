"""Fields and histories in files."""
