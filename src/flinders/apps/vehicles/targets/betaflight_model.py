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

**Formula.** ``c = soft_iron (raw − center)``, raw in counts, so that c is `radius` long. One unit of c is the strength
of the field over the radius, in nT and gauss. Here the radius is 1, as the Configurator's fit of a unit sphere has it
but for a thousandth.

**Axes.** `alignment` is the proposed ``align_mag``, `captured_under` the one in force, and `hard_iron` the
``mag_calibration`` that goes with the proposed one. A file is in one of two axes, and `hard_iron` tells which:

    captured    hard_iron = A C⁻¹ (center + mag_zero)      as the description of the schema has it; written here
    sensor      hard_iron = A center                       as the Configurator's full calibration writes it

with A the proposed and C the captured rotation, R_z(yaw) R_y(pitch) R_x(roll). The corrected field of the vehicle is
A C⁻¹ c or A c. `frame` always says FRD; the numbers are for ``magADC``, which the firmware turns to the world as
forward, left and up (``flight/imu.c``), so nothing is mirrored here.

**Noise.** `residual_rms` is the white noise of a reading over the strength of the field: the Configurator takes it from
the lengths of corrected readings about the radius, which is that noise along the field. `mag_noise_gauss` is for the
measurement noise R of a filter, so that "a good calibration earns tight mag trust". It is therefore that noise and the
error of the calibration together, added as variances, as for EKF2_MAG_NOISE of PX4; the Configurator puts the noise
alone, which a poor calibration does not make larger. A filter takes R for white, and the error of a calibration is not:
it is the same in every reading of an attitude. Also with both in R a filter is too sure of a heading that it holds, and
the R that makes it right depends on its rate and its gyro (`flinders.targets._measurement_noise`); so a note of the
export states both parts.

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
from flinders.arrays import Floats, floats
from flinders.core.calibration_file import gaps, in_words
from flinders.core.units import COUNTS, MICROTESLA
from flinders.errors import DocumentError, figures
from flinders.targets._mounting import angles, euler
from flinders.targets._mounting import in_words as turn_in_words
from flinders.targets._numbers import BEYOND_ALL, VEHICLE, Affine, in_16_bits, in_vehicle_axes, loaded, unmapped
from flinders.targets._target import ExportOptions, Target, TargetReader, Written

if TYPE_CHECKING:
    from flinders.core.calibration import Calibration
    from flinders.core.calibration_file import Triple
    from flinders.targets._measurement_noise import MeasurementNoise

WHO: Final = "Betaflight's model file"
CUSTOM: Final = 9
"""``align_mag`` that has angles; 1 to 8 are the rows of `MOUNTINGS`, 0 is taken for 1."""
LABELS: Final = tuple(f"CW {angle}°{flip}" for flip in ("", " flip") for angle in (0, 90, 180, 270))
"""Of the presets 1 to 8."""
MOST_OFF: Final = 2.0
"""Counts: an axis of `hard_iron`, which is in whole counts, fits `center` to within this."""


# written


def write(calibration: Calibration, asked: ExportOptions) -> Written:
    """Write the model; a recording that was not in raw counts raises `UnitError`.

    A rotation of the calibration goes into `alignment` if the mounting in force is known, else into `soft_iron`. Raises
    `NotExportable` where int16 cannot hold the offset, which the board needs as ``mag_calibration``.
    """
    in_place = in_vehicle_axes(calibration)
    affine = Affine.of(in_place, COUNTS, who=WHO)
    in_force = _in_force(asked.mounting)
    new = remounting(in_place, in_force, MOUNTINGS, after=True)
    turn = np.eye(3) if new is None else new.turn
    soft_iron = turn.T @ affine.matrix / affine.strength
    proposed = in_force if new is None else new.mounting.rotation
    residual, noise = _noise(in_place, asked.noise)
    strength_nt = _strength_nt(in_place)
    model = Model(
        captured_under=None if in_force is None else _captured(in_force),
        ellipsoid_correction=EllipsoidCorrection(
            center=_vector(affine.offset), soft_iron=_rows(soft_iron), radius=1.0, residual_rms=residual
        ),
        geo_reference=GeoReference(inclination_deg=_dip(asked.noise), field_strength_nt=strength_nt),
        alignment=None if proposed is None else _alignment(proposed),
        hard_iron=_vector(floats(in_16_bits(turn @ affine.offset, NAMES))),
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
    """The block for a filter, of corrected readings that are 1 long; without a declination no field of the earth."""
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
"""Parts of the field strength: 1 σ of a corrected reading, noise and error of the calibration together, across the
horizontal field, of x and y, and of z."""


def _noise(calibration: Calibration, noise: MeasurementNoise | None) -> tuple[float | None, Noise]:
    """White noise of a corrected reading over the field strength, and `Noise`; None where nothing is known."""
    if noise is None:
        return None, None
    back, strength = unmapped(calibration), calibration.field_strength
    x, y, z = np.diag(back @ noise.field_covariance @ back.T)
    both = noise.across / strength, float(np.sqrt((x + y) / 2)) / strength, float(np.sqrt(z)) / strength
    return noise.reading / strength, both


def _strength_nt(calibration: Calibration) -> float | None:
    """Field strength; None where it is relative, or in counts."""
    is_known = calibration.field_strength_known and calibration.unit == MICROTESLA
    return 1e3 * calibration.field_strength if is_known else None


def _dip(noise: MeasurementNoise | None) -> float | None:
    """Dip of the field where the readings were taken."""
    return None if noise is None or noise.dip_assumed else noise.dip_deg


def _in_force(mounting: Floats | None) -> Floats | None:
    """(3, 3) mounting of the recording: that of the row where it is one."""
    row = None if mounting is None else MOUNTINGS.mounting(mounting)
    return mounting if row is None or row.number is None else row.rotation


def _captured(in_force: Floats) -> CapturedUnder:
    """The mounting of the recording; no log tells ``mag_calibration``."""
    number = MOUNTINGS.mounting(in_force).number
    if number is not None:
        return CapturedUnder(alignment=number + 1)
    return CapturedUnder(alignment=CUSTOM, custom_angles=_euler(in_force))


def _alignment(proposed: Floats) -> Alignment:
    """A mounting by its number, name and angles."""
    number = MOUNTINGS.mounting(proposed).number
    preset, label = (CUSTOM, "CUSTOM") if number is None else (number + 1, LABELS[number])
    return Alignment(preset=preset, label=label, euler_zyx_deg=_euler(proposed))


def _euler(rotation: Floats) -> EulerAngles:
    """Angles of a rotation."""
    roll, pitch, yaw = (angle + 0.0 for angle in angles(rotation))
    return EulerAngles(roll=roll, pitch=pitch, yaw=yaw)


def _vector(values: Floats) -> Vector:
    """(3,) numbers by axis."""
    x, y, z = (values + 0.0).tolist()
    return Vector(x=x, y=y, z=z)


def _rows(matrix: Floats) -> tuple[Triple, Triple, Triple]:
    """(3, 3) rows."""
    one, two, three = (tuple(row) for row in (matrix + 0.0).tolist())
    return one, two, three


def _notes(model: Model, calibration: Calibration, noise: MeasurementNoise | None) -> list[str]:
    """What the file has no room for, and what is null in it."""
    recorded = "for readings recorded with mag_calibration = 0,0,0, as magADC of a blackbox has them"
    notes = [
        f"{recorded}; frame says FRD as the schema does, and nothing is mirrored",
        "latitude, longitude, declination and the earth's field are null: a calibration does not keep its place",
    ]
    if model.alignment is None:
        notes.append("alignment and captured_under are null: nobody said how the compass was mounted (align_mag)")
    if model.geo_reference.field_strength_nt is None:
        notes.append(
            "field strength, scale and noise in gauss are null: calibrate with the microtesla in one count and the "
            "field strength of the place"
        )
    return [*notes, _noise_words(calibration, noise)]


def _noise_words(calibration: Calibration, noise: MeasurementNoise | None) -> str:
    """The two parts of the noise."""
    if noise is None:
        return "residual_rms and noise are null: the calibration states no noise, or no uncertainty"
    across = noise.horizontal * math.radians(noise.heading_calibration_deg)
    reading, rest = (100.0 * part / calibration.field_strength for part in (noise.reading, across))
    return (
        f"residual_rms is the white noise of a reading, {figures(reading)} % of the field (heading "
        f"{figures(noise.heading_reading_deg)}° level); mag_noise_gauss has the error of the calibration in it, "
        f"{figures(rest)} % across the horizontal field (heading {figures(noise.heading_calibration_deg)}°): that is "
        "alike in every reading of an attitude, and a filter takes it for white"
    )


# read back


def read(content: bytes, source: str, *, strength: float | None = None) -> Calibration:
    """Read a model, in counts: for ``magADC`` with the proposed ``align_mag`` and ``mag_calibration = 0,0,0``.

    `strength`, counts: length of corrected readings; without it that which makes the determinant of the matrix 1, since
    the microtesla in one count are those of this one fit (`proposals` tells them).

    Raises `DocumentError` for a file of another schema, one that is damaged, and one whose `hard_iron` does not belong
    to its `center`.
    """
    model = _model(content, source)
    correction = model.ellipsoid_correction
    turn, offset = _in_proposed_axes(model, source)
    matrix = turn @ floats(correction.soft_iron) @ turn.T / correction.radius
    length = _length(correction, source) if strength is None else strength
    affine = Affine(length * matrix, offset, length)
    return replace(affine.to_calibration(COUNTS, known=strength is not None), frame=VEHICLE)


def _length(correction: EllipsoidCorrection, source: str) -> float:
    """Counts: length of the readings, less the offset: the geometric mean of the radii of their ellipsoid."""
    with np.errstate(all="ignore"):
        determinant = abs(float(np.linalg.det(floats(correction.soft_iron))))
    if not 0.0 < determinant < BEYOND_ALL:
        raise DocumentError(
            f"{source}: soft_iron has a determinant of {determinant:.2g}: need one that corrects all three axes"
        )
    return correction.radius / float(determinant ** (1 / 3))


def proposals(content: bytes, source: str) -> list[str]:
    """What a model states beside the calibration, in words; raises as `read`."""
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
        words.append("! mag_calibration at its recording was not known, and is taken for 0,0,0")
    return words


def _model(content: bytes, source: str) -> Model:
    """Understand a file."""
    fields = loaded(content, source)
    for place in gaps(fields):
        raise DocumentError(f"{source}: {place} is not finite: need a number")
    version = fields.get("version")
    if version != VERSION:
        raise DocumentError(
            f"{source}: schema version is {version!r}, need {VERSION!r}, which the full calibration of Betaflight "
            "Configurator exports: run that, and export its model"
        )
    if fields.get("ellipsoid_correction") is None:
        raise DocumentError(f"{source}: has no ellipsoid_correction: run the full calibration, then export its model")
    try:
        return msgspec.convert(fields, Model)
    except msgspec.ValidationError as error:
        raise DocumentError(f"{source}: {in_words(error)}") from None


def _in_proposed_axes(model: Model, source: str) -> tuple[Floats, Floats]:
    """(3, 3) from the axes of the file to those of the proposed mounting, and (3,) the offset there, in counts.

    Of the two axes that a file may be in, those in which the offset comes nearest to `hard_iron`.
    """
    captured, proposed = _rotations(model, source)
    centre, hard = (_triple(vector) for vector in (model.ellipsoid_correction.center, model.hard_iron))
    under = model.captured_under
    zero = np.zeros(3) if under is None or under.mag_zero is None else _triple(under.mag_zero)
    across = proposed @ captured.T
    found = [(across, across @ (centre + zero)), (proposed, proposed @ centre)]
    off = [float(np.abs(offset - hard).max()) for _, offset in found]
    if not min(off) <= MOST_OFF:
        raise DocumentError(
            f"{source}: hard_iron is {figures(min(off), 3)} counts from the center in the axes of alignment, need "
            f"{MOST_OFF:.0f} or less: one of them was changed, export the model again"
        )
    if max(off) <= MOST_OFF and not np.array_equal(captured, np.eye(3)):
        raise DocumentError(
            f"{source}: center and hard_iron fit each other both before and after captured_under.alignment, so that "
            "the axes of soft_iron cannot be told: record with align_mag = CW0, and export the model again"
        )
    return found[off.index(min(off))]


def _rotations(model: Model, source: str) -> tuple[Floats, Floats]:
    """(3, 3) mounting in force and proposed one: each that of the other where it is not stated."""
    captured = _captured_rotation(model, source)
    proposed = _proposed_rotation(model, source)
    if captured is None:
        captured = np.eye(3) if proposed is None else proposed
    return captured, captured if proposed is None else proposed


def _captured_rotation(model: Model, source: str) -> Floats | None:
    """(3, 3) mounting in force."""
    under = model.captured_under
    if under is None:
        return None
    return _rotation(under.alignment, under.custom_angles, f"{source}: captured_under.alignment")


def _proposed_rotation(model: Model, source: str) -> Floats | None:
    """(3, 3) proposed mounting."""
    asked = model.alignment
    return None if asked is None else _rotation(asked.preset, asked.euler_zyx_deg, f"{source}: alignment.preset")


def _rotation(number: int, own: EulerAngles | None, where: str) -> Floats:
    """(3, 3) of a number of ``align_mag``, or of angles."""
    if number == CUSTOM and own is not None:
        return euler(own.roll, own.pitch, own.yaw)
    if not 0 <= number < CUSTOM:
        raise DocumentError(f"{where} is {number}: need 0 to {CUSTOM - 1}, or {CUSTOM} with angles")
    return MOUNTINGS.rotation(max(number, 1) - 1)


def _proposed_words(model: Model, source: str) -> str:
    """The proposed ``align_mag``."""
    rotation = _proposed_rotation(model, source)
    if rotation is None:
        return "align_mag as it was"
    number = MOUNTINGS.mounting(rotation).number
    return f"align_mag = {turn_in_words(rotation) if number is None else MOUNTINGS.rows[number][0]}"


def _triple(vector: Vector) -> Floats:
    """(3,)."""
    return np.array([vector.x, vector.y, vector.z])


TARGETS: Final = (
    Target(
        name="betaflight-model",
        use="Betaflight model file, JSON",
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
        write=write,
        reader=TargetReader(
            rb'mag-characterization-model/|"ellipsoid_correction"\s*:',
            read,
            "a model file of Betaflight Configurator",
            states=proposals,
        ),
    ),
)
