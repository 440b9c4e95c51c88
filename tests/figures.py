#!/usr/bin/env python3
"""Checks that figures which stand in several documents agree.

usage: figures.py [--root DIR]

Each row of FIGURES is one figure: where it stands, as the words around it with {} in its place, times a factor to its
unit. Two agree if one is the other, rounded to as many digits as it shows. Prints those that differ and words that are
not there any more (then a document was changed: change the row, too), and ends with 1 then."""
import argparse, pathlib, re, sys

README, READER, RESULTS, CLI = "README.md", "reader/README.md", "tests/RESULTS.md", "cli/README.md"
K = 1000
FIGURES = [
    ("triangles of the dragon", [(README, "The dragon scan ({} triangles;", 1), (RESULTS, "| dragon | {} | scan;", 1)]),
    ("triangles of snowden", [(README, "a real scan ({} triangles)", 1), (RESULTS, "| snowden | {} | scan with", 1)]),
    ("bytes of the dragon's file", [
        (README, "its file has {} kB", K),
        (README, "| **{} kB** | VTK + Nexus:", K),
        (RESULTS, "| dragon | {} | 1.", 1),
    ]),
    ("bytes of the dragon by VTK and Nexus", [
        (README, "VTK + Nexus: {} kB. One level", K),
        (RESULTS, "VTK + Nexus {} : 69,446 |", 1),
    ]),
    ("bytes of the dragon by VTK and Draco", [
        (README, "VTK + Draco {} kB, Draco alone", K),
        (RESULTS, "| bytes at equal RMS | **1.10** VTK + Draco {} :", 1),
    ]),
    ("triangles a CPU second, 8 M", [(README, "**{} triangles per CPU second**", 1), (RESULTS, "| lodpack | 14.8 | {} k |", K)]),
    ("the same of Nexus", [(README, "| Nexus {}; clusterlod", 1), (RESULTS, "| Nexus | 110.4 | {} k |", K)]),
    ("the same of clusterlod", [(README, "; clusterlod {}, which writes", 1), (RESULTS, "| clusterlod | 16.6 | {} k |", K)]),
    ("largest distance at 10 %", [(README, "**{} mean edges**, proven", 1), (RESULTS, "in mean edges: lodpack {}, mesh", 1)]),
    ("the same of meshoptimizer", [(README, "| meshoptimizer {}; quadric", 1), (RESULTS, ", meshoptimizer {}, quadric", 1)]),
    ("the same of quadrics", [
        (README, "quadric with optimal placement {};", 1), (RESULTS, "quadric with optimal placement {}, clusterlod", 1),
    ]),
    ("CPU seconds of 8 M in 512 MiB", [
        (README, "8 M: **{} CPU s, 331 MiB**", 1), (RESULTS, "| 8 M smooth, `--memory 512MiB` | 8,009,868 | {} |", 1),
    ]),
    ("CPU seconds of 128 M in 512 MiB", [
        (README, "; 128 M: {} CPU s,", 1), (RESULTS, "| 128 M smooth, `--memory 512MiB` | 128,001,072 | {} |", 1),
    ]),
    ("memory of 128 M", [(README, "128 M: 272 CPU s, {} MiB", 1), (RESULTS, "| 471 k | 1.04 | {} MiB |", 1)]),
    ("CPU seconds of Nexus in 512 MB", [
        (README, "8 M: {} CPU s, 396 MiB", 1), (RESULTS, "limited to 512 MB (its pyramid goes down to the input) | 8,009,868 | {} |", 1),
    ]),
    ("requests for a hundredth of the dragon", [
        (README, "**{} requests, 16 kB**", 1), (READER, "| dragon, a hundredth at the finest level | {} |", 1),
    ]),
    ("bytes of a hundredth of the dragon", [
        (README, "requests, {} kB**", K), (READER, "| dragon, a hundredth at the finest level | 4 | {} |", 1),
    ]),
    ("requests of Nexus", [(README, "Nexus: {} requests", 1), (READER, "| Nexus | 2,823,424 | {} |", 1)]),
    ("bytes of Nexus", [(README, "Nexus: 23 requests, {} kB;", K), (READER, "| Nexus | 2,823,424 | 23 | {} |", 1)]),
    ("bytes of VTK and Nexus", [
        (README, "that VTK simplified first: 7, {} kB", K), (READER, "| VTK + Nexus | 243,200 | 7 | {} |", 1),
    ]),
    ("colours at the finest level", [(README, "Textures show {} dB", 1), (RESULTS, "All have {} dB or more", 1)]),
    ("colours at a tenth", [(README, ", {} at a tenth", 1), (RESULTS, "finest level, {} dB at a tenth", 1)]),
    ("angle of triangles alone", [(CLI, "triangles alone are {} off", 1), (RESULTS, "| 70,208 | {},", 1)]),
    ("angle with an image of normals", [(CLI, "off, and {} at 3,062", 1), (RESULTS, "| 3,062 | 10.7, 20.2 | **{}**", 1)]),
    ("colours at a hundredth", [(README, ", {} at a hundredth", 1), (RESULTS, "triangles and {} dB at a hundredth", 1)]),
]
NUMBER = r"(\d[\d,]*(?:\.\d+)?|\.\d+)"


def found(text, words):
    """The number as it is written, or None."""
    before, after = (re.escape(part).replace(r"\ ", r"\s+") for part in words.split("{}"))
    match = re.search(before + NUMBER + after, text)
    return match and match[1]


def value_and_half_digit(written, factor):
    """What a number says, and half of its last digit that is shown; zeros at the end of a whole number may be
    rounded."""
    digits = written.replace(",", "")
    _, _, fraction = digits.partition(".")
    zeros = 0 if fraction else len(digits) - len(digits.rstrip("0"))
    return float(digits) * factor, 0.5 * factor * 10.0 ** (zeros - len(fraction))


def problems(texts):
    for what, places in FIGURES:
        seen = []
        for name, words, factor in places:
            written = found(texts[name], words)
            if written is None:
                yield f"{name}: {what}: there is no `{words}`"
            else:
                seen.append((name, written, *value_and_half_digit(written, factor)))
        for first, second in zip(seen, seen[1:]):
            if abs(first[2] - second[2]) > max(first[3], second[3]) * (1 + 1e-9):
                yield f"{what}: {first[0]} says {first[1]}, and {second[0]} says {second[1]}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=pathlib.Path, default=pathlib.Path(__file__).resolve().parent.parent)
    root = parser.parse_args().root
    names = {name for _, places in FIGURES for name, _, _ in places}
    texts = {name: (root / name).read_text(encoding="utf-8") for name in names}
    different = list(problems(texts))
    print("\n".join(different) or f"{len(FIGURES)} figures stand in several documents and agree")
    sys.exit(1 if different else 0)


if __name__ == "__main__":
    main()
