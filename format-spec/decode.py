#!/usr/bin/env python3
"""Decodes a lodpack file. It is written from SPEC.md alone, to be read beside it and to check other decoders.

    python3 decode.py FILE              everything that the file holds as JSON, which vectors/README.md describes
    python3 decode.py --texels FILE     for each block with a map, the size of its images and their checksums
    python3 decode.py --cuts CUTS FILE  each cut that the file CUTS names, drawn by chapter 14 or 22.6: its counts and a
                                        checksum

Exits with code 0. For a damaged or non-conforming file it prints one line to stderr and exits with code 1.

This is plain Python 3.11 without packages: a module of `decoder` for each chapter of SPEC.md. It decodes the whole file
and checks every checksum and every *must* on the way; speed is no goal. Python's floats are binary64, and its operators
round every operation on its own, as chapter 2.2 demands. Its integers are unbounded.
"""

import sys

from decoder.main import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
