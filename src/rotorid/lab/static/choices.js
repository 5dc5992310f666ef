// What was chosen: one object, the way back, and the step that comes of it.
import { $, make, names, number, omegaOf, post, shownOmega, tried } from "./page.js";

const EMPTY = { segments: [], inputs: "", outputs: "", instrument: "", band: null, model: "", reduce: false, method: "auto", with: [], unseen: [] };
const AXES = ["roll", "pitch", "yaw", "thrust"];
const TEXTS = ["model", "inputs", "outputs", "instrument"];

export class Choices {
  /** `hooks`: `changed()` after every change, `log()` the number of the shown log, `told()` what is known of it, `isOpen(k)`. */
  constructor(hooks) {
    this.hooks = hooks;
    this.now = { ...EMPTY };
    this.before = [];
    this.after = [];
    this.catalog = [];
    try { this.now = { ...EMPTY, ...JSON.parse(sessionStorage.getItem("choices") ?? "{}") }; } catch { /* nothing was kept */ }
    for (const name of TEXTS) $(name).addEventListener("change", () => this.set({ [name]: $(name).value.trim() }));
    for (const name of ["low", "high"]) $(name).addEventListener("change", () => this.#typedBand());
    $("no-band").addEventListener("click", () => this.set({ band: null }));
    $("reduce").addEventListener("change", () => this.set({ reduce: $("reduce").checked }));
    $("method").addEventListener("change", () => this.set({ method: $("method").value }));
    $("undo").addEventListener("click", () => this.undo());
    $("redo").addEventListener("click", () => this.redo());
  }

  set(change) {
    if (JSON.stringify({ ...this.now, ...change }) === JSON.stringify(this.now)) return;
    this.before.push(JSON.stringify(this.now));
    this.after = [];
    this.now = { ...this.now, ...change };
    this.show();
  }

  /** A change that is not finished, as of an edge that is dragged: no step back leads to it. */
  preview(change) {
    this.started ??= JSON.stringify(this.now);
    this.now = { ...this.now, ...change };
    this.hooks.changed();
  }

  finish(change) {
    const started = this.started ?? JSON.stringify(this.now);
    this.started = null;
    this.before.push(started);
    this.after = [];
    this.now = { ...this.now, ...change };
    this.show();
  }

  undo() { this.#back(this.before, this.after); }

  redo() { this.#back(this.after, this.before); }

  #back(from, to) {
    if (!from.length) return;
    to.push(JSON.stringify(this.now));
    this.now = JSON.parse(from.pop());
    this.show();
  }

  #typedBand() {
    const low = Number($("low").value), high = Number($("high").value);
    if (low > 0 && high > low) this.set({ band: [omegaOf(low), omegaOf(high)] });
  }

  brushed(start_s, stop_s) {
    const axis = this.now.segments.at(-1)?.axis ?? this.hooks.told()?.inspection?.excitations?.[0]?.axis ?? "roll";
    this.set({ segments: [...this.now.segments, { axis, start_s, stop_s }] });
  }

  edged(k, side, at, last) {
    const segments = this.now.segments.map((one, n) => (n === k ? { ...one, [side]: at } : one));
    if (last) this.finish({ segments }); else this.preview({ segments });
  }

  step(verb, more = {}) {
    const others = (list) => list.filter((k) => k !== this.hooks.log() && this.hooks.isOpen(k));
    const { now } = this, step = { verb, logs: [this.hooks.log(), ...others(now.with)], ...more };
    if (verb === "review") { step.logs = [this.hooks.log()]; return step; }
    step.segments = now.segments;
    if (now.band) step.band_rad_s = now.band;
    if (names(now.instrument).length) step.instrument = names(now.instrument);
    step.inputs = names(now.inputs);
    step.outputs = names(now.outputs);
    if (verb !== "identify") return step;
    step.models = names(now.model || $("model").placeholder);
    step.verify = others(now.unseen);
    if (now.reduce) step.reduce = true;
    if (now.method !== "auto") step.method = now.method;
    return step;
  }

  show() {
    const { now } = this;
    try { sessionStorage.setItem("choices", JSON.stringify(now)); } catch { /* it is kept on the page alone */ }
    // What somebody is typing is not taken away, whatever else is shown anew meanwhile.
    const fill = (name, text) => { if (document.activeElement !== $(name)) $(name).value = text; };
    for (const name of TEXTS) fill(name, now[name]);
    for (const [k, name] of ["low", "high"].entries()) fill(name, now.band ? number(shownOmega(now.band[k])) : "");
    $("reduce").checked = now.reduce;
    $("method").value = now.method;
    $("undo").disabled = !this.before.length;
    $("redo").disabled = !this.after.length;
    this.#showSegments();
    this.#showModels();
    this.#showCommand();
    this.hooks.changed();
  }

  #showSegments() {
    $("no-segments").hidden = this.now.segments.length > 0;
    $("segments").replaceChildren(...this.now.segments.map((one, k) => {
      const change = (part) => this.set({ segments: this.now.segments.map((other, n) => (n === k ? { ...other, ...part } : other)) });
      const edge = (name, label) => {
        const field = make("input", "", { type: "number", step: "0.1", "aria-label": `${label} of segment ${k + 1} in seconds` });
        field.value = Number(one[name].toFixed(3));
        field.addEventListener("change", () => { if (field.value) change({ [name]: Number(field.value) }); });
        return field;
      };
      const axis = make("select", "", { "aria-label": `axis of segment ${k + 1}` }, ...AXES.map((name) => make("option", name)));
      axis.value = one.axis;
      axis.addEventListener("change", () => change({ axis: axis.value }));
      return make("li", "", {}, axis, edge("start_s", "start"), "to", edge("stop_s", "stop"), "s",
        make("button", "×", { class: "plain", "aria-label": `remove segment ${k + 1}`, onclick: () => this.set({ segments: this.now.segments.filter((_, n) => n !== k) }) }));
    }));
  }

  /** The models of the library; those that the log was asked about come first, with a mark. */
  #showModels() {
    const supports = this.hooks.told()?.inspection?.supports ?? {};
    const first = Object.entries(supports).find(([, one]) => one.possible)?.[0] ?? "rate.roll";
    $("model").placeholder = first;
    const rank = (name) => (supports[name] ? (supports[name].possible ? 0 : 2) : 1);
    const all = [...new Set([...Object.keys(supports), ...this.catalog.map((one) => one.name)])].filter((name) => !/[/*]/.test(name));
    all.sort((a, b) => rank(a) - rank(b));
    const chosen = names(this.now.model || first), top = $("models").scrollTop;
    $("models").replaceChildren(...all.map((name) => {
      const mark = ["✓", "", "✗"][rank(name)], words = { "✓": "the log gives what it needs: ", "✗": "the log lacks something: " }[mark] ?? "";
      const button = make("button", "", { "aria-pressed": String(chosen.includes(name)), "aria-label": words + name, onclick: () => this.set({ model: name.replace(":N", ":auto") }) });
      button.append(make("span", mark, { class: `mark ${["good", "", "bad"][rank(name)]}` }), name);
      return make("li", "", {}, button);
    }));
    $("models").scrollTop = top;
    const about = this.catalog.find((one) => one.name === chosen[0] || one.name === chosen[0]?.replace(/:.*/, ":N")), support = supports[chosen[0]];
    $("needs").replaceChildren(about ? `${about.about} ` : "");
    if (support) $("needs").append(make("span", `${support.possible ? "The log gives it" : "Not from this log"}: ${support.because}${support.remedy ? `; ${support.remedy}` : ""}.`, { class: support.possible ? "good" : "fair" }));
  }

  #showCommand = tried(async () => {
    if (!this.hooks.log()) return;
    const told = await post("/api/preview", this.step("identify"));
    $("command").textContent = told.command.map((word) => (/^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`)).join(" ");
  });

  /** The other logs, each to be fitted too, kept unseen to judge the model on, or neither. */
  showOthers(logs) {
    const rows = logs.map((one, k) => [one, k + 1]).filter(([one, k]) => one.state === "done" && k !== this.hooks.log());
    const key = JSON.stringify([rows.map(([one, k]) => [one.name, k]), this.now.with, this.now.unseen]);
    if (this.shownOthers === key) return;
    this.shownOthers = key;
    $("others").replaceChildren(...rows.map(([one, k]) => {
      const use = make("select", "", { "aria-label": `use of ${one.name}` }, make("option", "is not used", { value: "" }), make("option", "is fitted too", { value: "with" }), make("option", "judges the model", { value: "unseen" }));
      use.value = this.now.with.includes(k) ? "with" : this.now.unseen.includes(k) ? "unseen" : "";
      use.addEventListener("change", () => this.set({
        with: [...this.now.with.filter((n) => n !== k), ...(use.value === "with" ? [k] : [])],
        unseen: [...this.now.unseen.filter((n) => n !== k), ...(use.value === "unseen" ? [k] : [])],
      }));
      return make("li", `${one.name} `, {}, use);
    }));
  }
}
