// Stand, artefact and parts as text, checked by the same reader that the jobs use.

import { get, send } from "../api.js";
import { add, h, put } from "../dom.js";
import { say } from "../frame.js";
import { icon, mark } from "../marks.js";
import { button, empty, field, heading } from "../parts.js";
import { guard, to } from "../router.js";
import { store } from "../store.js";
import { t } from "../texts.js";

const CHECK_DELAY_MS = 600;
const SIGNS = { stand: "devices", artefact: "turned", part: "gear" };

export async function show(page, { file }, signal) {
  const all = await get("api/recipes", signal);
  const fresh = Boolean(file) && !all.some((r) => r.file === file);
  const recipe = file ? (fresh ? { file, text: "", problem: null } : await get(`api/recipes/${encodeURIComponent(file)}`, signal)) : null;
  add(page, heading(t("recipes.title"), store.engineer && button(t("recipes.new"), create, { sign: "plus" })),
    h("div", { class: "editor" }, files(all, file), recipe ? editor(recipe, signal) : h("div", { class: "card" }, empty(t(all.length ? "recipes.choose" : "recipes.none")))));
}

function files(all, chosen) {
  return h("ul", { class: "files", "aria-label": t("recipes.files") }, all.map((r) => h("li", {},
    h("a", { class: "file", href: `#/recipes/${encodeURIComponent(r.file)}`, "aria-current": r.file === chosen ? "true" : null }, icon(SIGNS[r.kind] ?? "recipes"),
      h("span", { class: "name" }, r.title || r.file), h("span", { class: "facts" }, `${t(`recipes.kind.${r.kind}`)} · ${r.file}`)))));
}

function create() {
  const input = h("input", { type: "text", id: "new-file", required: true, pattern: "[A-Za-z0-9._\\-]+\\.toml", title: t("recipes.new.pattern"), spellcheck: "false", autocapitalize: "none", prop: { value: "part.toml" } });
  const dialog = h("dialog", { "aria-labelledby": "new-title", on: { close: () => dialog.remove() } }, h("form", { method: "dialog", on: { submit: () => to(`/recipes/${encodeURIComponent(input.value)}`) } },
    h("h2", { id: "new-title" }, t("recipes.new")), field(t("recipes.new.file"), input, t("recipes.new.pattern")),
    h("div", { class: "actions" }, button(t("action.cancel"), () => dialog.close()), button(t("recipes.create"), null, { kind: "primary", type: "submit" }))));
  document.body.append(dialog);
  dialog.showModal();
  input.select();
}

function editor({ file, text, problem }, signal) {
  const path = `api/recipes/${encodeURIComponent(file)}`;
  let saved = text;
  let waiting = null;
  const area = h("textarea", { id: "recipe", spellcheck: "false", autocapitalize: "none", autocomplete: "off", wrap: "off", readonly: !store.engineer, "aria-describedby": "recipe-state", prop: { value: text }, on: { input: typed, scroll: () => (numbers.scrollTop = area.scrollTop), keydown: keys } });
  const numbers = h("div", { class: "numbers", "aria-hidden": "true" });
  const state = h("div", { id: "recipe-state", role: "status" });
  const save = button(t("recipes.save"), keep, { kind: "primary" });
  guard(() => area.value === saved || confirm(t("recipes.leave")));
  addEventListener("beforeunload", (event) => area.value !== saved && event.preventDefault(), { signal });
  signal.addEventListener("abort", () => clearTimeout(waiting));
  number();
  showProblem(problem, false);
  return h("section", { class: "card text" }, h("label", { class: "name", for: "recipe" }, file), h("div", { class: "sheet" }, numbers, area), state,
    store.engineer ? h("div", { class: "actions" }, button(t("recipes.check"), check), save) : h("p", { class: "note" }, t("recipes.read_only")));

  function number(at = null) {
    const count = area.value.split("\n").length;
    put(numbers, Array.from({ length: count }, (_, i) => h("span", { class: i + 1 === at ? "bad" : "" }, String(i + 1))));
  }

  function typed() {
    number();
    put(state, h("p", { class: "note" }, t("recipes.changed")));
    clearTimeout(waiting);
    waiting = setTimeout(check, CHECK_DELAY_MS);
  }

  function keys(event) {
    if ((event.ctrlKey || event.metaKey) && event.key === "s") {
      event.preventDefault();
      if (store.engineer) keep();
    }
  }

  async function check() {
    clearTimeout(waiting);
    try {
      const { problem } = await send("POST", `${path}/check`, { text: area.value });
      if (!signal.aborted) showProblem(problem, true);
    } catch (wrong) {
      showProblem(wrong.message, true);
    }
  }

  async function keep() {
    clearTimeout(waiting);
    save.disabled = true;
    try {
      await send("PUT", path, { text: area.value });
      saved = area.value;
      put(state, h("div", { class: "notice good" }, mark("good"), h("p", {}, t("recipes.saved"))));
      say(t("recipes.saved"));
    } catch (wrong) {
      showProblem(wrong.message, true);
    }
    save.disabled = false;
  }

  /** The problem, and the line that it names. */
  function showProblem(problem, asked) {
    const at = Number(/\blines? (\d+)/i.exec(problem ?? "")?.[1]) || null;
    number(at);
    if (!problem) return put(state, asked && h("p", { class: "note fine" }, mark("good"), t(area.value === saved ? "recipes.fine" : "recipes.fine.unsaved")));
    return put(state, h("div", { class: "notice bad" }, mark("bad"), h("p", {}, problem), at && button(t("recipes.go", { line: at }), () => jump(at))));
  }

  function jump(line) {
    const lines = area.value.split("\n");
    const from = lines.slice(0, line - 1).reduce((sum, l) => sum + l.length + 1, 0);
    area.focus();
    area.setSelectionRange(from, from + (lines[line - 1]?.length ?? 0));
    area.scrollTop = (line - 3) * parseFloat(getComputedStyle(area).lineHeight);
  }
}
