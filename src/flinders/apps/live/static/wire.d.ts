// Generated from flinders/apps/live/messages.py: python -m tests.message_types > wire.d.ts

/** A target that a calibration can be exported for. */
export interface TargetInfo {
  name: string;
  title: string;
  suffix: string;
}

/** What a page may send. */
export interface Limits {
  upload_bytes: number;
}

/** Where readings come from, and whether they do. */
export interface SourceState {
  name: string;
  kind: "serial" | "udp" | "tcp" | "mavlink" | "replay" | "simulated" | "phone" | "file";
  link: "connected" | "waiting" | "gone" | "ended";
  words: string;
}

/** The field at a place, and how the sensor is mounted in it. */
export interface Site {
  strength?: number | null;
  inclination_deg?: number | null;
  gain_sigma?: number;
  inclination_sigma_deg?: number;
  z_down?: boolean;
  alignment_sigma_deg?: number | null;
  length?: number | null;
}

/** What a person did in a session, and the site of its log; readings up to `begun_s` were left behind. */
export interface Edits {
  type: "edits";
  excluded: Array<[number, number]>;
  paused_s: number | null;
  finished_s: number | null;
  begun_s: number | null;
  target_deg: number;
  dip_deg: number | null;
  goal: "heading" | "attitude";
  site: Site | null;
  refreshing: boolean;
}

/** A calibration from before: name and text of its file, and its number in this session; all empty for none. */
export interface Previous {
  type: "previous";
  name: string;
  text: string;
  number: string;
}

/** The first message on a connection: all but the readings, which follow. */
export interface Welcome {
  type: "welcome";
  version: string;
  session: string;
  targets: Array<TargetInfo>;
  limits: Limits;
  source: SourceState;
  axes: string;
  recording: string;
  unrecorded: string;
  has_board: boolean;
  edits: Edits;
  previous: Previous;
}

/** The edits that the server holds, after `heard` messages from the page that this is sent to. */
export interface Kept {
  type: "kept";
  edits: Edits;
  heard: number;
}

/** The link to the source has changed. */
export interface Linked {
  type: "source";
  source: SourceState;
}

/** Why what arrives cannot be written down at present; nothing where it can. */
export interface Unrecorded {
  type: "unrecorded";
  words: string;
}

/** Something to tell the person at the page, once. */
export interface Notice {
  type: "notice";
  severity: "info" | "warning" | "error";
  words: string;
}

export type FromServer = Welcome | Kept | Previous | Linked | Unrecorded | Notice;
