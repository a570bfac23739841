// The cloud coloured by deviation: 200,000 points in WebGL 2, drawn only when something changed. A second pass darkens
// points that stand behind their neighbours (eye-dome lighting), so that a heap of points reads as a surface.
// plotly's scatter3d would need script-src 'unsafe-eval', which the page does not allow itself.

import { getBytes } from "./api.js";
import { h, put } from "./dom.js";
import { number, short } from "./format.js";
import { icon } from "./marks.js";
import { alertBox, busy } from "./parts.js";
import { t } from "./texts.js";
import { multiplied, orbit, perspective } from "./matrices.js";
import { EYE, POINTS, program } from "./shaders.js";

const UNSEEN = 1e30;
const HOME = { turn: -0.9, lift: 0.75, zoomed: 1 };
const RANGES = [0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000];
/** Blue = too little material, orange = too much; told apart by the colour-blind, and light in the middle on the dark ground. */
export const COLOURS = [[0.13, 0.42, 0.86], [0.45, 0.69, 0.95], [0.93, 0.93, 0.9], [0.97, 0.66, 0.38], [0.86, 0.27, 0.06]];

/** {n, x, y, z, deviation} of the server's bytes. */
export function parsed(bytes) {
  const n = new DataView(bytes).getUint32(0, true);
  if (bytes.byteLength !== 4 + 16 * n) throw new Error(t("cloud.broken"));
  const all = new Float32Array(bytes, 4, 4 * n);
  return { n, x: all.subarray(0, n), y: all.subarray(n, 2 * n), z: all.subarray(2 * n, 3 * n), deviation: all.subarray(3 * n) };
}

/** Fetch and show a cloud in `panel`. */
export async function cloud(panel, address, signal) {
  performance.mark("truestand:cloud:begin");
  put(panel, busy(t("cloud.loading")));
  const points = parsed(await getBytes(address, signal));
  if (signal.aborted) return;
  const canvas = h("canvas", { class: "cloud", tabindex: "0", role: "application", "aria-label": t("cloud.label"), "aria-describedby": "cloud-keys" });
  const gl = canvas.getContext("webgl2", { antialias: false, powerPreference: "high-performance" });
  if (!gl) return put(panel, alertBox(t("cloud.no_webgl"), "open"));
  const view = new View(canvas, gl, points);
  put(panel, figure(view, points));
  view.watch(signal);
  canvas.addEventListener("webglcontextlost", (event) => {
    event.preventDefault();
    if (!signal.aborted) put(panel, alertBox(t("cloud.lost"), "open"));
  });
  await new Promise(requestAnimationFrame);
  view.draw();
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  performance.mark("truestand:cloud:drawn");
  canvas.dataset.drawn = "yes";
}

function figure(view, points) {
  const readout = h("p", { class: "readout", role: "status" });
  const scale = h("ul", { class: "scale" });
  const tool = (sign, text, act) => h("button", { class: "button tool", type: "button", "aria-label": text, title: text, on: { click: act } }, icon(sign));
  view.heard = (point) => put(readout, point ? [h("strong", {}, point.deviation === null ? t("cloud.no_deviation") : `${number(point.deviation, 1)} µm`), ` x ${number(point.x, 2)}, y ${number(point.y, 2)}, z ${number(point.z, 2)} mm`] : t("cloud.tip"));
  view.heard(null);
  const limits = () => put(scale, [1, 0.5, 0, -0.5, -1].map((share) => h("li", {}, `${share > 0 ? "+" : ""}${short(share * view.range)}`)));
  const widen = (by) => {
    view.widen(by);
    limits();
  };
  limits();
  const bar = h("div", { class: "ramp", "aria-label": t("cloud.scale"), role: "group" }, h("span", { class: "unit" }, "µm"), h("div", { class: "strip", "aria-hidden": "true" }), scale,
    h("span", { class: "nothing" }, h("span", { class: "swatch" }), t("cloud.none")));
  return h("figure", { class: "cloud-figure" }, h("div", { class: "stage" }, view.canvas, bar,
    h("div", { class: "tools" }, tool("plus", t("cloud.closer"), () => view.zoom(1.25)), tool("minus", t("cloud.farther"), () => view.zoom(0.8)), tool("again", t("cloud.reset"), () => view.home())), readout),
  h("div", { class: "actions" }, h("button", { class: "button", type: "button", on: { click: () => widen(-1) } }, t("cloud.finer")), h("button", { class: "button", type: "button", on: { click: () => widen(1) } }, t("cloud.coarser"))),
  h("figcaption", { id: "cloud-keys" }, t("cloud.points", { n: points.n, count: number(points.n, 0) }), " ", t("cloud.keys")));
}

class View {
  constructor(canvas, gl, points) {
    Object.assign(this, { canvas, gl, points, heard: () => {}, wanted: false, fingers: new Map() });
    this.range = typical(points.deviation);
    this.frame = framed(points);
    this.programs = { points: program(gl, POINTS), eye: program(gl, EYE) };
    this.count = points.n;
    this.array = this.upload();
    this.home(false);
  }

  /** Points as one buffer: x, y, z about the middle, deviation. */
  upload() {
    const { gl, points, frame } = this;
    const data = new Float32Array(4 * points.n);
    for (let i = 0; i < points.n; i++) {
      data[4 * i] = points.x[i] - frame.x;
      data[4 * i + 1] = points.y[i] - frame.y;
      data[4 * i + 2] = points.z[i] - frame.z;
      data[4 * i + 3] = Number.isNaN(points.deviation[i]) ? UNSEEN : points.deviation[i];
    }
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 4, gl.FLOAT, false, 16, 0);
    gl.bindVertexArray(null);
    this.data = data;
    return array;
  }

  home(draw = true) {
    Object.assign(this, HOME, { shift: [0, 0] });
    if (draw) this.later();
  }

  zoom(by) {
    this.zoomed = Math.min(Math.max(this.zoomed * by, 0.4), 30);
    this.later();
  }

  widen(by) {
    const at = RANGES.indexOf(this.range);
    this.range = RANGES[Math.min(Math.max(at + by, 0), RANGES.length - 1)];
    this.later();
  }

  later() {
    if (this.wanted) return;
    this.wanted = true;
    requestAnimationFrame(() => {
      this.wanted = false;
      if (this.canvas.isConnected) this.draw();
    });
  }

  camera() {
    const { width, height } = this.canvas;
    const distance = (2.5 * this.frame.radius * Math.max(1, height / width)) / this.zoomed;
    const reach = this.frame.reach + Math.hypot(...this.shift);
    const near = Math.max(distance - reach, 0.01 * this.frame.radius);
    const far = distance + reach;
    const look = orbit(this.turn, this.lift, distance, this.shift);
    return { matrix: multiplied(perspective(0.75, width / height, near, far), look), near, far, distance };
  }

  draw() {
    this.fit();
    const { gl, canvas, programs } = this;
    const { matrix, near, far, distance } = this.camera();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target.buffer);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.enable(gl.DEPTH_TEST);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const p = programs.points;
    gl.useProgram(p.handle);
    gl.uniformMatrix4fv(p.at("matrix"), false, matrix);
    gl.uniform1f(p.at("range"), this.range);
    gl.uniform3fv(p.at("colours"), COLOURS.flat());
    gl.uniform1f(p.at("size"), (canvas.height * this.frame.spacing * 1.9) / 0.75);
    gl.uniform1f(p.at("most"), 14 * this.sharp);
    gl.bindVertexArray(this.array);
    gl.drawArrays(gl.POINTS, 0, this.count);
    gl.bindVertexArray(null);
    this.light(near, far, distance);
  }

  light(near, far, distance) {
    const { gl, programs } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.disable(gl.DEPTH_TEST);
    const e = programs.eye;
    gl.useProgram(e.handle);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.target.colour);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.target.depth);
    gl.uniform1i(e.at("colour"), 0);
    gl.uniform1i(e.at("depth"), 1);
    gl.uniform2f(e.at("ends"), near, far);
    gl.uniform1f(e.at("strength"), 110 * (distance / this.frame.radius));
    gl.uniform1i(e.at("reach"), Math.round(2 * this.sharp));
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** The canvas as large as it is shown; what is drawn to, as large as the canvas. */
  fit() {
    const { canvas, gl } = this;
    this.sharp = Math.min(devicePixelRatio || 1, 1.5);
    const [width, height] = [Math.max(1, Math.round(canvas.clientWidth * this.sharp)), Math.max(1, Math.round(canvas.clientHeight * this.sharp))];
    if (this.target && canvas.width === width && canvas.height === height) return;
    [canvas.width, canvas.height] = [width, height];
    if (this.target) [gl.deleteTexture(this.target.colour), gl.deleteTexture(this.target.depth), gl.deleteFramebuffer(this.target.buffer)];
    const texture = (inside, format, type) => {
      const made = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D, made);
      gl.texImage2D(gl.TEXTURE_2D, 0, inside, width, height, 0, format, type, null);
      for (const key of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, key, gl.NEAREST);
      for (const key of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, key, gl.CLAMP_TO_EDGE);
      return made;
    };
    const target = { colour: texture(gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE), depth: texture(gl.DEPTH_COMPONENT24, gl.DEPTH_COMPONENT, gl.UNSIGNED_INT), buffer: gl.createFramebuffer() };
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.buffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target.colour, 0);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, target.depth, 0);
    this.target = target;
  }

  /** Mouse, fingers and keys. */
  watch(signal) {
    const on = (name, act, more = {}) => this.canvas.addEventListener(name, act, { signal, ...more });
    on("pointerdown", (e) => this.down(e));
    on("pointermove", (e) => this.move(e));
    for (const name of ["pointerup", "pointercancel"]) on(name, (e) => this.up(e));
    on("contextmenu", (e) => e.preventDefault());
    on("wheel", (e) => (e.preventDefault(), this.zoom(Math.exp(-0.0015 * e.deltaY))), { passive: false });
    on("dblclick", () => this.home());
    on("keydown", (e) => this.key(e));
    const size = new ResizeObserver(() => this.later());
    size.observe(this.canvas);
    signal.addEventListener("abort", () => {
      size.disconnect();
      this.gl.getExtension("WEBGL_lose_context")?.loseContext();
    });
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, [event.clientX, event.clientY]);
    this.travel = 0;
  }

  move(event) {
    const from = this.fingers.get(event.pointerId);
    if (!from) return;
    const now = [event.clientX, event.clientY];
    const [dx, dy] = [now[0] - from[0], now[1] - from[1]];
    this.travel += Math.abs(dx) + Math.abs(dy);
    const other = [...this.fingers].find(([id]) => id !== event.pointerId)?.[1];
    if (other) {
      const apart = (a) => Math.hypot(a[0] - other[0], a[1] - other[1]) || 1;
      this.zoom(apart(now) / apart(from));
      this.pan(dx / 2, dy / 2);
    } else if (event.shiftKey || event.buttons & 6) this.pan(dx, dy);
    else this.orbit(-dx * 0.008, dy * 0.008);
    this.fingers.set(event.pointerId, now);
  }

  up(event) {
    const alone = this.fingers.size === 1;
    this.fingers.delete(event.pointerId);
    if (alone && this.travel < 6 && event.type === "pointerup") this.pick(event.offsetX, event.offsetY);
  }

  orbit(turn, lift) {
    this.turn += turn;
    this.lift = Math.min(Math.max(this.lift + lift, -1.55), 1.55);
    this.later();
  }

  pan(dx, dy) {
    const scale = (2 * Math.tan(0.375) * this.camera().distance) / this.canvas.clientHeight;
    this.shift = [this.shift[0] + dx * scale, this.shift[1] - dy * scale];
    this.later();
  }

  key(event) {
    const acts = {
      ArrowLeft: () => (event.shiftKey ? this.pan(-30, 0) : this.orbit(0.12, 0)), ArrowRight: () => (event.shiftKey ? this.pan(30, 0) : this.orbit(-0.12, 0)),
      ArrowUp: () => (event.shiftKey ? this.pan(0, -30) : this.orbit(0, 0.12)), ArrowDown: () => (event.shiftKey ? this.pan(0, 30) : this.orbit(0, -0.12)),
      "+": () => this.zoom(1.2), "=": () => this.zoom(1.2), "-": () => this.zoom(1 / 1.2), 0: () => this.home(),
    };
    if (!acts[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    acts[event.key]();
  }

  /** The nearest point to the eye within a finger's width of where was pressed. */
  pick(px, py) {
    const { matrix: m } = this.camera();
    const { clientWidth: width, clientHeight: height } = this.canvas;
    let [best, score] = [-1, Infinity];
    for (let i = 0; i < this.count; i++) {
      const [x, y, z] = [this.data[4 * i], this.data[4 * i + 1], this.data[4 * i + 2]];
      const w = m[3] * x + m[7] * y + m[11] * z + m[15];
      if (w <= 0) continue;
      const sx = (0.5 + (0.5 * (m[0] * x + m[4] * y + m[8] * z + m[12])) / w) * width - px;
      const sy = (0.5 - (0.5 * (m[1] * x + m[5] * y + m[9] * z + m[13])) / w) * height - py;
      const away = sx * sx + sy * sy;
      if (away > 144) continue;
      const rank = w / this.frame.radius + 0.004 * away;
      if (rank < score) [best, score] = [i, rank];
    }
    if (best < 0) return this.heard(null);
    const { x, y, z, deviation } = this.points;
    return this.heard({ x: x[best], y: y[best], z: z[best], deviation: Number.isNaN(deviation[best]) ? null : deviation[best] });
  }
}

/** Middle and radius of what has a deviation (of everything, where little has), the reach of all points, their spacing. */
function framed({ n, x, y, z, deviation }) {
  const some = [];
  for (let i = 0; i < n; i++) if (!Number.isNaN(deviation[i])) some.push(i);
  const shown = some.length > 0.01 * n ? some : null;
  const ends = [x, y, z].map((axis) => extent(axis, shown));
  const all = [x, y, z].map((axis) => extent(axis, null));
  const middle = ends.map(([low, high]) => (low + high) / 2 || 0);
  const radius = 0.5 * Math.hypot(...ends.map(([low, high]) => high - low || 0)) || 1;
  const reach = Math.hypot(...all.map(([low, high], i) => Math.max(high - middle[i], middle[i] - low) || 0)) || 1;
  return { x: middle[0], y: middle[1], z: middle[2], radius, reach: 1.05 * reach, spacing: reach * Math.sqrt(4 / Math.max(n, 100)) };
}

/** Least and largest; of all, where `some` is null. */
function extent(axis, some) {
  let [low, high] = [Infinity, -Infinity];
  const count = some ? some.length : axis.length;
  for (let k = 0; k < count; k++) {
    const v = axis[some ? some[k] : k];
    if (v < low) low = v;
    if (v > high) high = v;
  }
  return [low, high];
}

/** A round number of um that holds all but the wildest few deviations. */
function typical(deviation) {
  const step = Math.max(1, Math.floor(deviation.length / 20000));
  const sizes = [];
  for (let i = 0; i < deviation.length; i += step) if (!Number.isNaN(deviation[i])) sizes.push(Math.abs(deviation[i]));
  sizes.sort((a, b) => a - b);
  const wanted = sizes[Math.floor(0.98 * (sizes.length - 1))] ?? 10;
  return RANGES.find((range) => range >= wanted) ?? RANGES.at(-1);
}
