"""Runs the published package `magyc` on recordings, for `benchmarks.magyc`, in the package's environment.

    python magyc_package.py recordings.npz answers.json        # field, rate and time of any number of recordings
    python magyc_package.py --simulate recordings.npz SEEDS    # recordings of its own simulator

It needs the package and NumPy, and not Flinders, whose environment may be another one. The field is in gauss, as in the
package's own data, since the tolerances of its factor graphs are absolute; a rate is that of the step that ends with
its reading.
"""

import importlib
import json
import sys
import time
from pathlib import Path

import numpy as np

FUNCTIONS = ("magyc_ls", "magyc_nls", "magyc_bfg", "magyc_ifg", "sar_ls", "sar_kf", "sar_aid", "ellipsoid_fit")
"""Functions to run, with their default options."""

GYRO_BIAS = {"magyc_nls": 2, "magyc_bfg": 2, "magyc_ifg": 2}
"""Index of the gyro bias in the functions' answers."""

HARD_ONLY = ("sar_ls", "sar_kf", "sar_aid")
LEVELS = ("high", "mid", "low", "tiny")
"""The names of its motions: amplitudes 5/45/360°, 5/5/360°, 5/45/90° and 5/5/90°."""


def answer(name: str, field: np.ndarray, rate: np.ndarray, clock: np.ndarray) -> dict[str, object]:
    """Offset, soft iron and gyro bias of one function, and CPU seconds; or its exception."""
    function = getattr(importlib.import_module("magyc"), name)
    begun = time.process_time()
    try:
        found = function(field) if name == "ellipsoid_fit" else function(field, rate, clock)
    except Exception as error:  # noqa: BLE001 - any error of the package is a result
        return {"refused": f"{type(error).__name__}: {error}"}
    seconds = time.process_time() - begun
    soft = np.eye(3) if name in HARD_ONLY else np.asarray(found[1], float)
    bias = np.asarray(found[GYRO_BIAS[name]], float).ravel().tolist() if name in GYRO_BIAS else None
    hard = np.asarray(found[0], float).ravel()[:3].tolist()
    return {"offset": hard, "soft_iron": soft.tolist(), "gyro_bias": bias, "seconds": seconds}


def answers(recordings: str, output: str) -> None:
    """Fit all recordings of a file with all functions, and write the results."""
    data = np.load(recordings)
    found: dict[str, list[dict[str, object]]] = {}
    for name in FUNCTIONS:
        found[name] = [answer(name, *three) for three in zip(data["field"], data["rate"], data["time"], strict=True)]
        print(f"magyc.{name}: {sum(float(str(one.get('seconds', 0.0))) for one in found[name]):.1f} s", file=sys.stderr)
    Path(output).write_text(json.dumps(found), encoding="utf-8")


def simulate(output: str, seeds: int) -> None:
    """Write recordings of the package's own simulator: 6,000 readings at 10 Hz, 10 mG and 10 mrad/s of noise."""
    generator = importlib.import_module("magyc.sim_data.generate_data")
    made = generator._SyntheticData(seeds, 6000, 10.0, 0.01, 0.01)
    np.random.seed(1)  # noqa: NPY002 - the package draws from there
    iron = np.array([[1.10, 0.10, 0.04], [0.10, 0.88, 0.02], [0.04, 0.02, 1.22]])
    made.fixed_parameters(iron, np.array([[0.02], [0.12], [0.09]]), np.array([[0.004], [-0.005], [0.002]]))
    made.save_data = lambda _: None
    made.generate_data("")
    columns = {"field": "mmt", "rate": "wmt", "true": "m", "time": "t", "angles": "rph"}
    by_level = {f"{level}_{column}": made.data_dict[level][key] for level in LEVELS for column, key in columns.items()}
    np.savez(output, **by_level)


if __name__ == "__main__":
    if sys.argv[1] == "--simulate":
        simulate(sys.argv[2], int(sys.argv[3]))
    else:
        answers(sys.argv[1], sys.argv[2])
