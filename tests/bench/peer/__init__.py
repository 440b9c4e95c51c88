"""The programs that bench.py and peers.py measure: how each is run, and what comes from it."""
