"""How time and evidence change the knowledge of an online calibration, in NumPy: reference for `native/knowledge.c`.

A record is a row of `flinders.native.layouts.ONLINE`. Constants are those of the C files, by their names there.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Final

import numpy as np

from flinders.native.build import SOURCE_FOLDER

if TYPE_CHECKING:
    from flinders.arrays import Floats
    from flinders.native.layouts import Records

HOUR_S: Final = 3600.0
DAY_S: Final = 86400.0


def constant(name: str) -> float:
    """Number that a C file defines."""
    text = "".join((SOURCE_FOLDER / file).read_text(encoding="utf-8") for file in ("knowledge.c", "online.c"))
    return float(re.findall(rf"#define {name} \(\(real\)([\d.e+-]+)\)", text)[0])


def rates() -> Floats:
    """(7,) rates of the walk, as fractions of the radius per root hour."""
    text = (SOURCE_FOLDER / "knowledge.c").read_text(encoding="utf-8")
    found = re.findall(r"RATE\[FL_RATES\] = \{(.*?)\}", text)[0]
    return np.array([float(number) for number in re.findall(r"\(real\)([\d.e-]+)", found)])


def radius(parameters: Floats) -> float:
    """Mean radius of (9,) offset and shape."""
    return float(np.mean(parameters[3:6]))


def aged(record: Records, parameters: Floats, seconds: float, covariance: Floats) -> Floats:
    """(9, 9) covariance after some time: the offset walks at one of seven rates, the shape at a fixed one."""
    hours, size = max(seconds, 0.0) / HOUR_S, radius(parameters)
    walk = float(record["rates"] @ rates() ** 2)
    shape = constant("SHAPE_WALK_SIGMA") ** 2
    added = np.array([walk] * 3 + [shape] * 3 + [shape / 2.0] * 3)
    return np.asarray(covariance + np.diag(added * size**2 * hours))


def unseen_moves(record: Records, seconds: float) -> float:
    """Variance of the offset along each axis by moves in a time without readings."""
    if not seconds > constant("MAX_WATCHED_GAP_S"):
        return 0.0
    before, day = constant("PRIOR_MOVES_PER_DAY"), constant("PRIOR_MOVES_DAYS")
    a_day = (before * day + record["moves"]) / (day + record["watched"] / DAY_S)
    size = constant("PRIOR_MOVE_SIZE") * radius(record["latest"])
    square = (size**2 + record["moves_square"]) / (1.0 + record["moves"])
    return float(a_day * seconds / DAY_S * square / 3.0)


def kept_open(before: Floats, same: float, covariance: Floats) -> Floats:
    """Covariance of a block; a share of the variance stays, however many blocks follow.

    Along an eigenvector of the covariance after relative to the one before, with eigenvalue e, the block alone has e /
    (1 − e).
    """
    root = np.linalg.cholesky(before)
    inverse = np.linalg.inv(root)
    shares, vectors = np.linalg.eigh(inverse @ covariance @ inverse.T)
    alone = np.where(shares < 1.0 - 1e-12, same * shares / np.maximum(1.0 - shares, 1e-12), 1.0)
    more = np.maximum(np.minimum(alone, 1.0) - shares, 0.0)
    axes = root @ vectors
    return np.asarray(covariance + (axes * more) @ axes.T)


def weighed_rates(record: Records, off: Floats, covariance: Floats, seconds: float) -> Floats:
    """(7,) probabilities of the rates after an offset error of (3,), with the covariance without the walk."""
    added = rates() ** 2 * radius(record["known"]) ** 2 * seconds / HOUR_S
    log_density = []
    for variance in added.tolist():
        total = covariance + variance * np.eye(3)
        log_density.append(-(off @ np.linalg.solve(total, off)) / 2.0 - np.linalg.slogdet(total)[1] / 2.0)
    before = record["probable_rates"]
    weights = (record["rates"] / before) ** constant("MEMORY_EXPONENT") * before * np.exp(np.array(log_density))
    return np.asarray(weights / weights.sum())


def expected_rates(size: float, walk: float, log_sigma: float) -> Floats:
    """(7,) probabilities of the rates if one rate is known: Student's distribution of the logarithm."""
    freedom = constant("RATE_FREEDOM")
    scale = math.hypot(log_sigma, constant("RATE_SPACING_SIGMA"))
    off = np.log(rates() * size / walk) / scale
    weights = (1.0 + off**2 / freedom) ** (-(freedom + 1.0) / 2.0)
    return np.asarray(weights / weights.sum())


def claimed(record: Records, time: float) -> Floats:
    """(9, 9) claimed covariance of the calibration in force at a time."""
    latest, now = record["latest"], float(record["now"])
    covariance = aged(record, latest, time - float(record["latest_at"]), record["latest_covariance"].reshape(9, 9))
    covariance[:3, :3] += unseen_moves(record, time - now) * np.eye(3)
    covariance[:3, :3] += constant("CHANGE_PROBABILITY") * np.outer(record["apart"], record["apart"])
    covariance[:3, :3] += record["apart_covariance"].reshape(3, 3)
    if record["moved_at"] <= time:
        elapsed = time - float(record["moved_at"])
        back = constant("REVERSAL_PROBABILITY") * math.exp(-elapsed / constant("REVERSAL_TIME_S"))
        covariance[:3, :3] += back * np.outer(record["moved"], record["moved"])
    return np.asarray(covariance + np.outer(record["in_force"] - latest, record["in_force"] - latest))
