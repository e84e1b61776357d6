"""What the demos share beside their physics: command lines, pictures, tables, files."""
