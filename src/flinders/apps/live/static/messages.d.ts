/** Messages between the page and its session: the state and results for the page, and the commands of the user. */

import type { TilesView, View } from "../../../static/view.d.ts";
import type { Limits, SourceState, TargetInfo } from "./wire.d.ts";

export type { Limits, SourceState, TargetInfo };

/** A fault of the calibration or a remark on it, with the remedy, and intervals that the user may leave out (s). */
export interface Reason {
  code: string;
  advice: string;
  severity: "info" | "warning";
  spans: Array<[number, number]>;
  values?: Record<string, any>; // values for the braces of its sentence, by name; for translations
}

/** An earlier calibration, and the present calibration's difference from it, at the worst level heading. */
export interface PreviousState {
  name: string;
  change_deg: number | null;
  words: string;
  code?: string; // of the words, for pages in other languages
  values?: Record<string, string>; // of the words
}

/** State of a session for the page, without the fit and the points. */
export interface SessionState {
  kept: { seconds: number; is_changed: boolean } | null; // the best fit within the target, and the time of its last reading
  type: "state";
  source: SourceState;
  unit: string;
  readings: number;
  used: number;
  rejected: number;
  excluded_readings: number;
  rate_hz: number | null;
  seconds: number | null;
  phase: "waiting" | "collecting" | "good" | "limited" | "wrong";
  words: string;
  told: string | null;
  reasons: Array<Reason>;
  target_deg: number;
  dip_deg: number;
  dip_assumed: boolean;
  goal: "heading" | "attitude";
  excluded: Array<[number, number]>;
  can_undo: boolean;
  can_redo: boolean;
  stride: number;
  paused: boolean;
  finished: { seconds: number; since: number } | null; // time of the last reading of the calibration, and number of later readings
  recording: string | null;
  previous: PreviousState | null;
  refreshing: boolean;
  opened: string | null;
  can_send: boolean;
}

/** Facts on the program: version, export targets and limits. */
export interface Greeting {
  version: string;
  targets: Array<TargetInfo>;
  limits: Limits;
}

/** The first message to the page: the complete state. */
export interface Hello extends Greeting {
  type: "hello";
  tiles: TilesView;
  state: SessionState;
  view: View | null;
}

/** A new fit; null if the readings have none. */
export interface FitMessage {
  type: "fit";
  view: View | null;
}

/** A notice, shown once to the user. */
export interface Notice {
  type: "notice";
  severity: "info" | "warning" | "error";
  words: string;
}

/** Command: set the target, the largest acceptable heading error at the worst heading. */
export interface SetTarget {
  type: "target";
  deg: number;
}

/** Command: set the dip of the field at the site. */
export interface SetDip {
  type: "dip";
  deg: number;
}

/** Command: set the place and the year, for the dip by the World Magnetic Model. North and east are positive. */
export interface SetPlace {
  type: "place";
  latitude_deg: number;
  longitude_deg: number;
  year: number;
}

/** Command: set the goal, headings of a level vehicle or directions at any attitude. */
export interface SetGoal {
  type: "goal";
  goal: "heading" | "attitude";
}

/** Command: exclude the readings of an interval from the fit. */
export interface Exclude {
  type: "exclude";
  start_s: number;
  end_s: number;
}

/** Command: use the excluded readings of an interval again. */
export interface Restore {
  type: "restore";
  start_s: number;
  end_s: number;
}

/** Command: undo the last exclusion or restoration. */
export interface Undo {
  type: "undo";
}

/** Command: redo the step that was undone last. */
export interface Redo {
  type: "redo";
}

/** Command: restart without readings. A recording keeps the earlier readings. */
export interface Clear {
  type: "clear";
}

/** Command: drop the kept fit, so that the fit of all readings counts. */
export interface UseAll {
  type: "use_all";
}

/** Command: finish the calibration. Later readings do not change it. */
export interface FinishCalibration {
  type: "finish";
}

/** Command: include the readings since Finish, and continue. */
export interface Collect {
  type: "collect";
}

/** Command: begin or end a pause, whose readings are excluded. */
export interface Pause {
  type: "pause";
  paused: boolean;
}

/** Command: end the comparison with the earlier calibration. */
export interface PreviousClear {
  type: "previous_clear";
}

/** Command: renew the earlier calibration (keep its soft iron, estimate the hard iron again), or end that. */
export interface SetRefresh {
  type: "refresh";
  refresh: boolean;
}

/** Command: close the opened log, and show the sensor again. */
export interface BackToLive {
  type: "back_to_live";
}

export type FromSession = Hello | SessionState | FitMessage | Notice;

export type Command = SetTarget | SetDip | SetPlace | SetGoal | Exclude | Restore | Undo | Redo | Clear | UseAll | FinishCalibration | Collect | Pause | PreviousClear | SetRefresh | BackToLive;
