import type { Layouts } from "./engine.js";

export type Severity = "note" | "limits" | "refuses";

/** A factor, of a quantity or of one where its name is empty. */
export type Limit = [factor: number, of: string];

/** What is said of a finding of the engine. */
export interface Row {
  code: string;
  said: string;
  why: string; // in plain words
  remedy: string;
  affects: "error" | "attitudes" | "claim" | "use";
  alarm: boolean;
  number: string; // the quantity that is stated
  limit: Limit;
  values: string[]; // names of all that it and its sentence take
}

/** What `flinders.apps.live.standalone.engine.data` gives: the tables and numbers of the program. */
export interface EngineData {
  layouts: Layouts;
  listed: number; // runs of outliers, at most
  rows: Row[]; // in the order of the engine
  quantities: string[];
  numbers: Record<string, number>;
  answers: ("holds" | "fails" | "cannot-tell")[]; // whether a calibration holds, in the order of the engine
  said: Record<string, string>;
  conditions: string[]; // what a verdict may rest on, by bits
  resting: string[]; // in words, for each set of them
  parameters: string[];
  leads: Record<string, string>; // how a verdict begins
  reaches: [below: number | null, reach: string, beyond: string][]; // tilts up to which headings are good, in words
  steps: Record<string, string>; // what to do next, by name
  reasons: Record<string, string>; // why a heading error is large, by what would make it smaller
  poses: Record<"sensor" | "vehicle", string[]>; // after "hold it"
  turns: Record<"sensor" | "vehicle", [right: string, left: string][]>; // about x, y and z
  swaps: string[]; // axes that change, in the order of the engine
}
