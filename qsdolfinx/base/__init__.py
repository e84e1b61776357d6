"""What every other folder uses: argument checks, collective errors, timing, messages."""
