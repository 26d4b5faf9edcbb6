"""Tables of all public keys, made from the code: fields of records, keys of ``as_dict``, and the comments next to them.

>>> [key.name for key in keys_of("core.calibration_file:HeadingErrorRecord")][:2]
['rms', 'worst']
"""

from __future__ import annotations

import ast
import inspect
import io
import re
import textwrap
import tokenize
from importlib import import_module
from typing import TYPE_CHECKING, Final, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

UNITS: Final = {
    "_m_s": "m/s", "_per_s": "1/s", "_per_root_s": "unit/√s", "_deg": "°", "_s": "s", "_hz": "Hz", "_nT": "nT",
    "_uT": "µT", "_m": "m", "seconds": "s",
}  # fmt: skip
"""Units that the end of a key's name states."""

STATED: Final = re.compile(
    r"^(?:\([^)]*\),? )?(µT|nT|m/s²|rad/s|rad²|degrees²|degrees|s)(?=[:,;]|$)"
    r"|in (`unit\w*`|the (?:square of the )?unit of the \w+|the calibration's unit|nT)"
)
"""Units that a comment states."""

FIT = (
    "fitting.fit_json:json_of fitting.result:Judgement fitting.result:Fit fitting.evidence:Disturbances "
    "fitting.evidence:Residuals fitting.evidence:Diagnosis fitting.evidence:Evidence fitting.claim:Claim"
)
"""Sources for a fit: the record, and the values that it consists of."""

PAGE: Final[Mapping[str, Mapping[str, str]]] = {
    "Calibration file": {
        "top level": "core.calibration_file:Document",
        "`calibration`": "core.calibration_file:Correction",
        "`calibration.disturbances`, by name": "core.calibration_file:DisturbanceRecord",
        "`calibration.columns`, by name": "core.calibration_file:ColumnRecord",
        "`calibration.linearization`": "core.calibration_file:LinearizationRecord",
        "`raw`": "core.calibration_file:Recorded",
        "`fit`": "core.calibration_file:Fitted",
        "`fit.heading_error_deg`": "core.calibration_file:HeadingErrorRecord",
        "`fit.good_until`": "core.calibration_file:GoodUntilRecord",
        "`fit.walk`": "core.calibration_file:WalkRecord",
        "`fit.findings`, each": "core.calibration_file:FindingRecord",
        "`fit.aiding`": "core.calibration_file:AidingRecord",
        "`provenance`": "core.calibration_file:ProvenanceRecord",
        "`provenance.files`, each": "core.calibration_file:SourceFile",
        "`provenance.files.columns`": "core.calibration_file:ColumnsRecord",
        "`survey`": "core.calibration_file:SurveyRecord",
    },
    "File of an accelerometer": {
        "top level": "core.inertial_record:InertialDocument",
        "`accelerometer`, `gyro`": "core.inertial_record:TriadRecord",
        "`tilt_error_deg`": "core.inertial_record:TiltErrorRecord",
    },
    "Plan of a recording": {
        "`plan --json`": "workflows.planning:Plan",
        "`expected`": "workflows.planned_fit:ExpectedFit",
        "`alternatives`, each": "workflows.planning:Alternative",
    },
    "Truth of a simulation": {
        "`recording.truth.json`": "simulate.truth:Truth",
        "`sensor`": "simulate.truth:SensorRecord",
        "`field`": "simulate.truth:FieldRecord",
        "`recording`": "simulate.truth:RecordingRecord",
        "`simulate aircraft --json`": "apps.survey.simulate_aircraft:Flight",
        "`simulate boat --json`": "apps.service.simulate_boat:BoatLife",
        "each of its `events`": "apps.service.simulate_boat:BoatEvent",
        "`simulate two-axis --json`": "apps.classic.recovery:Recovery",
        "`polar`, each a list": "apps.classic.simulate_two_axis:Polar",
    },
    "Coefficients of Tolles and Lawson": {
        "file, `tolles-lawson --json`": (
            "apps.survey.aeromagnetic:CoefficientFile apps.survey.tolles_lawson_fit:TollesLawson"
        ),
        "`coefficients`, by name": "apps.survey.aeromagnetic:Coefficient",
        "with `--coefficients`": "apps.survey.tolles_lawson_fit:CompensationResidual",
    },
    "Tables of a fleet": {
        "columns of `fleet --output`": "apps.fleet.results:UnitResult",
        "`fleet --json`": "apps.fleet.job:RunSummary",
        "columns of `--bad`, `not_good` of `fleet --json`": "apps.fleet.not_good:NotGood",
        "columns of `--alerts`, `alerts` of `fleet --json`": "apps.fleet.alerts:Alert",
        "`fleet at --json`": "apps.fleet.store:ValidCalibration",
        "`info --json`, `show --json` of a folder or table": "apps.fleet.contents:Contents",
        "`simulate fleet`: columns of `FOLDER.truth.csv`": "apps.fleet.simulate:LineTruth",
        "columns of `drift --output`, `listed` of `drift --json`": "apps.fleet.overview:UnitDrift",
        "`drift --json`": "apps.fleet.overview:FleetDrift",
        "`steps`, each": "apps.fleet.overview:UnitStep",
        "`batches`, each": "apps.fleet.overview:BatchDrift",
        "`undated`": "apps.fleet.overview:Undated",
        "of histories: columns of `drift --output`, `listed` of `drift --json`": "apps.fleet.walks:UnitWalk",
        "of histories: `drift --json`": "apps.fleet.walks:FleetWalk",
        "`change_deg`": "apps.fleet.overview:Histogram",
    },
    "Fits": {
        "`calibrate --json`, `demo`, `merge`, `refresh`, `two-axis`": FIT,
        "`heading_error_deg`": "core.calibration_file:HeadingErrorRecord",
        "`findings`, each": "findings.finding:Finding",
        "`coverage`": "summary.coverage:Coverage",
        "`outliers`, each": "estimators.outliers:Outlier",
        "`drift`": "diagnostics.systematic:Drift",
        "`nonlinearity`": "diagnostics.systematic:Nonlinearity",
        "`axis_lag`": "diagnostics.systematic:AxisLag",
        "`repeats`": "diagnostics.repeatability:Repeats",
        "`repeats.parts`, each": "diagnostics.repeatability:Repeat",
        "`disturbances`, each": "estimators.regressors:DisturbanceEstimate",
        "`aiding`": "fitting.aiding:Aiding",
        "`aiding.sensors`, each": "fitting.aiding:AidingSensor",
        "`calibrate --previous --json`": "workflows.bench:Bench",
        "`accelerometer --json`": "workflows.accelerometer:AccelerometerFit",
        "`refreshed`": "diagnostics.soft_iron:Refreshed",
        "`calibrate --minmax --json`": f"fitting.axis_extremes:Extremes {FIT}",
        "`calibrate --sensor all --joint --json`":
            "comparison.members:MultiFit comparison.members:Agreement",
        "`disagreements`, each": "comparison.agreement:Disagreement",
        "`sensors`, each: `joint`": "comparison.members:Member",
        "`two-axis --json`: `turn`": "geometry.plane:Turn",
        "`turn.mean_and_scatter`, `turn.least_squares`": "geometry.plane:PlaneEllipse",
        "`turn.spacing`": "geometry.plane:Spacing",
        "`survey --json`": "apps.survey.calibration:SurveyFit",
    },
    "Comparisons": {
        "`compare --json`, `check --json`": "comparison.comparison:Comparison",
        "`rotation`": "comparison.rotation_difference:RotationDifference",
        "`check --drift --json`: `drift`": "diagnostics.random_walk:RandomWalk",
        "`check --json`, besides": "workflows.checking:Check",
        "`check --json` of a calibration alone": "workflows.aging:AgedCalibration",
        "`residual`, and within `apply --json` and `heading --json`": "comparison.comparison:LengthSums",
        "`evaluate --json`": "comparison.evaluation:Evaluation",
        "`compare-methods --json`": "apps.classic.methods:Contest",
        "`methods`, each": f"apps.classic.methods:Entry core.calibration:Calibration {FIT}",
    },
    "Headings": {
        "`apply --json`": "workflows.correction:CorrectionSummary",
        "`heading --json`": "heading.compass:HeadingSums",
        "`heading --json`, besides": "workflows.heading_stream:HeadingSummary",
        "`site`": "core.geomag:SiteField",
        "`--filter`: `filter`": "workflows.correction:Smoother",
        "`swing --json`": "apps.marine.swing_result:Swing",
        "`deviation`": "apps.marine.deviation:Deviation",
        "`calibration`": "apps.marine.deviation:Expected",
        "`conformity`": "apps.marine.deviation:Conformity",
        "`before`": "apps.marine.compensation:Compensation",
        "`before.correctors`, each": "apps.marine.compensation:Corrector",
        "`logged`": "apps.marine.legs:LoggedSwing",
        "`rests`, each": "heading.stationary:Rest",
        "`half_turns`, each": "heading.stationary:HalfTurn",
        "`budget … --json`": "apps.classic.budget:Budget",
    },
    "Recordings, targets, links": {
        "`info --json`": "workflows.recording_contents:Contents",
        "`sensors`, each": "workflows.recording_contents:RecordedSensor",
        "`sensors`, each: `chip`": "workflows.chip_proposal:ChipProposal",
        "`chip.candidates`, each": "workflows.chip_proposal:ChipCandidate",
        "`chips --json`, by name": "core.chips:Chip",
        "`settings`, each": "core.chips:ChipSetting",
        "`record --json`": "links.recording_statistics:RecordingStatistics",
        "`watch --json`, `watch --status`": "apps.service.reports:Report",
        "`live --json`": "apps.live.cli.live:_as_dict",
        "`station --json`": "apps.live.cli.station:_as_dict",
        "columns of the table of a `station`": "apps.live.station.table:StationRow",
        "`gauge-study --json`, by column": "apps.live.cli.gauge_study:_as_dict",
        "each of them also": "apps.live.station.gauge:GaugeStudy",
        "`send --mavlink --json`": "apps.vehicles.mavlink_parameters:ParameterPlan",
        "`send --serial --json`": "targets.motioncal:MotionCalPacket",
        "`targets --json`, by name": "targets._target:Target",
    },
}  # fmt: skip
"""Sections of the page: the title of each table, and the records or functions that it is made from."""


class Key(NamedTuple):
    """A public key with its unit and meaning."""

    name: str
    unit: str
    meaning: str


def page() -> str:
    """The tables as Markdown, as in docs/keys.md."""
    sections = (f"## {title}\n\n{''.join(map(_table, tables.items()))}" for title, tables in PAGE.items())
    return "".join(sections)


def _table(entry: tuple[str, str]) -> str:
    """Markdown of a table: heading, name of the record, and keys."""
    heading, source = entry
    rows = (f"| `{key.name}` | {key.unit} | {key.meaning} |\n" for key in keys_of(source))
    return f"### {heading}\n\n| key | unit | meaning |\n|---|---|---|\n{''.join(rows)}\n"


def keys_of(source: str) -> tuple[Key, ...]:
    """Keys of a record or function, ``module:name``; further sources give the meanings that the first one lacks."""
    made, *others = (_found(name) for name in source.split())
    fields = _fields(made) if inspect.isclass(made) else {}
    known = {name: words for other in others if inspect.isclass(other) for name, words in _fields(other).items()}
    return tuple(_key(name, words or fields.get(name) or known.get(name, "")) for name, words in _named(made))


def _found(name: str) -> type:
    """The type or function with a name."""
    module, _, attribute = name.partition(":")
    found: type = getattr(import_module(f"flinders.{module}"), attribute)
    return found


def _key(name: str, words: str) -> Key:
    """Key with the unit that its name or its comment states."""
    by_name = next((unit for end, unit in UNITS.items() if name.endswith(end)), "")
    stated = STATED.search(words)
    unit = by_name or (next(filter(None, stated.groups())) if stated else "")
    words = re.sub(rf"^((?:\([^)]*\))?),? ?{re.escape(unit)}(?:[:,] |$)", r"\1 ", words) if unit else words
    words = re.sub(r"\bNone\b", "null", words).replace("``", "`").replace("|", "\\|").strip()
    words = words[:1].lower() + words[1:] if words[1:2].islower() else words
    return Key(name, unit.replace("degrees", "°"), words if ". " in words else words.removesuffix("."))


def _named(made: type) -> Iterator[tuple[str, str]]:
    """Yield names of keys in order, with their comments in ``as_dict``."""
    function = getattr(made, "as_dict", None) if inspect.isclass(made) else made
    if function is None or hasattr(made, "__struct_fields__"):
        tag = getattr(getattr(made, "__struct_config__", None), "tag_field", None)
        if tag:
            yield tag, "what the file is"
        yield from ((name, "") for name in _own(made))
        return
    source = "".join(textwrap.dedent(inspect.getsource(each)) for each in (function, *_parts(made, function)))
    tree, comments, seen = ast.parse(source), _comments(source), set()
    whole = _own(made) if re.search(r"asdict\(self\)|self\.__(slots|dataclass_fields)__", source) else ()
    left = {node.value for each in ast.walk(tree) if isinstance(each, ast.Compare)
            for node in ast.walk(each) if isinstance(node, ast.Constant)}  # fmt: skip
    for name, words in (*((name, "") for name in whole if name not in left), *_of_tree(tree, comments)):
        if name not in seen:
            yield name, words
        seen.add(name)


def _parts(made: type, function: Callable[..., object]) -> Iterator[Callable[..., object]]:
    """Yield private methods, or functions of the module, that make some of the keys."""
    home = made if inspect.isclass(made) else inspect.getmodule(function)
    for name in re.findall(r"\*(?:self\.)?(_\w+_as_dict)\(", inspect.getsource(function)):
        yield getattr(home, name)


def _own(made: type) -> tuple[str, ...]:
    """Fields of a record."""
    for attribute in ("__struct_fields__", "__dataclass_fields__", "_fields"):
        if names := getattr(made, attribute, ()):
            return tuple(names)
    return ()


def _of_tree(tree: ast.AST, comments: Mapping[int, str], parent: str = "") -> Iterator[tuple[str, str]]:
    """Keys of mappings that a function makes, with those of commented inner mappings, and names of attributes."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.DictComp | ast.ListComp):
            for each in node.generators:
                yield from _of_tree(ast.Expression(each.iter), comments, parent)
        elif isinstance(node, ast.Dict):
            yield from _of_mapping(node, comments, parent)
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Subscript):
            name = node.targets[0].slice
            if isinstance(name, ast.Constant):
                yield str(name.value), comments.get(node.lineno, "")
        else:
            members = node.elts if isinstance(node, ast.Tuple) else node.args if isinstance(node, ast.Call) else []
            names = [each.value for each in members if isinstance(each, ast.Constant) and not parent]
            yield from ((name, "") for name in names if isinstance(name, str) and name.isidentifier())
            yield from _of_tree(node, comments, parent)


def _of_mapping(node: ast.Dict, comments: Mapping[int, str], parent: str) -> Iterator[tuple[str, str]]:
    """Keys of one mapping."""
    for key, value in zip(node.keys, node.values, strict=True):
        name = f"{parent}{key.value!s}" if isinstance(key, ast.Constant) else ""
        words = comments.get(key.lineno, "") if key is not None else ""
        if name and (not parent or (words and key is not None and key.lineno != node.lineno)):
            yield name, words
        yield from _of_tree(ast.Expression(value), comments, f"{name}." if name else parent)


def _fields(made: type) -> dict[str, str]:
    """Comments of a record's fields, and first lines of the docstrings of its methods."""
    words: dict[str, str] = {}
    for kind in reversed([kind for kind in inspect.getmro(made) if kind.__module__.startswith("flinders")]):
        source = textwrap.dedent(inspect.getsource(kind))
        comments, body = _comments(source), ast.parse(source).body[0]
        assert isinstance(body, ast.ClassDef)
        for node in body.body:
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                words[node.target.id] = comments.get(node.lineno) or comments.get(node.end_lineno or 0, "")
            elif isinstance(node, ast.FunctionDef):
                words.setdefault(node.name, (ast.get_docstring(node) or "").partition("\n")[0])
    return words


def _comments(source: str) -> dict[int, str]:
    """The comment of each line: behind it, or on the lines above it."""
    found, above = dict[int, str](), dict[int, str]()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT and not token.string.startswith(("# fmt", "# noqa", "# type")):
            words, line = token.string.lstrip("#: "), token.start[0]
            if token.line.strip().startswith("#"):
                above[line + 1] = f"{above.pop(line, '')} {words}".strip()
            else:
                found[line] = words
    return above | found
