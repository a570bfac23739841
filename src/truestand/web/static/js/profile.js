// What a sensor sees right now, as a line on a canvas: x to the right, the sensor above.

import { colour, h } from "./dom.js";
import { number } from "./format.js";
import { t } from "./texts.js";

const [LEFT, BOTTOM, TOP, RIGHT] = [64, 40, 14, 18];

/** A canvas with `draw(profile)`; it keeps its scale while the part goes by, so that the picture stands still. */
export function profileView(name) {
  const canvas = h("canvas", { class: "profile", role: "img", "aria-label": t("live.profile", { name }) });
  let range = null;
  let last = null;
  new ResizeObserver(() => range && paint(canvas, last, range)).observe(canvas);
  return {
    element: canvas,
    draw(profile) {
      range = grown(range, profile);
      last = profile;
      if (range) paint(canvas, profile, range);
    },
  };
}

/** The widest range seen, letting go slowly of what is gone. */
function grown(range, { x, z }) {
  const seen = z.filter((v) => v !== null);
  if (!seen.length) return range;
  const now = { x0: Math.min(...x), x1: Math.max(...x), z0: Math.min(...seen), z1: Math.max(...seen) };
  const room = Math.max(0.5, 0.12 * (now.z1 - now.z0));
  const [z0, z1] = [now.z0 - room, now.z1 + room];
  if (!range) return { ...now, z0, z1 };
  return { x0: Math.min(range.x0, now.x0), x1: Math.max(range.x1, now.x1),
    z0: Math.min(z0, range.z0 + 0.03 * (z0 - range.z0)), z1: Math.max(z1, range.z1 + 0.03 * (z1 - range.z1)) };
}

function paint(canvas, { x, z }, range) {
  const sharp = Math.min(devicePixelRatio || 1, 2);
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * sharp) || canvas.height !== Math.round(height * sharp))
    [canvas.width, canvas.height] = [Math.round(width * sharp), Math.round(height * sharp)];
  const pen = canvas.getContext("2d");
  pen.setTransform(sharp, 0, 0, sharp, 0, 0);
  pen.clearRect(0, 0, width, height);
  const right = (v) => LEFT + ((v - range.x0) / (range.x1 - range.x0 || 1)) * (width - LEFT - RIGHT);
  const down = (v) => TOP + ((v - range.z0) / (range.z1 - range.z0)) * (height - TOP - BOTTOM);
  grid(pen, range, right, down, width, height);
  pen.strokeStyle = colour("trace");
  pen.lineWidth = 3;
  pen.lineJoin = pen.lineCap = "round";
  pen.beginPath();
  let up = true;
  x.forEach((at, i) => {
    if (z[i] === null) return (up = true);
    pen[up ? "moveTo" : "lineTo"](right(at), down(z[i]));
    return (up = false);
  });
  pen.stroke();
}

function grid(pen, range, right, down, width, height) {
  pen.lineWidth = 1;
  pen.strokeStyle = colour("line");
  pen.fillStyle = colour("soft");
  pen.font = `${0.85 * parseFloat(getComputedStyle(document.documentElement).fontSize)}px ${getComputedStyle(document.body).fontFamily}`;
  pen.textAlign = "center";
  for (const v of ticks(range.x0, range.x1, Math.max(3, width / 130))) {
    line(pen, right(v), TOP, right(v), height - BOTTOM);
    pen.fillText(number(v, 0), right(v), height - BOTTOM + 20);
  }
  pen.textAlign = "right";
  const step = ticks(range.z0, range.z1, Math.max(2, height / 70));
  const decimals = step.length > 1 && step[1] - step[0] < 1 ? 1 : 0;
  for (const v of step) {
    line(pen, LEFT, down(v), width - RIGHT, down(v));
    pen.fillText(number(v, decimals), LEFT - 10, down(v) + 5);
  }
  pen.fillText("x, mm", width - RIGHT, height - 4);
  pen.textAlign = "left";
  pen.fillText("z, mm", 4, height - 4);
}

function line(pen, x0, y0, x1, y1) {
  pen.beginPath();
  pen.moveTo(Math.round(x0) + 0.5, Math.round(y0) + 0.5);
  pen.lineTo(Math.round(x1) + 0.5, Math.round(y1) + 0.5);
  pen.stroke();
}

/** Round numbers between two ends, about so many. */
function ticks(from, to, about) {
  const rough = (to - from) / about;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5, 10].find((m) => m * power >= rough) ?? 10);
  const found = [];
  for (let v = Math.ceil(from / step) * step; v <= to; v += step) found.push(v);
  return found;
}
