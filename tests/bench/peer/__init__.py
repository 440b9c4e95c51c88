"""The programs that bench.py and peers.py measure: how to run each, and its results."""
