"""Betaflight's model file: the JSON that "export model" of its Configurator writes, schema 2.2.

>>> from flinders.core.calibration import Calibration
>>> from flinders.core.units import Unit
>>> counts = Unit.of("counts", 0.04)                    # µT in one count
>>> known = Calibration(np.diag([1.25, 1.0, 0.8]), [40.0, -20.0, 8.0], 50.0, True, raw=counts)
>>> written = write(known, ExportOptions())
>>> correction, fusion = written.values["ellipsoid_correction"], written.values["downstream_fusion"]
>>> correction["center"], fusion["nt_per_corrected_unit"]
({'x': 1000.0, 'y': -500.0, 'z': 200.0}, 50000.0)
>>> written.apply([1000.0, 750.0, 200.0])               # 50 µT along y
array([0., 1., 0.])
>>> back = read(chr(10).join(written.body).encode(), "model.json")
>>> back.apply([1000.0, 750.0, 200.0]).round(6), round(back.field_strength, 6), back.frame
(array([   0., 1250.,    0.]), 1250.0, 'vehicle')

**Formula.** ``c = soft_iron (raw − center)``, raw in counts, with c of length `radius`. One unit of c is the strength
of the field divided by the radius, stated in nT and in gauss. The radius written here is 1. The Configurator fits a
unit sphere; its radius is 1 to within a thousandth.

**Axes.** `alignment` is the proposed ``align_mag``, `captured_under` the one in force, and `hard_iron` the
``mag_calibration`` that goes with the proposed one. A file is in one of two axes, shown by `hard_iron`:

    captured    hard_iron = A C⁻¹ (center + mag_zero)      by the description of the schema; written here
    sensor      hard_iron = A center                       as the Configurator's full calibration writes it

with A the proposed and C the captured rotation, R_z(yaw) R_y(pitch) R_x(roll). The corrected field in the axes of the
vehicle is A C⁻¹ c or A c. `frame` is always FRD, but the numbers are for ``magADC``, whose axes the firmware takes as
forward, left and up (``flight/imu.c``); so nothing is mirrored here.

**Noise.** `residual_rms` is the white noise of a reading divided by the strength of the field: the Configurator
computes it from the lengths of corrected readings about the radius, so it is the noise along the field.
`mag_noise_gauss` is for the measurement noise R of a filter. It is written here as the noise of a reading plus the
error of the calibration, added as variances, as for EKF2_MAG_NOISE of PX4. The Configurator writes the noise of a
reading alone, which a poor calibration does not enlarge.

A filter treats R as white, but the error of a calibration is the same in every reading at one attitude. Even with both
parts in R, the filter underestimates the error of a constant heading. The R that avoids this depends on the filter's
rate and its gyro (`flinders.targets._measurement_noise`), so a note of the export states both parts.

Source: betaflight-configurator, ``src/js/utils/magModelExport.ts`` at 7cd82d45, and beside it ``ellipsoidFit.ts``,
``magAlignment.js``, ``magCharacterizationCompute.ts`` and ``magTiltAlign.ts``; ``exportFullCalModel`` of
``SensorsTab.vue``.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final, TypeAlias

import msgspec
import numpy as np

from flinders.apps.vehicles.targets.betaflight import MOUNTINGS, NAMES
from flinders.apps.vehicles.targets.betaflight_schema import (
    VERSION,
    Alignment,
    CapturedUnder,
    DownstreamFusion,
    EllipsoidCorrection,
    EulerAngles,
    GeoReference,
    MagNoise,
    Model,
    Vector,
    quality_bounds,
)
from flinders.apps.vehicles.targets.remounting import remounting
from flinders.arrays import Floats, to_floats
from flinders.core.calibration_file import nonfinite_places, readable_message
from flinders.core.units import COUNTS, MICROTESLA
from flinders.errors import DocumentError, figures
from flinders.targets._mounting import angles, euler
from flinders.targets._mounting import in_words as turn_in_words
from flinders.targets._numbers import (
    MAX_NUMBER,
    VEHICLE,
    Affine,
    in_16_bits,
    in_vehicle_axes,
    load_object,
    unmapping_matrix,
)
from flinders.targets._target import ExportOptions, Target, TargetReader, Written

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.core.calibration_file import Triple
    from flinders.targets._measurement_noise import MeasurementNoise

WHO: Final = "Betaflight's model file"
CUSTOM: Final = 9
"""Number of an ``align_mag`` with angles; 1 to 8 are the rows of `MOUNTINGS`, and 0 counts as 1."""
LABELS: Final = tuple(f"CW {angle}°{flip}" for flip in ("", " flip") for angle in (0, 90, 180, 270))
"""Labels of ``align_mag`` 1 to 8 in the Configurator."""
MAX_OFFSET_DIFFERENCE: Final = 2.0
"""Largest difference on an axis, in counts, of `hard_iron`, which is rounded to whole counts, and `center`."""


# writing


def write(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write the model; a recording that was not in raw counts raises `UnitError`.

    A rotation of the calibration is written to `alignment` if the mounting in force is known, else to `soft_iron`.
    Raises `NotExportable` if int16 cannot hold the offset, which the board needs as ``mag_calibration``.
    """
    in_place = in_vehicle_axes(calibration)
    affine = Affine.of(in_place, COUNTS, who=WHO)
    in_force = _recorded_mounting(asked.mounting)
    new = remounting(in_place, in_force, MOUNTINGS, after=True)
    turn = np.eye(3) if new is None else new.turn
    soft_iron = turn.T @ affine.matrix / affine.strength
    proposed = in_force if new is None else new.mounting.rotation
    residual, noise = _noise(in_place, asked.noise)
    strength_nt = _strength_nt(in_place)
    model = Model(
        captured_under=None if in_force is None else _captured_under(in_force),
        ellipsoid_correction=EllipsoidCorrection(
            center=_vector(affine.offset), soft_iron=_rows(soft_iron), radius=1.0, residual_rms=residual
        ),
        geo_reference=GeoReference(inclination_deg=_dip(asked.noise), field_strength_nt=strength_nt),
        alignment=None if proposed is None else _alignment(proposed),
        hard_iron=_vector(to_floats(in_16_bits(turn @ affine.offset, NAMES))),
        downstream_fusion=_fusion(soft_iron, strength_nt, noise),
    )
    values = msgspec.to_builtins(model)
    notes = [*([] if new is None else [new.words("align_mag")]), *_notes(model, in_place, asked.noise)]
    formula = "" if new is None else "m = alignment captured^-1 soft_iron (raw - center)"
    return Written(
        lambda raw: (raw - affine.offset) @ (turn @ soft_iron).T,
        json.dumps(values, indent=2).splitlines(),
        values,
        notes,
        formula=formula,
    )


def _fusion(soft_iron: Floats, strength_nt: float | None, noise: Noise) -> DownstreamFusion:
    """Block for a filter of corrected readings of length 1; without the earth's field, which needs a declination."""
    gauss = None if strength_nt is None else strength_nt / 1e5
    one, level, vertical = (None, None, None) if gauss is None or noise is None else (gauss * part for part in noise)
    return DownstreamFusion(
        frame="FRD",
        nt_per_corrected_unit=strength_nt,
        gauss_per_corrected_unit=gauss,
        mag_noise_gauss=MagNoise(sigma=one, sigma_xy=level, sigma_z=vertical),
        quality_bounds=quality_bounds(soft_iron, strength_nt),
    )


Noise: TypeAlias = tuple[float, float, float] | None
"""1 σ of a corrected reading as shares of the field strength: across the horizontal field, of x and y, and of z.

It is the noise and the error of the calibration together.
"""


def _noise(calibration: Calibration, noise: MeasurementNoise | None) -> tuple[float | None, Noise]:
    """White noise of a corrected reading divided by the field strength, and `Noise`; None if unknown."""
    if noise is None:
        return None, None
    back, strength = unmapping_matrix(calibration), calibration.field_strength
    x, y, z = np.diag(back @ noise.field_covariance @ back.T)
    both = noise.across / strength, float(np.sqrt((x + y) / 2)) / strength, float(np.sqrt(z)) / strength
    return noise.reading / strength, both


def _strength_nt(calibration: Calibration) -> float | None:
    """Field strength in nT; None if it is relative, or in counts."""
    is_known = calibration.field_strength_known and calibration.unit == MICROTESLA
    return 1e3 * calibration.field_strength if is_known else None


def _dip(noise: MeasurementNoise | None) -> float | None:
    """Dip of the field at the place of the readings, degrees."""
    return None if noise is None or noise.dip_assumed else noise.dip_deg


def _recorded_mounting(mounting: Floats | None) -> Floats | None:
    """(3, 3) mounting of the recording, exact if it is a row of `MOUNTINGS`."""
    row = None if mounting is None else MOUNTINGS.mounting(mounting)
    return mounting if row is None or row.number is None else row.rotation


def _captured_under(in_force: Floats) -> CapturedUnder:
    """Block with the mounting of the recording; ``mag_calibration`` is unknown, as no log holds it."""
    number = MOUNTINGS.mounting(in_force).number
    if number is not None:
        return CapturedUnder(alignment=number + 1)
    return CapturedUnder(alignment=CUSTOM, custom_angles=_euler(in_force))


def _alignment(proposed: Floats) -> Alignment:
    """Block with a mounting: its number, name and angles."""
    number = MOUNTINGS.mounting(proposed).number
    preset, label = (CUSTOM, "CUSTOM") if number is None else (number + 1, LABELS[number])
    return Alignment(preset=preset, label=label, euler_zyx_deg=_euler(proposed))


def _euler(rotation: Floats) -> EulerAngles:
    """Block with the angles of a rotation."""
    roll, pitch, yaw = (angle + 0.0 for angle in angles(rotation))
    return EulerAngles(roll=roll, pitch=pitch, yaw=yaw)


def _vector(values: Floats) -> Vector:
    """Block with (3,) numbers, by axis."""
    x, y, z = (values + 0.0).tolist()
    return Vector(x=x, y=y, z=z)


def _rows(matrix: Floats) -> tuple[Triple, Triple, Triple]:
    """Rows of a (3, 3) matrix, as tuples."""
    one, two, three = (tuple(row) for row in (matrix + 0.0).tolist())
    return one, two, three


def _notes(model: Model, calibration: Calibration, noise: MeasurementNoise | None) -> list[str]:
    """Notes on facts that the file cannot hold, and on its null fields."""
    recorded = "for readings recorded with mag_calibration = 0,0,0, as magADC of a blackbox has them"
    notes = [
        f"{recorded}; frame says FRD as the schema does, and nothing is mirrored",
        "latitude, longitude, declination and the earth's field are null: a calibration does not store its place",
    ]
    if model.alignment is None:
        notes.append("alignment and captured_under are null: the mounting (align_mag) of the recording is unknown")
    if model.geo_reference.field_strength_nt is None:
        notes.append(
            "field strength, scale and noise in gauss are null: calibrate with the microtesla in one count and the "
            "field strength of the place"
        )
    return [*notes, _noise_words(calibration, noise)]


def _noise_words(calibration: Calibration, noise: MeasurementNoise | None) -> str:
    """Sentence on the two parts of the noise."""
    if noise is None:
        return "residual_rms and noise are null: the calibration states no noise, or no uncertainty"
    across = noise.horizontal * math.radians(noise.heading_calibration_deg)
    reading, rest = (100.0 * part / calibration.field_strength for part in (noise.reading, across))
    return (
        f"residual_rms is the white noise of a reading, {figures(reading)} % of the field (heading "
        f"{figures(noise.heading_reading_deg)}° level); mag_noise_gauss includes the error of the calibration, "
        f"{figures(rest)} % across the horizontal field (heading {figures(noise.heading_calibration_deg)}°), which is "
        "the same in every reading at one attitude, though a filter treats it as white"
    )


# reading back


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read a model, in counts: for ``magADC`` with the proposed ``align_mag`` and ``mag_calibration = 0,0,0``.

    `strength` is the length of corrected readings in counts. By default it makes the determinant of the matrix 1. The
    file's µT per count is not used, since it holds for the file's own fit only (`proposals` states it).

    Raises `DocumentError` for a file of another schema, a damaged file, and a `hard_iron` that does not agree with the
    `center`.
    """
    model = _model(content, source)
    correction = model.ellipsoid_correction
    turn, offset = _in_proposed_axes(model, source)
    matrix = turn @ to_floats(correction.soft_iron) @ turn.T / correction.radius
    length = _length(correction, source) if strength is None else strength
    affine = Affine(length * matrix, offset, length)
    return replace(affine.to_calibration(COUNTS, known=strength is not None), frame=VEHICLE)


def _length(correction: EllipsoidCorrection, source: str) -> float:
    """Length of the readings less the offset, counts: the geometric mean of the radii of their ellipsoid."""
    with np.errstate(all="ignore"):
        determinant = abs(float(np.linalg.det(to_floats(correction.soft_iron))))
    if not 0.0 < determinant < MAX_NUMBER:
        raise DocumentError(
            f"{source}: soft_iron has a determinant of {determinant:.2g}: need a matrix that corrects all three axes"
        )
    return correction.radius / float(determinant ** (1 / 3))


def proposals(content: bytes, source: str) -> list[str]:
    """Sentences on the model's other contents, such as the proposed mounting; raises the errors of `read`."""
    model = _model(content, source)
    correction, quality = model.ellipsoid_correction, model.quality
    zero = ",".join(f"{value:.0f}" for value in _triple(model.hard_iron))
    words = [f"it proposes {_proposed_words(model, source)} and mag_calibration = {zero}"]
    if (stated := model.geo_reference.field_strength_nt) is not None:
        field, scale = 1e-3 * stated, 1e-3 * stated / _length(correction, source)
        words.append(f"it states a field of {figures(field, 4)} µT, by which one count is {figures(scale, 4)} µT")
    if correction.residual_rms is not None:
        share = 100.0 * abs(correction.residual_rms) / correction.radius
        words.append(f"it states residuals of {figures(share)} % of the field")
    if quality is not None and quality.mean_residual_deg is not None:
        count = "" if quality.sample_count is None else f" over {quality.sample_count:,} readings"
        words.append(f"it states a mean residual of the dip of {figures(quality.mean_residual_deg)}°{count}")
    if model.captured_under is not None and not model.captured_under.mag_zero_known:
        words.append("! mag_calibration during its recording is unknown, and assumed as 0,0,0")
    return words


def _model(content: bytes, source: str) -> Model:
    """Parse a file into a model; `DocumentError` if that fails."""
    fields = load_object(content, source)
    for place in nonfinite_places(fields):
        raise DocumentError(f"{source}: {place} is not finite: need a number")
    version = fields.get("version")
    if version != VERSION:
        raise DocumentError(
            f"{source}: schema version is {version!r}, need {VERSION!r}, which the full calibration of Betaflight "
            "Configurator exports: run that calibration, and export its model"
        )
    if fields.get("ellipsoid_correction") is None:
        raise DocumentError(f"{source}: has no ellipsoid_correction: run the full calibration, then export its model")
    try:
        return msgspec.convert(fields, Model)
    except msgspec.ValidationError as error:
        raise DocumentError(f"{source}: {readable_message(error)}") from None


def _in_proposed_axes(model: Model, source: str) -> tuple[Floats, Floats]:
    """(3, 3) rotation from the axes of the file to those of the proposed mounting, and (3,) offset there in counts.

    A file may be in either of two axes; those are assumed whose offset is nearer to `hard_iron`.
    """
    captured, proposed = _rotations(model, source)
    centre, hard = (_triple(vector) for vector in (model.ellipsoid_correction.center, model.hard_iron))
    under = model.captured_under
    zero = np.zeros(3) if under is None or under.mag_zero is None else _triple(under.mag_zero)
    across = proposed @ captured.T
    found = [(across, across @ (centre + zero)), (proposed, proposed @ centre)]
    off = [float(np.abs(offset - hard).max()) for _, offset in found]
    if not min(off) <= MAX_OFFSET_DIFFERENCE:
        raise DocumentError(
            f"{source}: hard_iron is {figures(min(off), 3)} counts from the center in the axes of alignment, need "
            f"{MAX_OFFSET_DIFFERENCE:.0f} or less: hard_iron or center was changed; export the model again"
        )
    if max(off) <= MAX_OFFSET_DIFFERENCE and not np.array_equal(captured, np.eye(3)):
        raise DocumentError(
            f"{source}: center and hard_iron agree both before and after captured_under.alignment, so that "
            "the axes of soft_iron are ambiguous: record with align_mag = CW0, and export the model again"
        )
    return found[off.index(min(off))]


def _rotations(model: Model, source: str) -> tuple[Floats, Floats]:
    """(3, 3) mounting in force and (3, 3) proposed mounting; one that is not stated equals the other."""
    captured = _captured_rotation(model, source)
    proposed = _proposed_rotation(model, source)
    if captured is None:
        captured = np.eye(3) if proposed is None else proposed
    return captured, captured if proposed is None else proposed


def _captured_rotation(model: Model, source: str) -> Floats | None:
    """(3, 3) mounting in force; None if not stated."""
    under = model.captured_under
    if under is None:
        return None
    return _rotation(under.alignment, under.custom_angles, f"{source}: captured_under.alignment")


def _proposed_rotation(model: Model, source: str) -> Floats | None:
    """(3, 3) proposed mounting; None if not stated."""
    asked = model.alignment
    return None if asked is None else _rotation(asked.preset, asked.euler_zyx_deg, f"{source}: alignment.preset")


def _rotation(number: int, own: EulerAngles | None, where: str) -> Floats:
    """(3, 3) rotation for a number of ``align_mag``, or for angles."""
    if number == CUSTOM and own is not None:
        return euler(own.roll, own.pitch, own.yaw)
    if not 0 <= number < CUSTOM:
        raise DocumentError(f"{where} is {number}: need 0 to {CUSTOM - 1}, or {CUSTOM} with angles")
    return MOUNTINGS.rotation(max(number, 1) - 1)


def _proposed_words(model: Model, source: str) -> str:
    """The proposed ``align_mag``, in words."""
    rotation = _proposed_rotation(model, source)
    if rotation is None:
        return "align_mag as it was"
    number = MOUNTINGS.mounting(rotation).number
    return f"align_mag = {turn_in_words(rotation) if number is None else MOUNTINGS.rows[number][0]}"


def _triple(vector: Vector) -> Floats:
    """(3,) array of a vector."""
    return np.array([vector.x, vector.y, vector.z])


TARGETS: Final = (
    Target(
        name="betaflight-model",
        use="Betaflight model file, JSON",
        group="autopilots",
        suffix=".json",
        title=WHO,
        formula="m = soft_iron (raw - center)",
        unit=COUNTS,
        keeps="all",
        storage="decimal, all digits; hard_iron in whole counts of int16",
        source="betaflight-configurator, magModelExport.ts at 7cd82d45",
        acts="mapped",
        lengths="1 long, the radius",
        comment=None,
        mountings=MOUNTINGS,
        writes_noise=True,
        write=write,
        reader=TargetReader(
            rb'mag-characterization-model/|"ellipsoid_correction"\s*:',
            read,
            "a model file of Betaflight Configurator",
            states=proposals,
        ),
    ),
)
