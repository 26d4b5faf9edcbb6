/** What is drawn of a fit, as `flinders.report.view` writes it, and of its readings. */

/** The tiles, sent once. */
export interface TilesView {
  centres: Array<number>;
  corners: Array<Array<number>>;
}

/** Heading error to expect, 1 σ, in degrees, and what it is for. */
export interface HeadingErrorView {
  rms: number;
  worst: number;
  bound_95: number;
  dip_deg: number;
  dip_assumed: boolean;
  target_deg: number;
}

/** An error in degrees. */
export interface ErrorView {
  rms: number;
  worst: number;
}

/** A finding, as `flinders.findings.Finding`. */
export interface FindingView {
  code: string;
  severity: "note" | "limits" | "refuses";
  number: number | null;
  limit: number | null;
  advice: string;
  values?: Record<string, any>; // of its plain words, for other languages
}

/** Distances of the readings used from the surface, counted; what lies beyond the ends is in the outermost bins. */
export interface ResidualHistogram {
  edges: Array<number>;
  counts: Array<number>;
}

/** A level turn of a vehicle. */
export interface LevelTurn {
  heading_deg: Array<number>;
  before_deg: Array<number>;
  sigma_deg: Array<number>;
}

/** Which way to turn next. */
export interface GuidanceView {
  direction: [number, number, number] | null;
  words: string;
  worst_deg: number;
  after_deg: number;
  goal: "heading" | "attitude";
  frame: "vehicle" | "sensor";
  is_path: boolean;
  code: string; // of words without a direction, for pages in other languages
}

/** The correction that readings are drawn under, for drawing only: ``matrix @ (raw - offset) / strength``. */
export interface Shown {
  offset: [number, number, number];
  matrix: [[number, number, number], [number, number, number], [number, number, number]];
  strength: number;
}

/** One fit as it is drawn; what cannot be trusted is None. */
export interface View {
  verdict: "good" | "limited" | "refused";
  sentence: string;
  condition: string;
  method: string;
  unit: string;
  field_strength: number | null;
  field_strength_known: boolean;
  offset: [number, number, number] | null;
  offset_sigma: [number, number, number] | null;
  matrix: [[number, number, number], [number, number, number], [number, number, number]] | null;
  matrix_sigma: [[number, number, number], [number, number, number], [number, number, number]] | null;
  noise: number | null;
  samples: number;
  heading_error_deg: HeadingErrorView | null;
  uncorrected_heading_error_deg: ErrorView | null;
  attitude_limit_deg: number | null;
  any_attitude_deg: ErrorView | null;
  findings: Array<FindingView>;
  tiles_deg: Array<number | null>;
  level_deg: Array<number | null> | null;
  tiles_seen: Array<number>;
  rejected: Array<[number, number]>;
  residuals: ResidualHistogram | null;
  turn: LevelTurn | null;
  guidance: GuidanceView | null;
  shown: Shown | null;
}

/** Readings that are drawn. The arrays may be longer than `count`. */
export interface Points {
  count: number;
  time: Float32Array; // seconds since the session began
  field: Float32Array; // three numbers a reading, raw
  acceleration: Float32Array | null;
  stride: number; // point j is reading number j · stride
}

/** The newest reading. */
export interface Now {
  raw: [number, number, number];
  acceleration: [number, number, number] | null;
}
