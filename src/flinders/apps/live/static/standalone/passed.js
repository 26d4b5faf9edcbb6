/** Unpacks readings of a server: `flinders.apps.live.messages.readings_frame`. */

import { COUNTS, MICROTESLA } from "./session.js";

/** @typedef {import("./buffer.js").Passed} Passed */
/** @typedef {import("./session.js").Unit} Unit */

const MAGIC = 0x464c4e44;
const HEADER_BYTES = 32;
const HAS_ACCELERATION = 1;
const IS_MICROTESLA = 2;
const IS_VEHICLE = 4;
const LATEST = 7;

/**
 * @param {ArrayBuffer} bytes
 * @param {number} [offset]  a multiple of eight
 * @returns {{passed: Passed, unit: Unit, frame: "sensor" | "vehicle", generation: number, isLast: boolean}}
 * @throws {Error} For other bytes.
 */
export function passedIn(bytes, offset = 0) {
    const [magic, generation, first, count, flags, stride, total, isLast] = new Uint32Array(bytes, offset, HEADER_BYTES / 4);
    const numbers = new Float64Array(bytes, offset + HEADER_BYTES);
    const isFelt = (flags & HAS_ACCELERATION) > 0;
    if (magic !== MAGIC || numbers.length !== LATEST + count * (isFelt ? 7 : 4)) throw new Error("the frame is not one of readings");
    const [latest, time] = [numbers.subarray(0, LATEST), numbers.subarray(LATEST, LATEST + count)];
    const rest = numbers.subarray(LATEST + count);
    const acceleration = isFelt ? rest.subarray(3 * count) : null;
    const passed = { first, stride, total, latest, time, field: rest.subarray(0, 3 * count), acceleration };
    const unit = flags & IS_MICROTESLA ? MICROTESLA : COUNTS;
    return { passed, unit, frame: flags & IS_VEHICLE ? "vehicle" : "sensor", generation, isLast: isLast > 0 };
}
