// Results: a card for every step, and a table that compares identified models.
import { CommandLine, copyable } from "./commands.js";
import { $, ask, counted, ends, make, number, omegaOf, headingOf, loopOf, redrawn, shownFigure, shownOmega, tableOf, tried, unitOf, unitText, watched, withStd, within, words } from "./page.js";
import { colors, lines, phaseOf, released } from "./plots.js";

const TARGETS = [
  ...["px4-sih", "ardupilot", "gazebo", "mujoco", "rotorpy", "urdf", "rl-tools", "crazyflow", "pyflyt"],
  ...["aerial-gym", "flightmare", "allocation", "matlab", "control", "fmu", "json"],
];
const WORDS = { waiting: "waiting for a free slot", running: "running", done: "done", refused: "refused", failed: "failed", canceled: "canceled" };
/** Responses that are drawn at once; of more, each is drawn when it is opened. */
const FEW = 4;
/** Verdicts on unseen maneuvers in the words of reports. */
const PREDICTIONS = { good: "good", diverges: "good short-term, diverges in open loop", disturbed: "disturbed", poor: "poor" };
const goes = (row) => ["waiting", "running"].includes(row.state);
/** Results of a step, one for each model. */
const resultsOf = (answer) => answer?.document?.results ?? (answer?.document ? [answer.document] : []);

export class Results {
  /** `hooks`: `log()`, `name(log)`, `start(step)`, `band([low, high])`, `refresh()`. */
  constructor(hooks) {
    this.hooks = hooks;
    this.shown = new Map();
    this.answers = new Map();
    this.compared = "";
  }

  /** Draw everything again, in another unit or other colors. */
  async redraw(steps) {
    this.shown.clear();
    this.compared = "";
    await this.show(steps);
  }

  async show(steps) {
    $("results").hidden = !steps.length;
    for (let k = 1; k <= steps.length; k += 1) {
      if (!$(`step-${k}`)) {
        $("steps").prepend(make("article", "", { id: `step-${k}`, tabindex: "-1", "aria-labelledby": `title-${k}` }));
        CommandLine.showAll();
      }
      await this.#showStep(k, steps[k - 1]);
    }
    this.#compare(steps);
  }

  #showStep = watched(async (k, row) => {
    const card = $(`step-${k}`);
    if (this.shown.get(k) !== row.state) {
      if (!goes(row) && !this.answers.has(k)) this.answers.set(k, await ask(`/api/steps/${k}`));
      if (this.shown.get(k) !== row.state) this.#draw(card, row, k);
      this.shown.set(k, row.state);
    }
    if (goes(row)) this.#live(card, row);
  });

  /** The card of a step in its present state; the focus stays in it. */
  #draw(card, row, k) {
    const body = make("div", "", { class: "body" }), bad = ["refused", "failed"].includes(row.state);
    const head = make("header", "", {}, make("h3", `${k}. ${row.step.verb} ${row.step.models.join(", ")}`, { id: `title-${k}` }),
      make("span", [WORDS[row.state], row.sentence].filter(Boolean).join(": "), { class: `state ${bad ? "bad" : "soft"}`, role: "status" }),
      // Seconds are visible, but not read aloud each time.
      make("span", `${row.seconds} s`, { class: "since soft" }));
    if (goes(row)) {
      head.append(make("progress", "", { "aria-label": `progress of step ${k}` }), make("canvas", "", { class: "live", width: 440, height: 120, role: "img", "aria-label": "cost over the steps of the fit", hidden: true }),
        make("button", "Cancel", { "aria-label": `cancel step ${k}`, onclick: tried(async () => { await ask(`/api/steps/${k}`, { method: "DELETE" }); await this.hooks.refresh(); }) }));
    } else {
      const fold = make("button", card.hasAttribute("data-folded") ? "Show" : "Hide", { class: "plain", "data-key": "fold", "aria-label": `fold step ${k}`, onclick: () => { fold.textContent = card.toggleAttribute("data-folded") ? "Show" : "Hide"; } });
      head.append(fold);
    }
    released(card);
    redrawn(card, [head, body], card);
    body.append(copyable(row.command, `step ${k}`).place);
    card.dataset.state = row.state;
    if (!goes(row)) this.#fill(body, row, this.answers.get(k), k);
  }

  /** Progress of a command: a share where a count is known, and the cost of the fit step by step. */
  #live(card, row) {
    const bar = card.querySelector("progress"), canvas = card.querySelector("canvas.live");
    card.querySelector(".since").textContent = [`${row.seconds} s`, row.doing].filter(Boolean).join(": ");
    if (row.share === null) bar.removeAttribute("value"); else bar.value = row.share;
    canvas.hidden = row.costs.length < 2;
    if (canvas.hidden) return;
    const context = canvas.getContext("2d"), logs = row.costs.map((cost) => Math.log10(Math.max(cost, 1e-12)));
    const low = Math.min(...logs), high = Math.max(...logs, low + 1e-6);
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.strokeStyle = context.fillStyle = colors()[0];
    context.lineWidth = 2;
    context.beginPath();
    logs.forEach((value, n) => context.lineTo((n / Math.max(logs.length - 1, 1)) * (canvas.width - 130) + 4, 8 + ((high - value) / (high - low)) * (canvas.height - 16)));
    context.stroke();
    context.font = "22px system-ui";
    context.fillText(number(row.costs.at(-1)), canvas.width - 118, 60);
  }

  #fill(body, row, answer, k) {
    const results = resultsOf(answer);
    for (const result of results) {
      if (results.length > 1) body.append(make("h4", result.model, { class: "model" }));
      SHOWS[row.step.verb]?.call(this, body, result, k, row, answer);
      const curves = answer.document.results ? answer.parts[result.model] : answer.curves;
      if (curves?.omega_rad_s) this.#curves(body, curves, k);
      findings(body, result.findings ?? []);
    }
    if (row.step.verb === "identify" && results.some((result) => result.parameters)) body.append(this.#tuneRow(k, row, results), this.#exportRow(k, [k]));
    if (row.step.verb === "export" && results.length) body.append(this.#exportRow(k, row.step.results, results[0]));
    if (!answer.files.length) return;
    const files = make("div", "", { class: "row files" });
    if (answer.files.some((name) => name.endsWith(".html"))) files.append(make("a", "Open the report", { href: `/api/steps/${k}/report`, target: "_blank", rel: "noopener" }));
    files.append(make("span", "Files:", { class: "soft" }), ...answer.files.map((name, n) => make("a", name, { href: `/api/steps/${k}/files/${n}`, download: name.split("/").at(-1) })));
    body.append(files);
  }

  #curves(body, curves, k) {
    const pairs = curves.outputs.flatMap((output, i) => curves.inputs.map((input, j) => ({ name: `${output} / ${input}`, i, j })))
      .filter(({ i, j }) => usedOf(curves, i, j).some(Boolean));
    for (const pair of pairs) {
      if (pairs.length <= FEW) {
        body.append(make("h4", `${pair.name} `, {}, make("span", "drag on a picture to choose the band", { class: "soft" })));
        this.#pair(body, curves, k, pair);
        continue;
      }
      const place = make("details", "", {}, make("summary", pair.name));
      place.addEventListener("toggle", () => { if (place.open && !place.querySelector(".bodes")) this.#pair(place, curves, k, pair); });
      body.append(place);
    }
  }

  /** The pictures of one response, in a place that has its width. */
  #pair(place, curves, k, { name, i, j }) {
    const x = curves.omega_rad_s.map(shownOmega), db = $("scale").value === "db";
    const sizeOf = (length) => (db ? (length > 0 ? 20 * Math.log10(length) : null) : length);
    const size = (re, im) => re.map((value, n) => (value === null || im[n] === null ? null : sizeOf(Math.hypot(value, im[n]))));
    const brush = (a, b) => this.hooks.band([omegaOf(a), omegaOf(b)].map((value) => Number(value.toPrecision(4))));
    const re = curves["values.re"][i][j], im = curves["values.im"][i][j], error = curves.random_error?.[i][j];
    const modelRe = curves["model.re"]?.[i][j], modelIm = curves["model.im"]?.[i][j];
    // The tables count used points alone: all others are drawn gray and dashed, and a model beyond them dashed.
    const used = usedOf(curves, i, j), [first, last] = [used.indexOf(true), used.lastIndexOf(true)];
    const inside = (values) => values.map((value, n) => (used[n] ? value : null));
    const outside = (values) => values.map((value, n) => (used[n] && used[n - 1] !== false && used[n + 1] !== false ? null : value));
    const spanned = (values) => values.map((value, n) => (n >= first && n <= last ? value : null));
    const beyond = (values) => values.map((value, n) => (n > first && n < last ? null : value));
    const measuredRows = (values) => [{ label: "measured", y: inside(values), color: 0 }, ...(used.every(Boolean) ? [] : [{ label: "left out", y: outside(values), faded: true }])];
    const modelRows = (values) => [{ label: "model", y: spanned(values), color: 1 }, ...(first === 0 && last === used.length - 1 ? [] : [{ label: "model, not fitted", y: beyond(values), color: 1, dashed: true }])];
    const both = (part) => [...measuredRows(part(re, im)), ...(modelRe ? modelRows(part(modelRe, modelIm)) : [])];
    const magnitude = both(size);
    const edge = (sign) => re.map((value, n) => (!used[n] || value === null || im[n] === null || error[n] === null || 1 + sign * error[n] <= 0 ? null : sizeOf(Math.hypot(value, im[n]) * (1 + sign * error[n]))));
    const strip = error ? [edge(-1), edge(1)] : [];
    if (error) magnitude[0].label = "measured ± std";
    const box = make("div", "", { class: "bodes" }), shared = { x, xLabel: unitText(), brush, sync: `step-${k}` };
    const drawn = [
      { title: `${name}: magnitude`, rows: magnitude, within: strip, yLabel: db ? "dB" : "" },
      { title: `${name}: phase`, rows: both(phaseOf), yLabel: "deg" },
      { title: `${name}: coherence`, rows: measuredRows(curves.coherence[i][j]), yLabel: "", height: 140 },
    ];
    if (modelRe) drawn.push({ title: `${name}: residual`, rows: [{ label: "|measured − model| / |measured|", y: re.map((value, n) => (!used[n] || [value, im[n], modelRe[n], modelIm[n]].includes(null) ? null : Math.hypot(value - modelRe[n], im[n] - modelIm[n]) / Math.hypot(value, im[n]))) }], yLabel: "", height: 140 });
    place.append(box);
    for (const picture of drawn) lines(box.appendChild(make("div")), { ...shared, ...picture });
  }

  /** Compare identified models: other structures, bands, methods or logs. */
  #compare(steps) {
    const done = steps.flatMap((row, n) => (row.state === "done" && row.step.verb === "identify" ? resultsOf(this.answers.get(n + 1)).filter((result) => result.parameters).map((result) => ({ result, head: `${n + 1}. ${result.model}` })) : []));
    const key = done.map(({ head }) => head).join();
    if (this.compared === key) return;
    this.compared = key;
    $("comparison").replaceChildren();
    if (done.length < 2) return;
    const documents = done.map(({ result }) => result);
    const rows = [...new Set(documents.flatMap((result) => Object.keys(result.parameters)))].map((name) => {
      const unit = unitOf(documents.find((result) => result.parameters[name]).parameters[name].unit);
      return [unit ? `${name} [${unit}]` : name, ...documents.map((result) => (result.parameters[name] ? within(result.parameters[name]) : "–"))];
    });
    rows.push(["cost (up to 100 is acceptable)", ...documents.map((result) => number(result.cost?.average))]);
    rows.push(["TIC on unseen flight (up to 0.25 is good)", ...documents.map((result) => {
      const tics = (result.verification?.maneuvers ?? []).flatMap((flown) => Object.values(flown.scores).map((score) => score.tic)).filter((value) => value !== null);
      return tics.length ? number(tics.reduce((sum, value) => sum + value, 0) / tics.length, 3) : "–";
    })]);
    $("comparison").append(tableOf("Identified models: value ± half of the 95 % interval", ["", ...done.map(({ head }) => head)], rows));
  }

  #tuneRow(k, row, results) {
    const [soft, first] = slider("Largest peak sensitivity M_s", { min: 1.2, max: 2.4, step: 0.05, value: 1.7, text: (value) => `${Number(value).toFixed(2)} ${value < 1.5 ? "soft" : value > 1.9 ? "sharp" : ""}` });
    const [noise, second] = slider("Noise at the motors", { min: 0.5, max: 4, step: 0.1, value: 2, text: (value) => `${Number(value).toFixed(1)} times today's` });
    const keep = ["P", "I", "D", "A"].map((name) => [name, make("input", "", { type: "checkbox" })]);
    // The flown gains are those of the fitted logs, whichever log is shown now.
    const tune = () => ({
      verb: "tune", results: [k], logs: row.step.logs, robustness: Number(soft.value), noise: Number(noise.value),
      keep: keep.filter(([, box]) => box.checked).map(([name]) => name),
    });
    const place = make("div", "", { class: "use" }, make("div", "", { class: "row" }, make("b", "Gains"), first, second,
      make("span", "", { class: "row" }, "leave unchanged", ...keep.map(([name, box]) => make("label", "", {}, box, ` ${name === "A" ? "angle" : name}`))), make("button", "Tune", { onclick: () => this.hooks.start(tune()) })), folded("tune", tune, [soft, noise, ...keep.map(([, box]) => box)]));
    const verify = () => ({ verb: "verify", results: [k], logs: [this.hooks.log()] });
    if (results.length > 1) place.append(make("p", "To verify one of these models on another flight, identify only this one.", { class: "soft" }));
    else place.append(make("div", "", { class: "row" }, make("b", "Another flight"), make("button", `Verify on ${this.hooks.name(this.hooks.log())}`, { class: "verify", onclick: () => this.hooks.start(verify()) })), folded("verify", verify, []));
    return place;
  }

  /** Another log is shown: buttons that use it name it. */
  named() {
    for (const button of document.querySelectorAll("#steps .verify")) button.textContent = `Verify on ${this.hooks.name(this.hooks.log())}`;
    CommandLine.showAll();
  }

  /** The target of an export, and values that the result does not have. */
  #exportRow(k, results, last = null) {
    const target = make("select", "", { "aria-label": "target of the export" }, ...TARGETS.map((name) => make("option", name)));
    const values = make("input", "", { placeholder: "m=1.4, I_xx=0.02", "aria-label": "values to set, NAME=VALUE with commas" });
    if (last) target.value = last.target;
    const step = () => {
      const given = Object.fromEntries(values.value.split(",").map((pair) => pair.split("=").map((part) => part.trim())).filter((pair) => pair[0]).map(([name, value]) => {
        if (!value || !Number.isFinite(Number(value))) throw new Error(`${name}: write NAME=NUMBER, such as m=1.4.`);
        return [name, Number(value)];
      }));
      return { verb: "export", results, logs: [], to: target.value, values: given };
    };
    return make("div", "", { class: "use" }, make("div", "", { class: "row" }, make("b", last ? "Export again" : "Export to"), target, make("label", "set ", {}, values), make("button", "Export", { onclick: tried(() => this.hooks.start(step())) })), folded("export", step, [target, values]));
  }
}

/** The command line of a button, asked for when it is opened and when `fields` change. */
function folded(what, step, fields) {
  const line = new CommandLine(what, step), place = make("details", "", { class: "terminal" }, make("summary", "Command line"), line.place);
  const show = () => { if (place.open) line.show(); };
  place.addEventListener("toggle", show);
  for (const field of fields) field.addEventListener("change", show);
  return place;
}

function findings(body, found) {
  const limits = found.filter((finding) => finding.severity !== "info"), remarks = found.filter((finding) => finding.severity === "info");
  const listed = (list) => make("ul", "", {}, ...list.slice(0, 60).map((finding) => make("li", `${headingOf(finding.kind)} (${finding.where}): ${finding.message}`, { class: { error: "bad", warning: "fair" }[finding.severity] ?? "" })));
  if (limits.length) body.append(make("h4", "Warnings"), listed(limits));
  if (remarks.length) body.append(make("details", "", {}, make("summary", counted(remarks.length, "note")), listed(remarks)));
}

/** A row for each figure that any of the columns holds. */
function figures(caption, columns) {
  const names = new Set(columns.flatMap(([, quantities]) => Object.keys(quantities).filter((name) => quantities[name]?.unit !== undefined)));
  return tableOf(caption, ["", ...columns.map(([name]) => name)], [...names].map((name) => [words(name), ...columns.map(([, quantities]) => shownFigure(name, quantities[name]))]));
}

/** Which points of a response count: the fitted ones of a model, the usable ones of a measurement. */
const usedOf = (curves, i, j) => (curves.fitted ?? curves.used)?.[i][j].map(Boolean) ?? curves["values.re"][i][j].map((value) => value !== null);

/** The class of a verdict's color. */
const CLASSES = { green: "good", yellow: "fair", red: "bad", gray: "soft" };

const SHOWS = {
  identify(body, result) {
    const rows = Object.entries(result.parameters ?? {});
    if (!rows.length) return;
    body.append(tableOf("Parameters", ["parameter", "value", "95 % from", "to", "unit", "status"], rows.map(([name, parameter]) => [name, ...ends(parameter), unitOf(parameter.unit), parameter.status])));
    if (result.verdict) body.append(make("p", "Fit: ", {}, make("b", result.verdict.word, { class: CLASSES[result.verdict.color] }), `. ${result.verdict.reason}`));
    else if (result.cost) body.append(make("p", `Average cost ${number(result.cost.average)} (up to 100 is acceptable).`));
    if (result.poles?.length) {
      const part = (value, std) => withStd(shownOmega(value), shownOmega(std));
      body.append(tableOf(`Poles, in ${unitText()}, ± half of the 95 % interval`, ["real part", "imaginary part", "frequency", "damping"], result.poles.filter((pole) => pole.imag >= 0).map((pole) =>
        [part(pole.real, pole.real_std), pole.imag ? part(pole.imag, pole.imag_std) : "0", part(pole.frequency_rad_s, pole.frequency_std_rad_s), withStd(pole.damping, pole.damping_std)])));
    }
    scores(body, result.verification?.maneuvers ?? []);
  },
  verify(body, result) {
    scores(body, result.maneuvers ?? []);
  },
  review(body, result, k, row, answer) {
    for (const [n, review] of (result.reviews ?? [result]).entries()) {
      body.append(make("div", "", { class: "cards" }, ...(review.cards ?? []).map((card) => make("div", "", { class: CLASSES[card.color] ?? "" }, make("b", card.title), make("span", card.word ?? "", { class: CLASSES[card.color] ?? "soft" }), make("span", ` ${card.number ?? ""}`, { class: "figure" }), make("p", card.sentence, { class: "soft" })))));
      const loops = Object.entries(review.loops ?? {}), margins = Object.entries(review.margins ?? {});
      const tables = [
        ...(loops.length ? [figures("Loops", loops.map(([name, loop]) => [loopOf(name), loop]))] : []),
        ...(margins.length ? [figures("Margins", margins)] : []),
      ];
      if (tables.length) body.append(make("details", "", {}, make("summary", "Loops and margins in numbers"), ...tables));
      const gaps = answer.unavailable[n];
      if (gaps.length) body.append(make("details", "", {}, make("summary", `Not enough data: ${gaps.length}`), make("ul", "", {}, ...gaps.map((gap) => make("li", `${gap.what}: ${gap.why} ${gap.remedy ? `To measure it: ${gap.remedy.replace(/\.$/, "")}.` : ""}`)))));
    }
  },
  tune(body, result, k) {
    for (const [axis, tuned] of Object.entries(result.axes ?? {})) {
      const gains = Object.entries(tuned.gains ?? {}), rows = Object.keys(tuned.flown ?? {}).filter((name) => tuned.proposed?.[name]);
      body.append(tableOf(`${axis}: gains`, ["parameter", "flown", "proposed"], gains.map(([name, gain]) => [name, number(gain.flown), number(gain.proposed)])));
      body.append(tableOf(`${axis}: rate loop, over all likely vehicles`, ["", "flown", "proposed"], rows.map((name) => [words(name), shownFigure(name, tuned.flown[name]), shownFigure(name, tuned.proposed[name])])));
      for (const sentence of [...(tuned.reasons ?? []), ...(tuned.notes ?? [])]) body.append(make("p", typeof sentence === "string" ? sentence : sentence.message ?? "", { class: "soft" }));
    }
    body.append(make("p", "", {}, make("a", "Adjust gains by hand and see the margins", { href: `/api/steps/${k}/report`, target: "_blank", rel: "noopener" })));
  },
  export(body, result) {
    body.append(tableOf("Quantities", ["quantity", "identified", "exported", "unit"], result.quantities.map((quantity) => [quantity.name, number(quantity.identified), number(quantity.exported), unitOf(quantity.unit)])));
  },
};

function scores(body, maneuvers) {
  const rows = maneuvers.flatMap((maneuver) => Object.entries(maneuver.scores).map(([output, score]) => [`${maneuver.axis} ${maneuver.kind} at ${maneuver.start_s.toFixed(1)} s of ${maneuver.record}`, output, number(score.tic, 3), `${number(score.nrmse_fit_percent, 3)} %`, PREDICTIONS[maneuver.verdict] ?? maneuver.verdict]));
  if (rows.length) body.append(tableOf("On unseen maneuvers", ["maneuver", "output", "TIC (up to 0.25 is good)", "fit", "verdict"], rows));
}

function slider(label, { min, max, step, value, text }) {
  const range = make("input", "", { type: "range", min, max, step, "aria-label": label }), read = make("output", text(value));
  range.value = value;
  range.addEventListener("input", () => { read.textContent = text(range.value); });
  return [range, make("label", `${label} `, {}, range, " ", read)];
}
