"""Write fields and histories to files."""
