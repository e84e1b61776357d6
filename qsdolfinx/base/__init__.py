"""Common tools of all folders: argument checks, collective errors, timing, messages."""
