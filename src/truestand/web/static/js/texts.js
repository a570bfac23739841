// Every text of the page stands in one table per language; the code only knows keys.

export const LANGUAGES = ["en"];
let table = {};
let plurals = new Intl.PluralRules("en");

/** Load the table of the first language that the browser asks for and we have. */
export async function loadTexts() {
  const wanted = navigator.languages.map((l) => l.slice(0, 2)).find((l) => LANGUAGES.includes(l)) ?? LANGUAGES[0];
  const answer = await fetch(`texts/${wanted}.json`);
  table = await answer.json();
  plurals = new Intl.PluralRules(wanted);
  document.documentElement.lang = wanted;
}

/** The text of a key with {names} filled in; `key.one`, `key.other` … where `n` is given and the table has them. */
export function t(key, values = {}) {
  const numbered = "n" in values ? `${key}.${plurals.select(values.n)}` : key;
  const text = table[numbered] ?? table[key];
  if (text === undefined) {
    console.error(`no text for ${key}`);
    return key;
  }
  return text.replace(/\{(\w+)\}/g, (whole, name) => (name in values ? String(values[name]) : whole));
}

/** Whether the table has this key: for words that come from a record and may be new. */
export function known(key) {
  return key in table;
}
