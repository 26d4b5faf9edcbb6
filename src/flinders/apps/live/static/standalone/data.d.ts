import type { Layouts } from "./engine.js";

export type Severity = "note" | "limits" | "refuses";

/** A limit: a factor times the named quantity; the factor alone if the name is empty. */
export type Limit = [factor: number, of: string];

/** Row of the catalogue of findings: the sentences on a finding, and the number and limit that they state. */
export interface Row {
  code: string;
  said: string;
  why: string; // effect on the compass, in plain words
  remedy: string;
  affects: "error" | "attitudes" | "claim" | "use";
  alarm: boolean;
  number: string; // name of the quantity that the sentence states
  limit: Limit;
  values: string[]; // names of the values in its sentences
}

/** Tables and numbers of the program, made by `flinders.apps.live.standalone.engine.data`. */
export interface EngineData {
  layouts: Layouts;
  listed: number; // largest number of listed runs of outliers
  rows: Row[]; // in the order of the engine
  quantities: string[];
  numbers: Record<string, number>;
  answers: ("holds" | "fails" | "cannot-tell")[]; // answers to "does the calibration still hold?", by the engine's number
  said: Record<string, string>;
  conditions: string[]; // conditions of a verdict, one for each bit of a judgement
  resting: string[]; // words for each combination of these bits
  parameters: string[];
  leads: Record<string, string>; // first words of a verdict, by its kind
  reaches: [below: number | null, reach: string, beyond: string][]; // words on the tilt up to which headings are good
  steps: Record<string, string>; // instructions for the next step, by name
  reasons: Record<string, string>; // causes of a large heading error, by the name of the remedy
  poses: Record<"sensor" | "vehicle", string[]>; // attitudes, as the words after "hold it"
  turns: Record<"sensor" | "vehicle", [right: string, left: string][]>; // turns about x, y and z, right-handed and left-handed
  swaps: string[]; // words on the changed axes, by the engine's number of the swap
}
