// The states of a photo or clip on the page, and which events lead from one to another: all of it is in this table.
// What is open (opened.js) goes by it; the view and the strip read it.

/** @import { Item } from "./types.js" */

/**
 * waiting: for the program, or for its turn. loading: its file is on the way to the program. finding: its pictures and
 * its motion are asked for. asking: a clip of which the program needs to be told more. done: the answer is there.
 * failed: the program cannot use it.
 * @typedef {"waiting" | "loading" | "finding" | "asking" | "done" | "failed"} State
 */
/**
 * send: its file is sent. wait: it was sent before its turn. look: it is asked about. answer: all is there. ask: the
 * program asks back. refuse: the program refuses it. change: it got options of another, and waits for its turn again.
 * @typedef {"send" | "wait" | "look" | "answer" | "ask" | "refuse" | "change"} Event
 */

/**
 * State -> event -> the next state; where none is named, an event changes nothing.
 * @type {Record<State, Partial<Record<Event, State>>>}
 */
export const TABLE = {
  waiting: { send: "loading", look: "finding", refuse: "failed" }, // an answer to what was asked before is none
  loading: { look: "finding", answer: "done", ask: "asking", wait: "waiting", refuse: "failed", change: "waiting" },
  finding: { send: "loading", answer: "done", ask: "asking", refuse: "failed", change: "waiting" },
  asking: { send: "loading", look: "finding", answer: "done", refuse: "failed", change: "waiting" },
  done: { send: "loading", look: "finding", ask: "asking", refuse: "failed", change: "waiting" },
  failed: { send: "loading", look: "finding", answer: "done", ask: "asking" },
};

/** @param {State} state @param {Event} event @returns {State} */
export const next = (state, event) => TABLE[state][event] ?? state;

/** States in which an answer is still to come. @type {State[]} */
export const AT_WORK = ["waiting", "loading", "finding"];
/** States in which there is something wrong that the page says. @type {State[]} */
export const WRONG = ["failed", "asking"];

/**
 * What the page shows as the state: of a photo that is done, how.
 * @param {Item} item @returns {State | "changed" | "alone"}
 */
export function shownState(item) {
  if (item.kind === "clip" || item.state !== "done") return item.state;
  return item.result?.changed ? "changed" : "alone";
}
