// Pieces that several pages are made of.

import { h } from "./dom.js";
import { when } from "./format.js";
import { icon, judged, mark, standing } from "./marks.js";
import { t } from "./texts.js";

export function heading(text, ...beside) {
  return h("div", { class: "heading" }, h("h1", {}, text), h("div", { class: "beside" }, ...beside));
}

export function button(text, act, { kind = "", sign, type = "button", ...more } = {}) {
  return h("button", { class: `button ${kind}`, type, on: act ? { click: act } : {}, ...more }, sign && icon(sign), h("span", {}, text));
}

export function link(text, path, { kind = "", sign, ...more } = {}) {
  const href = path.startsWith("/") ? `#${path}` : path;
  return h("a", { class: `button ${kind}`, href, ...more }, sign && icon(sign), h("span", {}, text));
}

export function field(label, input, note) {
  const id = input.id || (input.id = `f-${label.replace(/\W+/g, "-").toLowerCase()}`);
  return h("div", { class: "field" }, h("label", { for: id }, label), input, note && h("p", { class: "note" }, note));
}

/** Mark and word. */
export function verdict(word, kind = "") {
  const { tone, word: text } = judged(word);
  return h("span", { class: `verdict ${tone} ${kind}` }, mark(tone), h("span", {}, text));
}

/** The huge one, to be read from two metres. */
export function stamp({ tone, word }, over, under, level = "h1") {
  return h("section", { class: `stamp ${tone}` }, mark(tone, "huge"),
    h("div", {}, over && h("p", { class: "over" }, over), h(level, { class: "word" }, word), under && h("p", { class: "under" }, under)));
}

/** What the server, or the way to it, did not like; with a way to try again. */
export function trouble(wrong, again) {
  if (!("status" in wrong)) console.error(wrong);
  return h("section", { class: "notice bad", role: "alert" }, mark("bad"),
    h("div", {}, h("h1", {}, t(wrong.status === 0 ? "problem.title.unreachable" : "problem.title")), h("p", {}, wrong.message),
      again && button(t("action.again"), again, { sign: "again" })));
}

/** A shorter word on something that went wrong, inside a page. */
export function alertBox(text, tone = "bad") {
  return h("div", { class: `notice ${tone}`, role: "alert" }, mark(tone), h("p", {}, text));
}

export function empty(text, ...beneath) {
  return h("div", { class: "empty" }, mark("none"), h("p", {}, text), ...beneath);
}

export function busy(text = t("word.loading")) {
  return h("p", { class: "busy", role: "status" }, h("span", { class: "dot" }), text);
}

/** What a result is called: its part, or what kind of job it was. */
export function titled(entry) {
  return entry.title || entry.part || t(`kind.${entry.kind}`);
}

/** Results as rows that are links. */
export function rows(entries) {
  return h("ul", { class: "rows" }, entries.map((e) => h("li", {}, row(e))));
}

function row(entry) {
  const { tone, word } = standing(entry);
  const facts = [entry.kind === "inspection" ? entry.serial : t("word.by", { name: entry.operator || "–" }), when(entry.time)];
  return h("a", { class: `row ${entry.corrected_by ? "corrected" : ""}`, href: `#/results/${entry.number}` },
    mark(tone),
    h("span", { class: "what" }, h("span", { class: "name" }, titled(entry)), h("span", { class: "facts" }, facts.filter(Boolean).join(" · "))),
    entry.corrected_by && h("span", { class: "tag" }, t("result.by", { number: entry.corrected_by })),
    h("span", { class: `verdict ${tone}` }, word), h("span", { class: "no" }, `#${entry.number}`),
    entry.doubts.length > 0 && h("span", { class: "doubt" }, entry.doubts[0]));
}

/** Where one is in a guided job. */
export function stepper(names, at) {
  return h("ol", { class: "stepper", "aria-label": t("job.steps") }, names.map((name, i) =>
    h("li", { class: i < at ? "past" : i === at ? "now" : "", "aria-current": i === at ? "step" : null },
      h("span", { class: "no" }, i < at ? mark("good") : String(i + 1)), h("span", { class: "name" }, name))));
}

/** A choice of one, as large buttons: [{value, label}]. */
export function segments(label, options, value, choose) {
  const name = `s-${label.replace(/\W+/g, "-").toLowerCase()}`;
  return h("fieldset", { class: "segments" }, h("legend", { class: "unseen" }, label), options.map((o) =>
    h("label", {}, h("input", { type: "radio", name, value: o.value, prop: { checked: o.value === value }, on: { change: () => choose(o.value) } }),
      h("span", {}, o.label))));
}

export function select(label, options, value, choose) {
  const input = h("select", { on: { change: (event) => choose(event.target.value) } },
    options.map((o) => h("option", { value: o.value, prop: { selected: o.value === value } }, o.label)));
  return field(label, input);
}

/** A question before something that can't be taken back; true where answered with yes. `more` stands above the answers. */
export function ask(title, text, yes, more = null) {
  return new Promise((answer) => {
    const dialog = h("dialog", { "aria-labelledby": "ask-title", on: { close: () => { dialog.remove(); answer(dialog.returnValue === "yes"); } } },
      h("form", { method: "dialog" }, h("h2", { id: "ask-title" }, title), h("p", {}, text), more,
        h("div", { class: "actions" }, button(t("action.cancel"), () => dialog.close("no")),
          button(yes, null, { kind: "danger", type: "submit", value: "yes" }))));
    document.body.append(dialog);
    dialog.showModal();
  });
}

/** The same with a line to write why: its text, or null. */
export async function askWhy(title, text, yes, why) {
  const input = h("input", { type: "text", id: "ask-why", required: "", maxlength: 300, autocomplete: "off" });
  return (await ask(title, text, yes, field(why, input))) ? input.value.trim() : null;
}
