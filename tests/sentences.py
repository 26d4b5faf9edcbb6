"""Sentences of the program in golden files, so that tests assert codes and numbers.

``assert_sentences(ended.err)`` compares a whole text with the next text of its test in the module's golden file:
``tests/golden/sentences/readers/test_info.toml`` is that of ``tests/readers/test_info.py``. ``with
assert_raises(TooFewSamples, found=3):`` asserts the class of an error and numbers of its evidence, and compares its
text in the same way. ``pytest --regenerate`` writes the texts of all tests that it runs, and leaves those of other
tests.
"""

from __future__ import annotations

import json
import os
import re
import tempfile
import tomllib
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from html import unescape
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import pytest

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Mapping, Sequence

    E = TypeVar("E", bound=BaseException)

TESTS = Path(__file__).resolve().parent
SENTENCES = TESTS / "golden" / "sentences"
RECORDINGS = Path(os.environ.get("FLINDERS_DATA") or TESTS.parents[1] / "shared" / "data")
TEMPORARY = {tempfile.gettempdir(), os.path.realpath(tempfile.gettempdir())}
WORDS_OF_OTHERS = {  # of Python, libraries and the machine
    re.compile(r"\((\w+Error): .+?\)(?=: |; )", re.DOTALL): r"(\1: <words>)",
    re.compile(r"(broken gzip data|JSON that can be read) \(.+?\)(?=: )"): r"\1 (<words>)",
    re.compile(r"(?<=cannot be opened: it is not there; )th[^\n]*"): "<ports of this machine>",
}
MAX_CHARACTERS = 1200
MAX_LINE = 240
SENTENCE_END = re.compile(r"(?<=[.?;])\s+(?=\S)|\s+(?=[!✗·] )")
NUMBER = re.compile(r"(?<![\w#])[-−+]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?(?!\w)")
MULTILINE_ESCAPES = {"\\": "\\\\", '"""': '""\\"'}


def assert_sentences(said: str | Iterable[object], *, about: str = "", numbers: bool = True) -> None:
    """Compare a text, or one for each line, with the golden file.

    Of a whole document, only sentences that contain the word or number `about` are compared. Without `numbers`, each
    number becomes a ``#``.
    """
    text = said if isinstance(said, str) else "\n".join(map(str, said))
    if about:
        text = "\n".join(sentences_with(about, text))
        assert text, f"no sentence has {about!r}"
    assert len(text) <= MAX_CHARACTERS, "a document: name a word of the sentences that the test is about"
    text = with_placeholders(text)
    if "\n" not in text and len(text) > MAX_LINE:
        text = SENTENCE_END.sub("\n", text)
    _current().meet(text if numbers else NUMBER.sub("#", text))


@contextmanager
def assert_raises(
    kind: type[E] | tuple[type[E], ...], code: str | None = None, /, *, numbers: bool = True, **evidence: object
) -> Generator[pytest.ExceptionInfo[E]]:
    """Assert the class of an error, its code and parts of its evidence; its text is in the golden file."""
    with pytest.raises(kind) as caught:
        yield caught
    error = caught.value
    if code is not None:
        assert getattr(error, "code", None) == code
    known = getattr(error, "evidence", {})
    assert {name: known.get(name) for name in evidence} == evidence
    assert_sentences(str(error), numbers=numbers)


def sentences_with(word: str, text: str) -> list[str]:
    """Sentences and lines of a text that contain a word or a number.

    >>> sentences_with("tilt", "GOOD Good to 1°. Up to 20° of tilt.\\nBeyond a tilt of 20°: 3°")
    ['Up to 20° of tilt.', 'Beyond a tilt of 20°: 3°']
    """
    shown = unescape(re.sub(r"<[^>]+>", "\n", text)) if "</html>" in text else text
    parts = (" ".join(part.split()) for line in shown.split("\n") for part in SENTENCE_END.split(line))
    return [part for part in parts if word in part]


def with_placeholders(text: str) -> str:
    """Text with placeholders for folders, ports, the version and the present time, which differ between runs.

    >>> with_placeholders("http://127.0.0.1:40123/ (OSError: it broke): copy it again")
    'http://127.0.0.1:<port>/ (OSError: <words>): copy it again'
    """
    from flinders import __version__  # not before the threads of NumPy are limited, by tests/conftest.py

    text = text.replace(str(RECORDINGS), "<data>").replace(str(TESTS.parent), "<project>")
    for folder in TEMPORARY:
        of_pytest = r"(?:pytest-of-[^/\s]+/pytest-\d+/(?:popen-gw\d+/)?)?"
        text = re.sub(rf"(?<!\w){re.escape(folder)}/{of_pytest}[\w.-]+", "<tmp>", text)
    text = re.sub(r"(\blocalhost:|127\.0\.0\.1:|\[::1\]:|\bport )\d{4,5}\b", r"\1<port>", text)
    text = re.sub(r"(?<=/dev/pts/)\d+", "<number>", text)
    text = re.sub(r"\bflinders-[a-z0-9_]{8}\b", "flinders-<random>", text)
    for words, placeholder in WORDS_OF_OTHERS.items():
        text = words.sub(placeholder, text)
    text = re.sub(rf"(?<![\w.]){re.escape(__version__)}(?![\w.])", "<version>", text)
    now = datetime.now(UTC)
    days = [now + timedelta(days=days) for days in (-1, 0, 1)]
    dates = "|".join(f"{day:%Y-%m-%d}|{day:%Y%m%d}|{day.day} {day:%B %Y}" for day in days)
    return re.sub(rf"(?:{dates})(?:,? ?[T _]\d\d[:-]?\d\d(?:[:-]?\d\d)?(?:\.\d+)?(?:Z| UTC)?)?", "<now>", text)


@dataclass
class Book:
    """Sentences of a module of tests: those of each test, in order."""

    path: Path
    texts: dict[str, list[str]]

    @classmethod
    def of(cls, module: Path) -> Book:
        path = SENTENCES / module.relative_to(TESTS).with_suffix(".toml")
        return cls(path, tomllib.loads(path.read_text(encoding="utf-8")) if path.exists() else {})

    def write(self, texts: Mapping[str, list[str]]) -> None:
        """Write the texts if they differ from those in the file; tests without texts are left out."""
        kept = {name: list(texts[name]) for name in sorted(texts) if texts[name]}
        if kept == self.texts:
            return
        self.texts = kept
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if kept:
            self.path.write_bytes(in_toml(kept).encode())
        else:
            self.path.unlink(missing_ok=True)


@dataclass
class Running:
    """The test that is running, and its texts so far."""

    book: Book
    name: str
    regenerates: bool
    is_rare: bool  # whether it runs only nightly or with certain tools; another case of its test then has the texts
    met: list[str] = field(default_factory=list)

    @property
    def held(self) -> list[str]:
        return self.book.texts.get(self.name, [])

    def meet(self, text: str) -> None:
        """Store the next text of the test, or compare it with the golden one."""
        if self.is_rare:
            cases = self.name.partition("[")[0] + "["
            assert any(name.startswith(cases) for name in self.book.texts), "no test of every day holds this: use codes"
            return
        place = len(self.met)
        self.met.append(text)
        if self.regenerates:
            return
        assert place < len(self.held), f"{self.book.path.name} holds {len(self.held)} texts of it: {_WAY_OUT}"
        assert text == self.held[place], f"text {place + 1} of {self.book.path.name} differs: {_WAY_OUT}"

    def end(self, *, has_passed: bool) -> None:
        """Write the texts of the test; a test that failed keeps the texts that it did not reach."""
        if self.is_rare:
            return
        if self.regenerates:
            beyond = [] if has_passed else self.held[len(self.met) :]
            self.book.write({**self.book.texts, self.name: self.met + beyond})
        elif has_passed:
            assert len(self.met) >= len(self.held), f"{self.book.path.name} holds more texts of it: {_WAY_OUT}"


_WAY_OUT = "`uv run pytest --regenerate`, then review the diff"


class Sentences:
    """Plugin of pytest that knows the running test, and removes the texts of tests that no longer exist."""

    running: Running | None = None

    def __init__(self, config: pytest.Config) -> None:
        self.regenerates = bool(config.getoption("--regenerate", default=False))
        self.is_partial = any("::" in str(chosen) for chosen in config.args)
        self.books: dict[Path, Book] = {}
        self.collected: dict[Path, set[str]] = {}

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, items: Sequence[pytest.Item]) -> None:
        """Note all tests of a module, before options choose some of them."""
        for item in items:
            self.collected.setdefault(item.path, set()).add(name_of(item))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Generator[None, None, None]:
        """Handle the sentences of one test."""
        if not item.path.is_relative_to(TESTS) or item.path.suffix != ".py":
            return (yield)
        book = self.books.setdefault(item.path, Book.of(item.path))
        running = Sentences.running = Running(book, name_of(item), self.regenerates, is_rare(item))
        try:
            result = yield
        except BaseException:
            running.end(has_passed=False)
            raise
        finally:
            Sentences.running = None
        running.end(has_passed=True)
        return result

    def pytest_sessionfinish(self) -> None:
        """Remove the texts of tests that a module no longer has."""
        if self.regenerates and not self.is_partial:
            for module, book in self.books.items():
                there = self.collected.get(module, set())
                book.write({name: texts for name, texts in book.texts.items() if name in there})


def is_rare(item: pytest.Item) -> bool:
    """Whether plain ``pytest`` leaves a test out."""
    return any(item.get_closest_marker(mark) is not None for mark in ("nightly", "tools"))


def name_of(item: pytest.Item) -> str:
    """Name of a test within its module, with the case."""
    return item.nodeid.partition("::")[2]


def in_toml(texts: Mapping[str, Sequence[str]]) -> str:
    """Write a list of texts for each test in TOML; a text of several lines stays readable.

    >>> print(in_toml({"test_a": ["one"], "test_b[1]": ["two", "three"]}), end="")
    test_a = [
        "one",
    ]
    <BLANKLINE>
    "test_b[1]" = [
        "two",
        "three",
    ]
    """
    return "\n".join(
        "".join([f"{_key(name)} = [\n", *(f"    {_text(text)},\n" for text in held), "]\n"])
        for name, held in texts.items()
    )


def _key(name: str) -> str:
    return name if re.fullmatch(r"[\w-]+", name, re.ASCII) else json.dumps(name, ensure_ascii=False)


def _text(text: str) -> str:
    if "\n" not in text:
        return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
    for plain, escaped in MULTILINE_ESCAPES.items():
        text = text.replace(plain, escaped)
    text = re.sub(r"[\x00-\x08\x0b-\x1f\x7f]", lambda found: f"\\u{ord(found[0]):04x}", text)
    text = re.sub(r"[ \t]+$", lambda found: "".join(f"\\u{ord(one):04x}" for one in found[0]), text, flags=re.MULTILINE)
    return f'"""\n{text}"""' if not text.endswith('"') else f'"""\n{text[:-1]}\\""""'


def _current() -> Running:
    assert Sentences.running is not None, "sentences are asserted while a test runs"
    return Sentences.running
