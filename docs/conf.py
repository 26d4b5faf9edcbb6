"""How Sphinx builds the documentation."""

import re
import warnings
from importlib.metadata import version as installed
from pathlib import Path

from numpydoc import docscrape_sphinx

project = "Flinders"
author = "The Flinders developers"
copyright = "2026, The Flinders developers"
release = version = installed("flinders")

extensions = ["myst_parser", "numpydoc", "sphinx.ext.autodoc"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"Flinders {release}"
html_show_sourcelink = False
html_search_scorer = str(Path(__file__).with_name("scorer.js"))
html_theme_options = {"navigation_with_keys": True, "top_of_page_buttons": []}

myst_heading_anchors = 3

# Docstrings: `single backticks` are code, sections are numpydoc's, shapes like (N, 3) are prose and no links.
default_role = "literal"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "show-inheritance": True}
numpydoc_show_class_members = False
numpydoc_xref_param_type = False
warnings.filterwarnings("ignore", message="Unknown section Configuration")  # of msgspec.Struct

# Nitpicky about this package's own public names; those of Python, NumPy and type checkers are not linked.
nitpicky = True
APPS = "fleet.(dataset|keys|options|plan|progress|storage|summary)|vehicles.targets.autopilot"
INNER = rf"flinders\.(.*\._\w+|estimators\.(auto|rests)|apps\.({APPS}))\..*"  # occur in signatures, but have no page
nitpick_ignore_regex = [(r"py:.*", r"(?!flinders\.).*"), (r"py:.*", INNER)]
nitpick_ignore = [("py:class", "flinders.core.calibration.Frame")]  # a variable of types
suppress_warnings = ["misc.highlighting_failure"]  # sessions show files with single apostrophes
autodoc_inherit_docstrings = False


def made_once(make):
    """Share one environment of Jinja: numpydoc creates one a docstring, and compiles its template 8,000 times."""
    made = []

    def environment(loader):
        if not made:
            made.append(make(loader=loader))
        return made[0]

    return environment


docscrape_sphinx.SandboxedEnvironment = made_once(docscrape_sphinx.SandboxedEnvironment)


def keep_bars(_app, _what, _name, _object, _options, lines):
    """Escape the bars of a length |x| in a docstring, which reStructuredText would read as a substitution."""
    example = False
    for number, line in enumerate(lines):
        example = line.lstrip().startswith(">>>") or (example and bool(line.strip()))
        if not example:
            prose_and_code = re.split(r"(``.*?``|`.*?`)", line)
            lines[number] = "".join(p if p.startswith("`") else p.replace("|", r"\|") for p in prose_and_code)


def setup(app):
    app.connect("autodoc-process-docstring", keep_bars, priority=400)
