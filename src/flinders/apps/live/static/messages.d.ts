/** What the page is told by its session, and what it asks of it. */

import type { TilesView, View } from "../../../static/view.d.ts";
import type { Limits, SourceState, TargetInfo } from "./wire.d.ts";

export type { Limits, SourceState, TargetInfo };

/** Something that is wrong, or worth knowing, what to do about it, and intervals that a person may leave out. */
export interface Reason {
  code: string;
  advice: string;
  severity: "info" | "warning";
  spans: Array<[number, number]>;
  values?: Record<string, any>; // of its sentence in another language
}

/** A calibration from before, and how far the present one is off it, at the worst level heading. */
export interface PreviousState {
  name: string;
  change_deg: number | null;
  words: string;
  code?: string; // of the words, for pages in other languages
  values?: Record<string, string>; // of the words
}

/** What a page shows, without the fit and the points. */
export interface SessionState {
  kept: { seconds: number; is_changed: boolean } | null; // the best fit that was within the target, and its moment
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
  finished: { seconds: number; since: number } | null; // time of the last reading of the calibration, and how many came later
  recording: string | null;
  previous: PreviousState | null;
  refreshing: boolean;
  opened: string | null;
  can_send: boolean;
}

/** Of the program, and what it can do. */
export interface Greeting {
  version: string;
  targets: Array<TargetInfo>;
  limits: Limits;
}

/** The first message: all there is. */
export interface Hello extends Greeting {
  type: "hello";
  tiles: TilesView;
  state: SessionState;
  view: View | null;
}

/** A new fit; null where there is none. */
export interface FitMessage {
  type: "fit";
  view: View | null;
}

/** Something to tell the person at the page, once. */
export interface Notice {
  type: "notice";
  severity: "info" | "warning" | "error";
  words: string;
}

/** The worst heading error that is good enough. */
export interface SetTarget {
  type: "target";
  deg: number;
}

/** The inclination of the field at the site. */
export interface SetDip {
  type: "dip";
  deg: number;
}

/** The site in degrees, north and east positive, and the year: its inclination is taken from a model. */
export interface SetPlace {
  type: "place";
  latitude_deg: number;
  longitude_deg: number;
  year: number;
}

/** What the calibration is for. */
export interface SetGoal {
  type: "goal";
  goal: "heading" | "attitude";
}

/** Take a stretch of time out. */
export interface Exclude {
  type: "exclude";
  start_s: number;
  end_s: number;
}

/** Put a stretch of time back in. */
export interface Restore {
  type: "restore";
  start_s: number;
  end_s: number;
}

/** Take the last exclusion or restoration back. */
export interface Undo {
  type: "undo";
}

/** Do again what was taken back. */
export interface Redo {
  type: "redo";
}

/** Begin anew: what was received so far stays on the disk only. */
export interface Clear {
  type: "clear";
}

/** Keep no earlier fit: use all readings. */
export interface UseAll {
  type: "use_all";
}

/** Finish the calibration: it stays as it is, whatever arrives. */
export interface FinishCalibration {
  type: "finish";
}

/** Take in what came since the calibration was finished, and go on. */
export interface Collect {
  type: "collect";
}

/** Leave out what arrives until further notice. */
export interface Pause {
  type: "pause";
  paused: boolean;
}

/** Compare with no calibration from before. */
export interface PreviousClear {
  type: "previous_clear";
}

/** Keep the soft iron of the calibration from before, and find its hard iron anew; or no longer. */
export interface SetRefresh {
  type: "refresh";
  refresh: boolean;
}

/** Close the log that was opened. */
export interface BackToLive {
  type: "back_to_live";
}

export type FromSession = Hello | SessionState | FitMessage | Notice;

export type Command = SetTarget | SetDip | SetPlace | SetGoal | Exclude | Restore | Undo | Redo | Clear | UseAll | FinishCalibration | Collect | Pause | PreviousClear | SetRefresh | BackToLive;
