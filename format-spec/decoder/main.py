"""The program decode.py."""

import json
import sys

from .ch02_conventions import Damaged
from .ch04_header import Header, HEIGHTS, read_sections
from .ch22_heights import Heights
from .file import File
from .text import print_cuts, print_heights, print_heights_cuts, print_json, print_texels

USAGE = "usage: decode.py [--texels | --cuts CUTS] FILE"


def main(arguments):
    texels = arguments[:1] == ["--texels"]
    cuts = arguments[1] if arguments[:1] == ["--cuts"] and len(arguments) == 3 else None
    names = arguments[1:] if texels else arguments[2:] if cuts else arguments
    if len(names) != 1 or names[0].startswith("--"):
        print(USAGE, file=sys.stderr)
        return 2
    try:
        with open(names[0], "rb") as source:
            data = source.read()
        if cuts:
            with open(cuts, "rb") as source:
                cuts = json.load(source)
        header = Header(data)
        sections = read_sections(data, header)
        if HEIGHTS in sections:
            heights = Heights(header, sections)
            print_heights_cuts(heights, cuts, sys.stdout) if cuts else print_heights(heights, sys.stdout)
        elif cuts:
            print_cuts(File(data), cuts, sys.stdout)
        else:
            (print_texels if texels else print_json)(File(data), sys.stdout)
    except (Damaged, OSError) as error:
        print(f"{names[0]}: {error}", file=sys.stderr)
        return 1
    return 0
