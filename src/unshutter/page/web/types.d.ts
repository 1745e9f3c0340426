// The shapes of what the program sends (page/app.py and its jobs), and of what the page's modules hand each other. For
// the type checker alone (make script): nothing here is sent to the browser.

import type { Clip } from "./clip.js";
import type { Photo } from "./photo.js";

// ---- what the program sends ----

export type Readout = "top-to-bottom" | "bottom-to-top" | "left-to-right" | "right-to-left";
export type Arrow = "down" | "up" | "right" | "left";
export type Box = [left: number, top: number, right: number, bottom: number]; // shares of width and height
export type Segment = [x1: number, y1: number, x2: number, y2: number];
export type Segments = { before: Segment[]; after?: Segment[] };
export type Certainty = "sure" | "likely" | "tentative" | "doubtful";
export type Edges = "auto" | "keep" | "crop" | "fill" | "borrow";
export type Advised =
  | "adviceWay"
  | "adviceLevel"
  | "adviceAnyway"
  | "adviceNeighbour"
  | "adviceByHand"
  | "adviceNeighbours"
  | "adviceLeaveNeighbours";

export interface Reason {
  code: string;
  sentence: string;
}

export interface Refusal {
  error: string;
  said?: string[]; // the same taken apart: text and names of options in turn
  sentence?: string; // in the page's words, where there is a reason
  advice?: Advised[];
}

export interface About {
  max_bytes: number;
  max_clip_bytes: number;
  clips: boolean;
  install_clips: string;
}

export interface PhotoFacts {
  width: number;
  height: number;
  arrows: Record<Readout, Arrow>;
  hdr_formats: string[]; // in which a result is HDR; empty: the photo is SDR
}

export interface ClipFacts {
  width: number;
  height: number;
  duration_s: number;
  fps: number;
  moments_s: number[];
  encoders: Encoders;
}

/** What this machine can write for a clip. */
export interface Encoders {
  own: string; // encoder of the clip's own codec
  keeps_rate: boolean; // whether it keeps the clip's bits per second
  usual: string[];
  described: Record<string, { presets: string[]; crf: number[] }>; // CRF: visually lossless, smaller
}

export interface PhotoResult {
  changed: boolean;
  largest_px: number;
  confidence: number | null;
  certainty: Certainty | null;
  doubted: boolean; // whether that asks for a look
  upright?: { roll_deg: number; tilt_deg: number | null };
  reason?: string; // in the page's words, where its motion is not undone
  code?: string;
  advice?: Advised[];
  lean_deg?: number; // by how much levelling would turn it, where that is advised
  lean_error_deg?: number; // standard deviation of that angle
  edges: Edges | null;
  area_left: number | null;
  little_left: boolean;
  crop: Box | null;
  neighbours?: true;
  ratio?: { value: number; source: string } | null; // readout ratio that its neighbours were used with
  shape: Shape | null;
  readout: Readout;
  lines?: (LineTrouble | null)[];
  attitude?: { roll_deg: number | null; tilt_deg: number | null; from: string };
  film?: Reason | null;
  tx_px?: number[];
  rz_deg?: number[];
}

export type Shape = { lean_deg: number; bend_percent: number; turn_deg: number };
export type LineTrouble = "sideways" | "contradicts";

export interface Candidate {
  kind: "still" | "pan" | "hand" | "quadratic" | "other";
  direction: "left" | "right" | "up" | "down" | null;
  largest_px: number;
  visible: boolean; // whether it is the photo as it is, or moves places by so much that it is seen
  within_error: boolean;
  probability: number | null;
  certainty: Certainty | null;
  taken: boolean;
  blob?: Blob; // its small picture, once that is there
  crop?: Box | null;
}

export interface ClipResult {
  changed: boolean;
  largest_px: number;
  edges: Edges;
  reason: string;
  crop?: null;
}

export interface ReadoutTime {
  ratio: number;
  ms: number;
  ms_sd: number;
  found_by: string;
  cameras: string;
  direction: string;
  wobble_px: number | null;
  plausible_ms: [number, number] | null;
  left: boolean;
}

export interface Progress {
  what?: string;
  done?: number;
  total?: number;
  share?: number; // of the whole work; it never falls
  left_s?: number | null; // null: not known yet
}

export interface Saving {
  id: string;
  to: "file" | "zip";
  state: "working" | "finished" | "cancelled" | "failed";
  total: number;
  now: (Progress & { name: string; what: string }) | null;
  done: Saved[];
  error?: string;
}

/** What became of a part of a clip's file. */
export interface FilePart {
  name: string;
  fate: string;
  reason?: string;
}

export interface Saved extends Partial<Refusal> {
  name: string;
  result?: string;
  frames?: number;
  rectified?: number;
  left_out?: string[];
  as_they_were?: string[];
  parts?: FilePart[];
  declined?: string[];
}

export interface Schema {
  type: "boolean" | "integer" | "number" | "string";
  description: string;
  group: string;
  enum?: string[];
  titles?: Record<string, string>; // of values of enum, where they have any
  examples: string[];
  default?: string | number | boolean;
  minimum?: number;
  maximum?: number;
  bare?: number; // what it means without a value
}

// ---- what modules hand each other ----

export type Kind = "photo" | "clip";
export type Item = Photo | Clip;
export type Point = [x: number, y: number];
export type Which = "before" | "after";
export type Options = Record<string, string>; // name of the field -> text, as on the command line
export type Picture = { blob: Blob; longest: Longest };
export type Longest = number | "full";
export type LineKind = "upright" | "level" | "straight";
export type Line = { kind: LineKind; points: Point[] };
export type Pull = "lean" | "bend" | "turn";
export type Tool = Pull | LineKind;
export type Doing = { share: number; left: string };
export type Notice = (line: string, details?: string) => void; // which a pointer over it shows

/** A control: what goes on the page, what has the value, and what brings it up to date. */
export interface Control {
  node: HTMLElement;
  field: HTMLInputElement | HTMLSelectElement;
  show(options: Options): void;
}

/** What a button of a row of pictures shows. */
export interface Choice {
  lines: string[];
  label?: string;
  title?: string;
  pressed: boolean;
  blob?: Blob;
  crop?: Box | null;
  chance?: number | null;
  coming?: boolean;
}

export type Attributes = Record<string, unknown>;
export type Part = Node | string | null | false | undefined | Attributes;
type Tag = keyof HTMLElementTagNameMap;
export type Made<S extends string> = S extends Tag
  ? HTMLElementTagNameMap[S]
  : S extends `${infer T extends Tag}.${string}`
    ? HTMLElementTagNameMap[T]
    : never;
