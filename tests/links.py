#!/usr/bin/env python3
"""Checks that what the documents point to is there.

usage: links.py [--root DIR]

Of every *.md file: relative links lead to a file or folder, anchors to a heading, and paths in backticks to a file,
seen from the repository's root or from the document, and a contents list names every heading of the second rank. Of
every source: the Markdown documents that its comments cite are in the repository. Prints what is not there, and ends
with 1 then. Addresses on the web are not followed."""
import argparse
import functools
import pathlib
import re
import sys

SKIPPED = {".git", "target", "work-data", "__pycache__", "node_modules"}
SOURCES = {".rs", ".py", ".sh", ".toml", ".wgsl", ".cpp", ".js"}
# With such an ending, or beginning with a folder of the root, a path in backticks is one of ours.
FILE = re.compile(r"^[\w.-]+(/[\w.-]+)*/[\w.-]+\.(rs|py|sh|md|toml|csv|svg|png|cpp|wgsl)$")
PATH = re.compile(r"^\.?[\w-][\w.-]*(/[\w.-]+)+/?$")


def files(root):
    """Every file that belongs to the repository. What builds and tests make beside them may vanish at any time."""
    try:
        paths = sorted(root.iterdir())
    except FileNotFoundError:
        return
    for path in paths:
        if path.name not in SKIPPED:
            yield from files(path) if path.is_dir() and not path.is_symlink() else [path]


def still_there(problems):
    """All problems of a file, or none if the file has gone meanwhile."""
    try:
        return list(problems)
    except FileNotFoundError:
        return []


def prose(text):
    """The lines of a document without code blocks, numbered from 1."""
    fence = None
    for number, line in enumerate(text.splitlines(), 1):
        mark = re.match(r"\s*(```+|~~~+)", line)
        if mark and fence is None:
            fence = mark.group(1)
        elif mark and mark.group(1).startswith(fence):
            fence = None
        elif fence is None:
            yield number, line


@functools.cache
def anchors(path):
    """The anchors of a document's headings, as GitHub makes them."""
    found, counts = set(), {}
    for _, line in prose(path.read_text()):
        heading = re.match(r"#{1,6}\s+(.*?)\s*#*$", line)
        if heading:
            words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading.group(1)).lower()
            slug = re.sub(r"[^\w\- ]", "", words).replace(" ", "-")
            counts[slug] = counts.get(slug, -1) + 1
            found.add(f"{slug}-{counts[slug]}" if counts[slug] else slug)
    return found


def check_document(root, path):
    for number, line in prose(path.read_text()):
        where = f"{path.relative_to(root)}:{number}"
        for target in re.findall(r"\]\(([^()\s]+)\)", re.sub(r"`[^`]*`", "", line)):
            if re.match(r"[a-z]+:", target):
                continue
            name, _, anchor = target.partition("#")
            file = (path.parent / name).resolve() if name else path
            if not file.exists():
                yield f"{where}: the link to {target} leads nowhere: there is no {name}"
            elif anchor and (file.suffix != ".md" or anchor not in anchors(file)):
                yield f"{where}: the link to {target} leads nowhere: {file.name} has no heading of that name"
        for span in re.findall(r"`([^`]+)`", line):
            name = span.split()[0] if span.split() else ""
            is_ours = PATH.match(name) and (root / name.split("/")[0]).is_dir() or FILE.match(name)
            if is_ours and not (root / name).exists() and not (path.parent / name).exists():
                yield f"{where}: `{name}` is not in the repository"


def check_contents(root, path):
    """A document whose first heading of the second rank comes after links to its own headings has a contents list: of
    all of them."""
    listed, headings = set(), []
    for number, line in prose(path.read_text()):
        heading = re.match(r"## +(.*?)\s*#*$", line)
        if heading:
            headings.append((number, heading.group(1)))
        elif not headings:
            listed |= {text for text, _ in re.findall(r"^\s*- \[(.*)\]\((#[^()\s]+)\)", line)}
    for number, heading in headings if listed else []:
        if heading not in listed:
            yield f"{path.relative_to(root)}:{number}: the contents list lacks `{heading}`"


def check_source(root, path, documents):
    for number, line in enumerate(path.read_text().splitlines(), 1):
        # In Rust, comments cite documents; strings may name anything.
        comment = re.search(r"(^|\s)//.*", line) if path.suffix == ".rs" else re.match(".*", line)
        for name in re.findall(r"\b([\w-]+\.md)\b", comment.group() if comment else ""):
            if name not in documents:
                yield f"{path.relative_to(root)}:{number}: {name} is not in the repository: cite what a reader has"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--root", type=pathlib.Path, default=pathlib.Path(__file__).resolve().parent.parent)
    root = parser.parse_args().root.resolve()
    every = list(files(root))
    documents = [path for path in every if path.suffix == ".md"]
    names = {path.name for path in documents}
    problems = [problem for path in documents for problem in still_there(check_document(root, path))]
    problems += [problem for path in documents for problem in still_there(check_contents(root, path))]
    for path in every:
        if path.suffix in SOURCES:
            problems += still_there(check_source(root, path, names))
    for problem in problems:
        print(problem, file=sys.stderr)
    if not problems:
        print(f"{len(documents)} documents, {len(every)} files")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
