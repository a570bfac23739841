// Signs: verdicts are told apart by shape and symbol, never by colour alone. Icons are lines in a 24 box.

import { s } from "./dom.js";
import { t } from "./texts.js";

const SHAPES = {
  good: ["circle", { cx: 16, cy: 16, r: 15 }, "M9 16.6l4.8 4.8L23 11.4"],
  bad: ["path", { d: "M10 1h12l9 9v12l-9 9H10l-9-9V10z" }, "M10.5 10.5l11 11M21.5 10.5l-11 11"],
  open: ["path", { d: "M16 .5L31.5 16 16 31.5.5 16z" }, "M12.4 12.8a3.7 3.7 0 1 1 5.4 3.3c-1.2.7-1.8 1.4-1.8 2.7M16 22.6v.4"],
  none: ["circle", { cx: 16, cy: 16, r: 15 }, "M10 16h12"],
  busy: ["circle", { cx: 16, cy: 16, r: 15 }, "M16 8v8l5.5 3.2"],
};

const ICONS = {
  home: "M3 11.5L12 4l9 7.5M5.5 9.8V20h13V9.8M10 20v-6h4v6",
  inspect: "M10.5 4.2a6.3 6.3 0 1 1 0 12.6 6.3 6.3 0 0 1 0-12.6zM15.2 15.2L20.5 20.5M7.8 10.6l2 2 3.6-4",
  calibrate: "M12 3v3M12 18v3M3 12h3M18 12h3M12 6.5a5.5 5.5 0 1 1 0 11 5.5 5.5 0 0 1 0-11zM12 12l2.4-2.4",
  results: "M5 4h14v16H5zM8.5 8.5h7M8.5 12h7M8.5 15.5h4",
  history: "M4 4v16h16M7 15l4-4.5 3 2.5 5-6.5",
  devices: "M4 6.5h10v7H4zM9 13.5v4M5.5 17.5h7M14 10h3l3.5-3v6L17 10",
  recipes: "M6 3.5h8.5L18.5 7.5v13H6zM14.5 3.5v4h4M9 12h6.5M9 15.5h6.5",
  next: "M9 5l7 7-7 7",
  back: "M15 5l-7 7 7 7",
  stop: "M8 3.5h8L20.5 8v8L16 20.5H8L3.5 16V8z",
  play: "M7 4.5l12 7.5-12 7.5z",
  warn: "M12 3.5L21.5 20h-19zM12 10v4.5M12 17v.3",
  down: "M12 4v11M7 10.5l5 5 5-5M5 20h14",
  open: "M13 5h6v6M19 5l-9 9M16 14v5H5V8h5",
  again: "M19.5 12a7.5 7.5 0 1 1-2.2-5.3M19.5 3.5v4h-4",
  out: "M14 4.5H5v15h9M10 12h10.5M17 8.5l3.5 3.5-3.5 3.5",
  plus: "M12 5v14M5 12h14",
  minus: "M5 12h14",
  sensor: "M7 3.5h10v5H7zM12 8.5L5 20M12 8.5L19 20M5 20h14",
  table: "M4 13c0-2.2 3.6-4 8-4s8 1.8 8 4-3.6 4-8 4-8-1.8-8-4zM4 13v3c0 2.2 3.6 4 8 4s8-1.8 8-4v-3M12 9V4",
  gear: "M10.4 5.0L10.5 2.3L13.5 2.3L13.6 5.0L15.2 5.6L17.1 3.6L19.4 5.6L17.8 7.7L18.6 9.2L21.3 8.8L21.8 11.8L19.2 12.4L18.9 14.1L21.1 15.5L19.6 18.2L17.3 16.9L15.9 18.0L16.7 20.6L13.9 21.6L12.9 19.1L11.1 19.1L10.1 21.6L7.3 20.6L8.1 18.0L6.7 16.9L4.4 18.2L2.9 15.5L5.1 14.1L4.8 12.4L2.2 11.8L2.7 8.8L5.4 9.2L6.2 7.7L4.6 5.6L6.9 3.6L8.8 5.6zM12 9a3 3 0 1 1 0 6 3 3 0 0 1 0-6z",
  turned: "M3 9.5h5v5H3zM8 7h8v10H8zM16 10h5v4h-5zM1 12h1.5M21.5 12H23",
  cad: "M12 3l8 4.5v9L12 21l-8-4.5v-9zM4 7.5l8 4.5 8-4.5M12 12v9",
};

/** The round, eight-sided or diamond sign of a verdict. */
export function mark(tone, kind = "") {
  const [shape, at, stroke] = SHAPES[tone];
  return s("svg", { class: `mark ${tone} ${kind}`, viewBox: "0 0 32 32", "aria-hidden": "true" },
    s(shape, { ...at, class: "shape" }), s("path", { d: stroke, class: "sign" }));
}

export function icon(name) {
  return s("svg", { class: "icon", viewBox: "0 0 24 24", "aria-hidden": "true" }, s("path", { d: ICONS[name] ?? ICONS.results }));
}

const TONES = {
  conforms: "good", valid: "good", holds: "good", answers: "good", done: "good", kept: "good",
  does_not_conform: "bad", untrusted: "bad", does_not_hold: "bad", silent: "bad", broken: "bad", failed: "bad", none: "bad",
  undecided: "open", expired: "open", changed: "open", unknown: "open", ended: "bad", aborted: "none", withdrawn: "none", corrected: "none", running: "busy",
};

/** Tone and word of a verdict, a calibration's status or a job's state. */
export function judged(word) {
  return { tone: TONES[word] ?? "none", word: TONES[word] ? t(`verdict.${word}`) : (word ?? t("verdict.nothing")) };
}

/** The same of a result as it stands today: one that was taken back, or is in doubt for its calibration, isn't green. */
export function standing(entry) {
  const said = judged(entry.verdict ?? entry.status);
  if (entry.standing === "in_doubt" && said.tone === "good") return { tone: "open", word: t("verdict.in_doubt", { verdict: said.word }) };
  return ["corrected", "withdrawn"].includes(entry.standing) ? judged(entry.standing) : said;
}
