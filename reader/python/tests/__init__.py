"""Tests of the package, as it is installed: `reader/python/run` makes the wheel and installs it into an empty
folder."""
