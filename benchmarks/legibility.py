"""Draws docstrings, messages and sentences of the docs for a reader: ``python -m benchmarks.legibility --seed 50``.

    python -m benchmarks.legibility [--seed 50] [--docstrings 200] [--messages 100] [--sentences 100]

A fresh reader, who knows magnetometers but not this program, reads each text once and notes those that needed a second
reading.
The bound is 4 of 200 docstrings, 1 of 100 messages and 2 of 100 sentences. Drawn are docstrings of modules, classes and
functions, and the strings below constants; messages of errors, findings and help texts; sentences of docs/ outside of
code and tables.
"""

from __future__ import annotations

import argparse
import ast
import random
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

ROOT: Final = Path(__file__).resolve().parent.parent
SOURCES: Final = ROOT / "src" / "flinders"
MIN_WORDS: Final = 5
"""Smallest count of words of a sentence."""
WRITTEN: Final = ("plain", "remedy", "said", "fault", "help", "epilog")
"""Keywords whose value is a message."""


def docstrings(path: Path, tree: ast.Module) -> Iterator[str]:
    """Docstrings of a module, and the strings below its constants, each after its name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            name = path.stem if isinstance(node, ast.Module) else node.name
            if written := ast.get_docstring(node):
                words, _, _ = written.partition("\n>>>")
                yield f"{path.relative_to(ROOT)} {name}\n{words}"
    for before, after in zip(tree.body, tree.body[1:], strict=False):
        names = ast.unparse(before.target) if isinstance(before, ast.AnnAssign) else ""
        text = after.value.value if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) else None
        if names and isinstance(text, str):
            yield f"{path.relative_to(ROOT)} {ast.unparse(before)[:100]}\n{text}"


def messages(path: Path, tree: ast.Module) -> Iterator[str]:
    """Messages of errors, findings and help texts; empty for short ones."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            yield from (_words(path, value) for value in node.exc.args[:1])
        elif isinstance(node, ast.keyword) and node.arg in WRITTEN:
            yield _words(path, node.value)


def _words(path: Path, value: ast.expr) -> str:
    """Text of a string, with the expressions of its values in braces; empty for other values and for few words."""
    text = ast.unparse(value).removeprefix("f")[1:-1] if isinstance(value, ast.Constant | ast.JoinedStr) else ""
    return f"{path.relative_to(ROOT)}\n{text}" if len(text.split()) >= MIN_WORDS else ""


def sentences(path: Path) -> Iterator[str]:
    """Sentences of a page, outside of code and tables."""
    text = re.sub(r"^```.*?^```$|<!--.*?-->", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"^ *[|#!].*$", "", text, flags=re.MULTILINE)
    for line in text.splitlines():
        for sentence in re.split(r"(?<=[.:?!]) (?=[A-Z`])", line.strip(" -")):
            if len(sentence.split()) >= MIN_WORDS:
                yield f"{path.relative_to(ROOT)}\n{sentence}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print what was drawn, numbered."""
    parser = argparse.ArgumentParser("python -m benchmarks.legibility", description="Texts for a fresh reader.")
    parser.add_argument("--seed", type=int, default=50)
    for name, count in (("docstrings", 200), ("messages", 100), ("sentences", 100)):
        parser.add_argument(f"--{name}", type=int, default=count)
    asked = parser.parse_args(arguments)
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(SOURCES.rglob("*.py"))}
    pages = sorted(path for path in (ROOT / "docs").rglob("*.md") if "_build" not in path.parts)
    drawn = {
        "docstrings": [text for path, tree in trees.items() for text in docstrings(path, tree)],
        "messages": [text for path, tree in trees.items() for text in messages(path, tree) if text],
        "sentences": [text for path in pages for text in sentences(path)],
    }
    chance = random.Random(asked.seed)
    for name, texts in drawn.items():
        count = min(getattr(asked, name), len(texts))
        sys.stdout.write(f"\n## {name}: {count} of {len(texts)}\n")
        for number, text in enumerate(chance.sample(texts, count), 1):
            sys.stdout.write(f"\n{number}. {text}\n")


if __name__ == "__main__":
    main()
