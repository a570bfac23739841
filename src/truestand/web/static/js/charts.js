// plotly.js out of the installed wheel, fetched when a chart is first wanted, under a policy that allows no inline style.
//
// plotly writes its rules into an own style sheet and some marks with setAttribute("style"): both are inline to the
// browser. It finds a sheet of ours under the name it looks for, and style attributes go through the object model.

import { colour, h } from "./dom.js";
import { t } from "./texts.js";

let library = null;

function load() {
  library ??= prepare().catch((wrong) => {
    library = null;
    throw wrong;
  });
  return library;
}

async function prepare() {
  await arrives(h("link", { rel: "stylesheet", href: "plotly.css", id: "plotly.js-style-global" }));
  styleThroughObjectModel();
  const make = document.createElement;
  document.createElement = function (name, ...more) {
    return make.call(this, String(name).toLowerCase() === "style" ? "template" : name, ...more);
  };
  try {
    await arrives(h("script", { src: "vendor/plotly.min.js" }));
  } finally {
    document.createElement = make;
  }
  return window.Plotly;
}

function arrives(element) {
  return new Promise((done, failed) => {
    element.addEventListener("load", done);
    element.addEventListener("error", () => failed(new Error(t("charts.missing"))));
    document.head.append(element);
  });
}

function styleThroughObjectModel() {
  const set = Element.prototype.setAttribute;
  Element.prototype.setAttribute = function (name, value) {
    if (name === "style") this.style.cssText = value;
    else set.call(this, name, value);
  };
}

/** Draw into a new figure under `place`; drawn anew when light turns dark, taken down with `signal`. */
export async function chart(place, label, traces, layout, signal) {
  const box = h("div", { class: "plot" });
  const note = h("p", { class: "busy" }, h("span", { class: "dot" }), t("charts.loading"));
  place.append(h("figure", { class: "chart" }, h("figcaption", {}, label), note, box));
  const plotly = await load();
  if (signal.aborted) return;
  const draw = () => plotly.react(box, traces(), styled(layout()), { displayModeBar: false, responsive: true, doubleClick: "reset" });
  await draw();
  note.remove();
  box.querySelector(".main-svg")?.setAttribute("aria-label", label);
  box.querySelector(".main-svg")?.setAttribute("role", "img");
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw, { signal });
  signal.addEventListener("abort", () => plotly.purge(box), { once: true });
}

function styled(layout) {
  const rem = parseFloat(getComputedStyle(document.documentElement).fontSize);
  const axis = { gridcolor: colour("line"), zerolinecolor: colour("soft"), linecolor: colour("soft"), automargin: true, tickfont: { size: 0.8 * rem }, title: { standoff: 12 } };
  return {
    height: 380,
    ...layout,
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", dragmode: "zoom", hovermode: "closest",
    font: { family: getComputedStyle(document.body).fontFamily, size: 0.85 * rem, color: colour("ink") },
    hoverlabel: { bgcolor: colour("paper"), bordercolor: colour("soft"), font: { size: 0.95 * rem, color: colour("ink") } },
    margin: { l: 64, r: 16, t: 12, b: 52, ...layout.margin },
    legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 },
    xaxis: { ...axis, ...layout.xaxis }, yaxis: { ...axis, ...layout.yaxis },
  };
}

/** Text from outside for plotly, which would read some tags. */
export function plain(text) {
  return String(text).replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");
}

/** A level across the whole chart. */
export function level(y, dash, tone) {
  return { type: "line", xref: "paper", x0: 0, x1: 1, y0: y, y1: y, line: { color: colour(tone), width: 2, dash } };
}

/** A series told apart by colour and by the shape of its points. */
export function series(at) {
  return { color: colour(["series-1", "series-2", "series-3", "series-4"][at % 4]), symbol: ["circle", "square", "diamond", "cross"][at % 4] };
}
