import type { TilesView } from "../messages.d.ts";
import type { Layouts } from "./engine.js";

export type Severity = "note" | "limits" | "refuses";

/** A factor, of a quantity or of one where its name is empty. */
export type Limit = [factor: number, of: string];

/** A comparison of a quantity with limits, the least severe first, and what has to hold as well. */
export interface Rule {
  quantity: string;
  comparison: "<" | ">" | ">=";
  grades: [severity: Severity, factor: number, of: string][];
  needs: [quantity: string, comparison: "<" | ">" | ">=", factor: number, of: string][];
  number: string;
  limit: Limit | null;
}

/** A row of the catalogue of findings. */
export interface Row {
  code: string;
  is_of_recording: boolean; // it holds whatever the fit is worth
  rule: Rule;
  said: string;
  alarm: boolean;
}

/** A finding of a severity, or a worse one, and the findings that follow from it, unless another is there. */
export interface Cause {
  code: string;
  severity: Severity;
  consequences: string[];
  unless: string;
}

/** An attitude but for its heading: what points down, in words after "hold it", and the angles to judge by eye. */
export interface Pose {
  down: [number, number, number];
  words: string;
  effort: number;
}

/** What `flinders.standalone.engine.data` gives: the tables and numbers of the program. */
export interface EngineData {
  layouts: Layouts;
  rows: Row[];
  unchecked: string[];
  causes: Cause[];
  numbers: Record<string, number>;
  said: Record<string, string>;
  condition: string;
  conditions: string[];
  parameters: string[];
  disturbed: string[];
  at_once: string[];
  informative: string[];
  other_units: Record<string, number>;
  poses: Pose[];
  cells: [number, number, number][];
  nodes: [number, number, number][]; // of paths
  turns: [right: string, left: string][]; // about x, y and z
  tiles: TilesView;
  swaps: string[]; // axes that change, in the order of the engine
  shrinkage: { priors: number[][]; departures: number[]; parameters: number[]; size: number[] };
}
