// The choices: one object, its undo history, and the step that it makes.
import { CommandLine } from "./commands.js";
import { $, keep, kept, make, names, number, omegaOf, redrawn, shownOmega, tried } from "./page.js";

const EMPTY = { log: 0, segments: [], inputs: "", outputs: "", instrument: "", band: null, model: "", reduce: false, method: "auto", with: [], unseen: [] };
const AXES = ["roll", "pitch", "yaw", "thrust"];
const TEXTS = ["model", "inputs", "outputs", "instrument"];
const VERBS = ["review", "response", "identify"];

export class Choices {
  /** `hooks`: `changed()` after every change, `log()` the number of the shown log, `shownLog()` its contents, `isOpen(k)` whether a log can be fitted, `isReadable(k)` whether it can be looked at, `names()` of all logs, `view()` what the tracks show, `show(log)`. */
  constructor(hooks) {
    this.hooks = hooks;
    this.now = { ...EMPTY };
    this.before = [];
    this.after = [];
    this.catalog = [];
    this.halfBand = "";
    for (const name of TEXTS) $(name).addEventListener("change", () => this.set({ [name]: $(name).value.trim() }));
    for (const name of ["low", "high"]) $(name).addEventListener("change", () => this.#typedBand());
    $("no-band").addEventListener("click", () => this.set({ band: null }));
    $("reduce").addEventListener("change", () => this.set({ reduce: $("reduce").checked }));
    $("method").addEventListener("change", () => this.set({ method: $("method").value }));
    $("undo").addEventListener("click", () => this.undo());
    $("redo").addEventListener("click", () => this.redo());
    $("add-segment").addEventListener("click", () => this.brushed(...this.hooks.view()));
    this.commands = VERBS.map((verb) => {
      const line = new CommandLine(verb, () => this.step(verb));
      line.code.id = `command-${verb}`;
      $("commands").append(make("h4", verb[0].toUpperCase() + verb.slice(1)), line.place);
      return line;
    });
  }

  /** Restore the choices of this tab for these logs, or else those of the last step. */
  begin({ logs, steps, waiting }) {
    if (this.begun) return;
    this.begun = true;
    const last = [...steps.map((row) => row.step), ...waiting].filter((step) => ["identify", "response"].includes(step.verb)).at(-1);
    if (last) this.now = { ...EMPTY, ...choicesOf(last) };
    try {
      const { names: before, ...choices } = JSON.parse(kept("sessionStorage", "choices") ?? "{}");
      // Another server at the same address has other logs under the same numbers.
      if (before?.every((name, k) => logs[k]?.name === name)) this.now = { ...EMPTY, ...choices };
    } catch { /* nothing that can be read was kept */ }
  }

  /** Another log is shown. That is no choice, so undo does not return to it. */
  shown(log) { this.now.log = log; }

  /** Segments are on the clock of the log that they were marked on. */
  get segments() { return this.now.segments.filter((segment) => segment.log === this.hooks.log()); }

  set(change) {
    if ("band" in change) this.halfBand = "";
    this.finish(change);
  }

  /** An unfinished change, such as a dragged edge: undo does not return to it. */
  preview(change) {
    this.started ??= JSON.stringify(this.now);
    this.now = { ...this.now, ...change };
    this.hooks.changed();
  }

  finish(change) {
    const started = this.started ?? JSON.stringify(this.now);
    this.started = null;
    this.now = { ...this.now, ...change };
    if (JSON.stringify(this.now) !== started) {
      this.before.push(started);
      this.after = [];
    }
    this.show();
  }

  /** Take back an unfinished change. */
  forget() {
    if (this.started) this.now = JSON.parse(this.started);
    this.started = null;
    this.show();
  }

  undo() { this.#back(this.before, this.after); }

  redo() { this.#back(this.after, this.before); }

  /** A change is shown on the log on which it was made, from either side. */
  #back(from, to) {
    if (!from.length) return;
    const then = JSON.parse(from.pop());
    to.push(JSON.stringify({ ...this.now, log: then.log }));
    this.now = then;
    this.halfBand = "";
    if (this.hooks.isReadable(then.log)) this.hooks.show(then.log);
    else this.now.log = this.hooks.log();
    this.show();
  }

  #typedBand() {
    const texts = ["low", "high"].map((name) => $(name).value.trim().replace(",", ".")), [low, high] = texts.map(Number);
    if (texts.every((text) => !text)) this.set({ band: null });
    else if (low > 0 && high > low && Number.isFinite(high)) this.set({ band: [omegaOf(low), omegaOf(high)] });
    else {
      this.halfBand = "A band needs two frequencies above 0, the lower one first.";
      this.show();
    }
  }

  /** Of the excitation that the interval shares most with, if any; else of the segment before it. */
  brushed(start_s, stop_s) {
    const found = this.hooks.shownLog()?.inspection?.excitations ?? [];
    const shared = (excitation) => Math.min(stop_s, excitation.stop_s) - Math.max(start_s, excitation.start_s);
    const nearest = [...found].sort((a, b) => shared(b) - shared(a))[0];
    const axis = nearest && shared(nearest) > 0 ? nearest.axis : this.segments.at(-1)?.axis ?? nearest?.axis ?? "roll";
    this.addSegment({ axis, start_s, stop_s });
  }

  addSegment(segment) { this.set({ segments: [...this.now.segments, { log: this.hooks.log(), ...segment }] }); }

  /** All segments, with the k-th of this log changed; `null` removes it. */
  #with(k, part) {
    const old = this.segments[k];
    return { segments: this.now.segments.flatMap((segment) => (segment !== old ? [segment] : part ? [{ ...segment, ...part }] : [])) };
  }

  edged(k, side, at, last) {
    const change = this.#with(k, { [side]: at });
    if (last) this.finish(change); else this.preview(change);
  }

  step(verb, more = {}) {
    const others = (list) => list.filter((k) => k !== this.hooks.log() && this.hooks.isOpen(k));
    const { now } = this, step = { verb, logs: [this.hooks.log(), ...others(now.with)], ...more };
    if (verb === "review") { step.logs = [this.hooks.log()]; return step; }
    if (this.halfBand) throw new Error(this.halfBand);
    step.segments = this.segments.map(({ axis, start_s, stop_s }) => ({ axis, start_s, stop_s }));
    if (now.band) step.band_rad_s = now.band;
    if (names(now.instrument).length) step.instrument = names(now.instrument);
    for (const name of ["inputs", "outputs"]) {
      step[name] = names(now[name]);
      // A response has no model of its own: it is that between the channels of the model that is chosen.
      if (verb === "response" && !step[name].length) step[name] = this.#about(this.models[0])?.[name] ?? [];
    }
    if (verb !== "identify") return step;
    step.models = this.models;
    step.verify = others(now.unseen);
    if (now.reduce) step.reduce = true;
    if (now.method !== "auto") step.method = now.method;
    return step;
  }

  get supports() { return this.hooks.shownLog()?.inspection?.supports ?? {}; }

  /** Names of the chosen models: the first that the log gives, where none was chosen. */
  get models() {
    const found = names(this.now.model);
    return found.length ? found : [Object.entries(this.supports).find(([, support]) => support.possible)?.[0] ?? "rate.roll"];
  }

  #about(name) { return this.catalog.find((model) => model.name === name || model.name === name.replace(/:.*/, ":N")); }

  show() {
    const { now } = this;
    // Only what is finished is stored: the page may be redrawn during a drag that is then cancelled.
    const finished = this.started ? JSON.parse(this.started) : now;
    keep("sessionStorage", "choices", JSON.stringify({ ...finished, names: this.hooks.names() }));
    // Do not overwrite what somebody is typing.
    const fill = (name, text) => { if (document.activeElement !== $(name)) $(name).value = text; };
    for (const name of TEXTS) fill(name, now[name]);
    for (const [k, name] of ["low", "high"].entries()) if (!this.halfBand) fill(name, now.band ? number(shownOmega(now.band[k])) : "");
    $("band-needs").textContent = this.halfBand;
    for (const name of ["low", "high"]) $(name).setAttribute("aria-invalid", String(Boolean(this.halfBand)));
    $("reduce").checked = now.reduce;
    $("method").value = now.method;
    $("undo").disabled = !this.before.length;
    $("redo").disabled = !this.after.length;
    this.#showSegments();
    this.#showModels();
    if (this.hooks.log()) for (const line of this.commands) line.show();
    this.hooks.changed();
  }

  /** A row for each segment; rows stay, so that the focus does. */
  #showSegments() {
    const { segments } = this, list = $("segments");
    $("no-segments").hidden = segments.length > 0;
    $("shared-segments").hidden = !segments.length || !this.now.with.some((k) => this.hooks.isOpen(k));
    while (list.children.length < segments.length) list.append(this.#segmentRow(list.children.length));
    while (list.children.length > segments.length) {
      const last = list.lastElementChild, focused = last.contains(document.activeElement);
      last.remove();
      if (focused) (list.lastElementChild?.lastElementChild ?? $("add-segment")).focus();
    }
    segments.forEach((segment, k) => {
      for (const field of list.children[k].querySelectorAll("[data-of]")) {
        const value = segment[field.dataset.of];
        if (document.activeElement !== field || field.tagName === "SELECT") field.value = typeof value === "number" ? Number(value.toFixed(3)) : value;
      }
    });
  }

  #segmentRow(k) {
    const edge = (name, label, isRight) => {
      const field = make("input", "", { type: "number", step: "0.1", "data-of": name, "aria-label": `${label} of segment ${k + 1} in seconds` });
      field.addEventListener("change", tried(() => {
        const at = field.valueAsNumber, segment = this.segments[k];
        if (!Number.isFinite(at) || !isRight(at, segment)) {
          field.value = Number(segment[name].toFixed(3));
          throw new Error("A segment needs a start before its stop, both in seconds.");
        }
        this.set(this.#with(k, { [name]: at }));
      }));
      return field;
    };
    const axis = make("select", "", { "data-of": "axis", "aria-label": `axis of segment ${k + 1}` }, ...AXES.map((name) => make("option", name)));
    axis.addEventListener("change", () => this.set(this.#with(k, { axis: axis.value })));
    return make("li", "", {}, axis, edge("start_s", "start", (at, segment) => at < segment.stop_s), "to", edge("stop_s", "stop", (at, segment) => at > segment.start_s), "s",
      make("button", "×", { class: "plain", "aria-label": `remove segment ${k + 1}`, onclick: () => this.set(this.#with(k, null)) }));
  }

  /** The models of the library; those possible with this log come first, with a mark. */
  #showModels() {
    const { supports, models: chosen } = this;
    $("model").placeholder = chosen[0];
    const rank = (name) => (supports[name] ? (supports[name].possible ? 0 : 2) : 1);
    const all = [...new Set([...Object.keys(supports), ...this.catalog.map((model) => model.name)])].filter((name) => !/[/*]/.test(name));
    all.sort((a, b) => rank(a) - rank(b));
    const key = JSON.stringify(all.map((name) => [name, rank(name)]));
    if (this.shownModels !== key) {
      this.shownModels = key;
      const top = $("models").scrollTop;
      redrawn($("models"), all.map((name) => {
        const mark = ["✓", "", "✗"][rank(name)], words = { "✓": "possible with this log: ", "✗": "not possible with this log: " }[mark] ?? "";
        const button = make("button", "", { "data-key": name, "aria-label": words + name, onclick: () => this.set({ model: name.replace(":N", ":auto") }) });
        button.append(make("span", mark, { class: `mark ${["good", "", "bad"][rank(name)]}` }), name);
        return make("li", "", {}, button);
      }), $("model"));
      $("models").scrollTop = top;
    }
    const about = this.#about(chosen[0]), support = supports[chosen[0]];
    for (const button of $("models").querySelectorAll("button")) button.setAttribute("aria-pressed", String(chosen.includes(button.dataset.key.replace(":N", ":auto"))));
    for (const name of ["inputs", "outputs"]) $(name).placeholder = about?.[name]?.length ? `${about[name].join(",")}, from ${chosen[0]}` : "from the model";
    $("needs").replaceChildren(about ? `${about.about} ` : "");
    if (support) $("needs").append(make("span", `${support.possible ? "Possible with this log" : "Not possible with this log"}: ${support.because}${support.remedy ? `; ${support.remedy}` : ""}.`, { class: support.possible ? "good" : "fair" }));
  }

  /** The other logs: each also fitted, used for verification, or not used. */
  showOthers(logs) {
    const rows = logs.map((log, k) => [log, k + 1]).filter(([log, k]) => log.state === "done" && k !== this.hooks.log());
    const key = JSON.stringify(rows.map(([log, k]) => [log.name, k]));
    if (this.shownOthers !== key) {
      this.shownOthers = key;
      redrawn($("others"), rows.map(([log, k]) => {
        const use = make("select", "", { "data-key": k, "aria-label": `use of ${log.name}` }, make("option", "not used", { value: "" }), make("option", "also fitted", { value: "with" }), make("option", "for verification", { value: "unseen" }));
        use.addEventListener("change", () => this.set({
          with: [...this.now.with.filter((n) => n !== k), ...(use.value === "with" ? [k] : [])],
          unseen: [...this.now.unseen.filter((n) => n !== k), ...(use.value === "unseen" ? [k] : [])],
        }));
        return make("li", `${log.name} `, {}, use);
      }));
    }
    for (const use of $("others").querySelectorAll("select")) {
      const k = Number(use.dataset.key);
      use.value = this.now.with.includes(k) ? "with" : this.now.unseen.includes(k) ? "unseen" : "";
    }
  }
}

/** What a step was chosen by. */
function choicesOf(step) {
  const [log, ...others] = step.logs;
  return {
    log, with: others, unseen: step.verify, band: step.band_rad_s, reduce: step.reduce, method: step.method,
    model: step.models.join(","), segments: step.segments.map((segment) => ({ log, ...segment })),
    ...Object.fromEntries(["inputs", "outputs", "instrument"].map((name) => [name, step[name].join(",")])),
  };
}
