// Elements, numbers as text, and questions to the server.
export const $ = (id) => document.getElementById(id);

export function make(tag, text = "", attributes = {}, ...children) {
  const element = document.createElement(tag);
  element.textContent = text;
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value !== null && value !== false) element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children);
  return element;
}

export function say(text, bad = false) {
  $("message").textContent = text;
  $("message").className = bad ? "bad" : "";
}

export async function ask(path, options = {}) {
  let answer;
  try {
    answer = await fetch(path, { cache: "no-store", ...options });
  } catch {
    throw new Error("The server does not answer. Start rotorid lab again.");
  }
  if (!answer.ok) throw new Error(sentenceOf(await answer.text()));
  return answer.json();
}

/** The sentence of a refusal: JSON with a sentence, or plain text. */
export function sentenceOf(text) {
  try { return JSON.parse(text).sentence ?? text; } catch { return text; }
}

export const post = (path, body) =>
  ask(path, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) });

/** An action of the user: clears the message, and shows what goes wrong. */
export const tried = (work) => async (...given) => {
  say("");
  try { return await work(...given); } catch (error) { say(error.message, true); return undefined; }
};

/** An action of the page itself: shows what goes wrong, and clears only its own message. */
export const watched = (work) => {
  let shown = "";
  return async (...given) => {
    try {
      const found = await work(...given);
      if (shown && $("message").textContent === shown) say("");
      shown = "";
      return found;
    } catch (error) {
      say((shown = error.message), true);
      return undefined;
    }
  };
};

/** Words of a command line as a shell reads them. */
export const shellWords = (words) =>
  words.map((word) => (/^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`)).join(" ");

/** Draw a list again; the focus stays on the element with the same `data-key`, or goes to `otherwise`. */
export function redrawn(box, children, otherwise = null) {
  const focused = box.contains(document.activeElement) ? document.activeElement : null;
  box.replaceChildren(...children);
  if (!focused) return;
  const same = focused.dataset.key && box.querySelector(`[data-key="${CSS.escape(focused.dataset.key)}"]`);
  (same || otherwise)?.focus({ preventScroll: true });
}

/** What this browser stores, if it stores anything. */
export const kept = (store, key) => { try { return window[store].getItem(key); } catch { return null; } };
export const keep = (store, key, text) => { try { window[store].setItem(key, text); } catch { /* it is kept on the page alone */ } };

export const names = (text) => text.split(",").map((name) => name.trim()).filter(Boolean);

export function number(value, digits = 4) {
  if (value === null || value === undefined) return "–";
  const size = Math.abs(value);
  if (value !== 0 && (size >= 1e6 || size < 1e-4)) return value.toExponential(digits - 1).replaceAll("-", "−");
  return String(Number(value.toPrecision(digits))).replace("-", "−");
}

const SIGNS = Object.fromEntries([..."-0123456789"].map((sign, k) => [sign, "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"[k]]));
export const raised = (power) => [...String(power)].map((sign) => SIGNS[sign]).join("");
/** A unit as it is read: nothing for plain numbers, powers as superscripts. */
export const unitOf = (unit) =>
  unit === "1" ? "" : unit.replace(/\^(-?\d+)/g, (_, power) => raised(power)).replaceAll("*", "·");

/** Whether angles and rates of channels are shown in degrees; the server always uses radians. */
export const angles = { degrees: false };
/** The unit in which a channel is shown, and what its values are multiplied by. */
export const displayUnit = (unit) =>
  angles.degrees && /^rad($|\/s)/.test(unit) ? { unit: unit.replace(/^rad/, "deg"), factor: 180 / Math.PI } : { unit, factor: 1 };
/** Values of a channel, in what they are shown in. */
export const times = (values, factor) => (factor === 1 ? values : values.map((value) => (value === null ? null : value * factor)));

/** Words of figures and headings of findings, from the server. */
const vocabulary = { figures: {}, findings: {}, loops: {} };
export const learn = (words) => Object.assign(vocabulary, words);
export const figureOf = (key) => vocabulary.figures[key] ?? { words: key.replaceAll("_", " "), unit: key.endsWith("_rad_s") ? "rad/s" : "", factor: 1 };
/** The words of a figure such as `gain_margin_db`, with its unit. */
export function words(key) {
  const { words: text, unit } = figureOf(key);
  return unit ? `${text} [${unit === "rad/s" ? unitText() : unit}]` : text;
}
/** The words of a loop such as `p`. */
export const loopOf = (name) => vocabulary.loops[name] ?? name;
/** The heading of a kind of finding. */
export const headingOf = (kind) => vocabulary.findings[kind] ?? kind.replaceAll("_", " ");

export const counted = (count, singular, many = `${singular}s`) => `${count} ${count === 1 ? singular : many}`;

const halfOf = (quantity) => (Number.isFinite(quantity.upper) && Number.isFinite(quantity.lower) ? (quantity.upper - quantity.lower) / 2 : 0);
/** A number rounded to this half width: to one digit of it, or two if it begins with 1 or 2. */
export function rounded(value, half) {
  if (value === null || value === undefined || !half) return number(value);
  const power = Math.floor(Math.log10(half)), places = Math.max((half / 10 ** power < 3 ? 1 : 0) - power, 0);
  return places > 10 ? number(value) : value.toFixed(places).replaceAll("-", "−");
}
/** A value with half the width of its interval, as many digits as the width allows. */
export function within(quantity) {
  if (!quantity || quantity.value === null || quantity.value === undefined) return "–";
  const half = halfOf(quantity);
  return half ? `${rounded(quantity.value, half)} ± ${rounded(half, half)}` : number(quantity.value);
}
/** A value and the ends of its interval, as many digits as its width allows. */
export const ends = (quantity) => [quantity.value, quantity.lower, quantity.upper].map((value) => rounded(value, halfOf(quantity)));
/** A value with its interval, of a value and its standard deviation. */
export const withStd = (value, std) => within({ value, lower: value - 1.96 * std, upper: value + 1.96 * std });

export function tableOf(caption, heads, rows) {
  const table = make("table", "", {}, ...(caption ? [make("caption", caption)] : []));
  table.append(make("thead", "", {}, make("tr", "", {}, ...heads.map((head) => make("th", head, { scope: "col" })))));
  table.append(make("tbody", "", {}, ...rows.map((row) => make("tr", "", {}, ...row.map((content, k) => {
    const cell = k ? make("td", "", { class: "n" }) : make("th", "", { scope: "row" });
    cell.append(content);
    return cell;
  })))));
  return make("div", "", { class: "scroll", tabindex: "0", role: "region", "aria-label": caption || heads.join(", ") }, table);
}

const RADIANS = 2 * Math.PI;
export const inHz = () => $("units").value === "hz";
export const shownOmega = (omega) => (inHz() ? omega / RADIANS : omega);
export const omegaOf = (shown) => (inHz() ? shown * RADIANS : shown);
export const unitText = () => (inHz() ? "Hz" : "rad/s");
/** An estimate times a factor. */
export const scaled = (quantity, factor) =>
  quantity && factor !== 1 ? Object.fromEntries(["value", "lower", "upper"].map((part) => [part, quantity[part] === null ? null : quantity[part] * factor])) : quantity;
/** An estimate of a figure, in the unit that `words` names. */
export const shownFigure = (key, quantity) => {
  const { unit, factor } = figureOf(key);
  return within(scaled(quantity, unit === "rad/s" && inHz() ? factor / RADIANS : factor));
};
