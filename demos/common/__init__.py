"""Helpers that the demos share: command lines, pictures, tables and files, but no physics."""
