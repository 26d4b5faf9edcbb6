"""Output files of a unit: calibration, exports, certificate."""

from __future__ import annotations

from importlib.metadata import version
from typing import TYPE_CHECKING

from flinders.apps.live.station.certificate import CertifiedTest, certificate
from flinders.core.calibration_file import ProvenanceRecord
from flinders.core.files import write_bytes, write_text
from flinders.targets import find

if TYPE_CHECKING:
    from datetime import datetime
    from pathlib import Path

    from flinders.apps.live.finished import FinishedCalibration
    from flinders.apps.live.station.folder import StationFolder, UnitTest
    from flinders.apps.live.station.plan import Plan


def write_outputs(
    made: FinishedCalibration, test: UnitTest, ended: datetime, plan: Plan, folder: StationFolder, *, is_passed: bool
) -> None:
    """Write the calibration of a test and, for a unit that passes, the exports and certificate of the station's file.

    Raises
    ------
    OutputError
        If a file cannot be written.
    FlindersError
        If a target cannot hold the calibration.
    """
    fit = made.fit
    record = ProvenanceRecord(flinders=version("flinders"), date=ended.replace(microsecond=0), files=made.files)
    fit.save(folder.file_of("calibrations", test, ".json"), provenance=record)
    if not is_passed:
        return
    for name in plan.export.targets:
        target = find(name)
        export = target.render(fit.calibration, about=[f"serial number {test.serial}", *made.about])
        _write(folder.file_of("exports", test, f".{name}{target.suffix}"), export.content)
    if plan.certificate is not None:
        about = CertifiedTest(test.serial, test.name, test.began, ended, test.operator, is_passed=True)
        _write(folder.file_of("certificates", test, ".xml"), certificate(fit, plan.certificate, about, plan.limits))


def _write(path: Path, content: str | bytes) -> None:
    if isinstance(content, str):
        write_text(content, path)
    else:
        write_bytes(content, path)
