#!/usr/bin/env python3
"""Lists comments that are wider than 120 columns, to which rustfmt and black keep code alone.

usage: columns.py [--root DIR]

Looks at lines of comments in Rust, JavaScript, TypeScript and Python (docstrings included). Rows of tables, and what
has no blank at which a line could end, may be longer. Ends with 1 if there are any."""
import argparse, ast, pathlib, re, sys

WIDTH = 120
SKIPPED = {".git", "target", "work-data", "__pycache__", "node_modules"}
MARKS = {".rs": r"//[/!]?", ".js": r"//|/?\*+", ".mjs": r"//|/?\*+", ".ts": r"//|/?\*+", ".py": r"#", ".pyi": r"#"}


def sources(folder):
    for path in sorted(folder.iterdir()):
        if path.is_dir() and not path.is_symlink():
            yield from sources(path) if path.name not in SKIPPED else []
        elif path.suffix in MARKS:
            yield path


def docstrings(text):
    """The numbers of lines that belong to strings which stand alone."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield from range(node.lineno, node.end_lineno + 1)


def too_wide(path):
    """Numbers and widths of lines."""
    text = path.read_text(encoding="utf-8")
    documented = set(docstrings(text)) if path.suffix in (".py", ".pyi") else set()
    for number, line in enumerate(text.splitlines(), 1):
        if len(line) > WIDTH:
            mark = re.match(rf"\s*(?:{MARKS[path.suffix]})", line)
            words = line[mark.end() :].strip() if mark else line.strip()
            if (mark or number in documented) and " " in words and not words.startswith("|"):
                yield number, len(line)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=pathlib.Path, default=pathlib.Path(__file__).resolve().parent.parent)
    root = parser.parse_args().root
    wide = [f"{path.relative_to(root)}:{number}: {width} columns" for path in sources(root) for number, width in too_wide(path)]
    print("\n".join(wide) or f"no comment is wider than {WIDTH} columns")
    sys.exit(1 if wide else 0)


if __name__ == "__main__":
    main()
