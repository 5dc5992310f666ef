// Results: a card for every step, and a table that puts identifications beside each other.
import { $, ask, counted, inHz, make, number, omegaOf, shownOmega, shownRate, tableOf, tried, unitText, within } from "./page.js";
import { colors, lines, phaseOf } from "./plots.js";

const TARGETS = ["px4-sih", "ardupilot", "gazebo", "mujoco", "rotorpy", "urdf", "matlab", "control", "fmu", "json"];
const WORDS = { waiting: "waits for a free place", running: "runs", refused: "was refused", failed: "failed", canceled: "was canceled" };
const plain = (name) => name.replaceAll("_", " ");

export class Results {
  /** `hooks`: `log()`, `start(step)`, `band([low, high])`, `refresh()`. */
  constructor(hooks) {
    this.hooks = hooks;
    this.shown = new Map();
    this.told = new Map();
  }

  /** Draw everything anew, as in another unit or other colors. */
  redraw(steps) {
    this.shown.clear();
    this.show(steps);
  }

  async show(steps) {
    $("results").hidden = !steps.length;
    for (let k = 1; k <= steps.length; k += 1) {
      if (!$(`step-${k}`)) $("steps").prepend(make("article", "", { id: `step-${k}`, "aria-labelledby": `title-${k}` }));
      await this.#showStep(k, steps[k - 1]);
    }
    this.#compare(steps);
  }

  #showStep = tried(async (k, row) => {
    const card = $(`step-${k}`), goes = row.state === "running" || row.state === "waiting";
    if (this.shown.get(k) !== row.state) {
      this.shown.set(k, row.state);
      const told = goes ? null : await ask(`/api/steps/${k}`);
      if (told) this.told.set(k, told);
      const body = make("div", "", { class: "body" });
      const fold = make("button", card.hasAttribute("data-folded") ? "Show" : "Hide", { class: "plain", "aria-label": `fold step ${k}`, onclick: () => { fold.textContent = card.toggleAttribute("data-folded") ? "Show" : "Hide"; } });
      const head = make("header", "", {}, make("h3", `${k}. ${row.step.verb} ${row.step.models.join(", ")}`, { id: `title-${k}` }), make("span", "", { class: "told", role: "status" }));
      if (goes) head.append(make("progress", "", { "aria-label": `progress of step ${k}` }), make("canvas", "", { class: "live", width: 440, height: 120, role: "img", "aria-label": "cost over the steps of the fit", hidden: true }), make("button", "Cancel", { onclick: tried(async () => { await ask(`/api/steps/${k}`, { method: "DELETE" }); await this.hooks.refresh(); }) }));
      else head.append(fold);
      card.replaceChildren(head, body);
      body.append(make("p", "", {}, make("code", row.command.join(" "))));
      if (told) this.#fill(body, row, told, k);
    }
    card.dataset.state = row.state;
    const line = card.querySelector(".told");
    line.textContent = row.state === "done" ? `${row.seconds} s` : row.sentence ? `${WORDS[row.state]}: ${row.sentence}` : `${WORDS[row.state]}, ${row.seconds} s${row.told ? `: ${row.told}` : ""}`;
    line.className = `told ${["refused", "failed"].includes(row.state) ? "bad" : "soft"}`;
    if (goes) this.#live(card, row);
  });

  /** How far a command is: a share where a count is known, and the cost of the fit step by step. */
  #live(card, row) {
    const bar = card.querySelector("progress"), canvas = card.querySelector("canvas.live");
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

  #fill(body, row, told, k) {
    const found = told.document?.findings ?? [];
    if (told.document) {
      SHOWS[row.step.verb]?.call(this, body, told.document, k);
      this.#curves(body, told.curves, k);
    }
    const limits = found.filter((one) => one.severity !== "info"), remarks = found.filter((one) => one.severity === "info");
    const listed = (list) => make("ul", "", {}, ...list.slice(0, 60).map((one) => make("li", `${plain(one.kind)} (${one.where}): ${one.message}`, { class: { error: "bad", warning: "fair" }[one.severity] ?? "" })));
    if (limits.length) body.append(make("h4", "What limits the trust"), listed(limits));
    if (remarks.length) body.append(make("details", "", {}, make("summary", counted(remarks.length, "remark")), listed(remarks)));
    if (!told.files.length) return;
    const page = told.files.some((name) => name.endsWith(".html"));
    const files = make("div", "", { class: "row" });
    if (page) files.append(make("a", "Open the report", { href: `/api/steps/${k}/report`, target: "_blank", rel: "noopener" }));
    files.append(make("span", "Files:", { class: "soft" }), ...told.files.map((name, n) => make("a", name, { href: `/api/steps/${k}/files/${n}`, download: name.split("/").at(-1) })));
    body.append(files);
  }

  #curves(body, curves, k) {
    if (!curves.omega_rad_s) return;
    const x = curves.omega_rad_s.map(shownOmega), db = $("scale").value === "db";
    const size = (re, im) => re.map((value, n) => {
      if (value === null || im[n] === null) return null;
      const length = Math.hypot(value, im[n]);
      return db ? (length ? 20 * Math.log10(length) : null) : length;
    });
    const brush = (a, b) => this.hooks.band([omegaOf(a), omegaOf(b)].map((value) => Number(value.toPrecision(4))));
    curves.outputs.forEach((output, i) => curves.inputs.forEach((input, j) => {
      const re = curves["values.re"][i][j], im = curves["values.im"][i][j];
      if (re.every((value) => value === null)) return;
      const modelRe = curves["model.re"]?.[i][j], modelIm = curves["model.im"]?.[i][j];
      const both = (part) => [{ label: "measured", y: part(re, im) }, ...(modelRe ? [{ label: "model", y: part(modelRe, modelIm) }] : [])];
      const magnitude = both(size), error = curves.random_error?.[i][j];
      for (const sign of error ? [-1, 1] : []) {
        magnitude.push({ label: sign < 0 ? "− std" : "+ std", dash: [2, 3], y: magnitude[0].y.map((value, n) => {
          if (value === null || error[n] === null || 1 + sign * error[n] <= 0) return null;
          return db ? value + 20 * Math.log10(1 + sign * error[n]) : value * (1 + sign * error[n]);
        }) });
      }
      const name = `${output} / ${input}`, box = make("div", "", { class: "bodes" }), shared = { x, xLabel: unitText(), brush, sync: `step-${k}` };
      const grid = () => { const one = make("div"); box.append(one); return one; };
      body.append(make("h4", `${name} `, {}, make("span", "a drag on a picture chooses the band", { class: "soft" })), box);
      lines(grid(), { ...shared, title: `${name}: magnitude`, rows: magnitude, yLabel: db ? "dB" : "" });
      lines(grid(), { ...shared, title: `${name}: phase`, rows: both(phaseOf), yLabel: "deg" });
      lines(grid(), { ...shared, title: `${name}: coherence`, rows: [{ label: "coherence", y: curves.coherence[i][j] }], yLabel: "", height: 140 });
      if (modelRe) lines(grid(), { ...shared, title: `${name}: residual`, rows: [{ label: "|measured − model| / |measured|", y: re.map((value, n) => ([value, im[n], modelRe[n], modelIm[n]].includes(null) ? null : Math.hypot(value - modelRe[n], im[n] - modelIm[n]) / Math.hypot(value, im[n]))) }], yLabel: "", height: 140 });
    }));
  }

  /** Identifications side by side: models, bands, methods, logs. */
  #compare(steps) {
    const done = steps.map((row, n) => [row, n + 1]).filter(([row, k]) => row.state === "done" && row.step.verb === "identify" && this.told.get(k)?.document?.parameters);
    const key = done.map(([, k]) => k).join();
    if (this.compared === key) return;
    this.compared = key;
    $("comparison").replaceChildren();
    if (done.length < 2) return;
    const documents = done.map(([, k]) => this.told.get(k).document);
    const rows = [...new Set(documents.flatMap((one) => Object.keys(one.parameters)))].map((name) => {
      const unit = documents.find((one) => one.parameters[name]).parameters[name].unit;
      return [unit === "1" ? name : `${name} in ${unit}`, ...documents.map((one) => (one.parameters[name] ? within(one.parameters[name]) : "–"))];
    });
    rows.push(["cost", ...documents.map((one) => number(one.cost?.average))]);
    rows.push(["Theil's coefficient, unseen", ...documents.map((one) => {
      const told = (one.verification?.maneuvers ?? []).flatMap((flown) => Object.values(flown.scores).map((score) => score.tic)).filter((value) => value !== null);
      return told.length ? number(told.reduce((sum, value) => sum + value, 0) / told.length, 3) : "–";
    })]);
    const heads = ["", ...done.map(([row, k]) => `${k}. ${row.step.models.join(", ")}`)];
    $("comparison").append(tableOf("Identifications beside each other: value ± half of the 95 % interval", heads, rows));
  }
}

const rateInterval = (one) => within(shownRate(one));

const SHOWS = {
  identify(body, told, k) {
    const rows = Object.entries(told.parameters ?? {});
    if (!rows.length) return;
    body.append(tableOf("Parameters", ["parameter", "value", "95 % from", "to", "unit", "status"], rows.map(([name, one]) => [name, number(one.value, 6), number(one.lower, 6), number(one.upper, 6), one.unit === "1" ? "" : one.unit, one.status])));
    if (told.cost) body.append(make("p", `Average cost ${number(told.cost.average)}: ${told.cost.average <= 50 ? "excellent" : told.cost.average <= 100 ? "acceptable" : "poor"} by the guideline (50, 100).`));
    if (told.poles?.length) {
      const poles = told.poles.filter((one) => one.imag >= 0);
      body.append(tableOf(`Poles, in ${unitText()}`, ["pole", "frequency", "damping"], poles.map((one) => {
        const part = (value) => number(shownOmega(value));
        return [`${part(one.real)}${one.imag ? ` ± ${part(one.imag)}j` : ""}`, part(one.frequency_rad_s), number(one.damping, 3)];
      })));
    }
    scores(body, told.verification?.maneuvers ?? []);
    body.append(tuneRow.call(this, k), exportRow.call(this, k, null));
  },
  verify(body, told) {
    scores(body, told.maneuvers ?? []);
  },
  review(body, told) {
    for (const one of told.reviews ?? [told]) {
      body.append(make("div", "", { class: "cards" }, ...(one.cards ?? []).map((card) => make("div", "", { class: card.state }, make("b", card.title), make("span", card.number ?? "", { class: "figure" }), make("p", card.sentence, { class: "soft" })))));
      const loops = Object.entries(one.loops ?? {}), margins = Object.entries(one.margins ?? {});
      if (loops.length) body.append(tableOf("Loops", ["loop", `bandwidth (−3 dB) in ${unitText()}`, "delay in s", "overshoot in %"], loops.map(([name, loop]) => [name, rateInterval(loop.bandwidth_3db_rad_s), within(loop.delay_s), within(loop.overshoot_percent)])));
      if (margins.length) body.append(tableOf("Margins", ["axis", `crossover in ${unitText()}`, "phase margin in deg", "gain margin in dB", "peak of sensitivity"], margins.map(([name, margin]) => [name, rateInterval(margin.crossover_rad_s), within(margin.phase_margin_deg), within(margin.gain_margin_db), within(margin.sensitivity_peak)])));
      if (one.cannot_tell?.length) body.append(make("details", "", {}, make("summary", `What this log cannot tell: ${one.cannot_tell.length}`), make("ul", "", {}, ...one.cannot_tell.map((row) => make("li", `${row.what}: ${row.why} ${row.remedy ? `To see it: ${row.remedy}.` : ""}`)))));
    }
  },
  tune(body, told, k) {
    for (const [axis, one] of Object.entries(told.axes ?? {})) {
      const gains = Object.entries(one.gains ?? {});
      body.append(tableOf(`${axis}: gains`, ["parameter", "flown", "proposed"], gains.map(([name, gain]) => [name, number(gain.flown), number(gain.proposed)])));
      const rows = Object.keys(one.flown ?? {}).filter((name) => one.proposed?.[name]);
      const shown = (name, value) => (/_rad_s$/.test(name) ? rateInterval(value) : within(value));
      const label = (name) => plain(inHz() ? name.replace(/_rad_s$/, " in Hz") : name.replace(/_rad_s$/, " in rad/s"));
      body.append(tableOf(`${axis}: rate loop, for every likely vehicle`, ["", "flown", "proposed"], rows.map((name) => [label(name), shown(name, one.flown[name]), shown(name, one.proposed[name])])));
      for (const sentence of [...(one.reasons ?? []), ...(one.notes ?? [])]) body.append(make("p", typeof sentence === "string" ? sentence : sentence.message ?? "", { class: "soft" }));
    }
    body.append(make("p", "", {}, make("a", "Move every gain by hand, with the margins beside it", { href: `/api/steps/${k}/report`, target: "_blank", rel: "noopener" })));
  },
  export(body, told, k) {
    body.append(tableOf("Quantities", ["quantity", "identified", "exported", "unit"], told.quantities.map((one) => [one.name, number(one.identified), number(one.exported), one.unit])));
    body.append(exportRow.call(this, k, told));
  },
};

function scores(body, maneuvers) {
  const rows = maneuvers.flatMap((one) => Object.entries(one.scores).map(([output, score]) => [`${one.axis} ${one.kind} at ${one.start_s.toFixed(1)} s of ${one.record}`, output, number(score.tic, 3), `${number(score.nrmse_fit_percent, 3)} %`, one.verdict]));
  if (rows.length) body.append(tableOf("On unseen maneuvers", ["maneuver", "output", "Theil's coefficient", "fit", "verdict"], rows));
}

function slider(label, { min, max, step, value, text }) {
  const range = make("input", "", { type: "range", min, max, step, "aria-label": label }), read = make("output", text(value));
  range.value = value;
  range.addEventListener("input", () => { read.textContent = text(range.value); });
  return [range, make("label", `${label} `, {}, range, " ", read)];
}

function tuneRow(k) {
  const [soft, first] = slider("Largest peak M_s", { min: 1.2, max: 2.4, step: 0.05, value: 1.7, text: (value) => `${Number(value).toFixed(2)} ${value < 1.5 ? "soft" : value > 1.9 ? "sharp" : ""}` });
  const [noise, second] = slider("Noise at the motors", { min: 0.5, max: 4, step: 0.1, value: 2, text: (value) => `${Number(value).toFixed(1)} times that of today` });
  const keep = ["P", "I", "D", "A"].map((name) => [name, make("input", "", { type: "checkbox" })]);
  const run = () => this.hooks.start({
    verb: "tune", results: [k], logs: [this.hooks.log()], robustness: Number(soft.value), noise: Number(noise.value),
    keep: keep.filter(([, box]) => box.checked).map(([name]) => name),
  });
  return make("div", "", { class: "use row" }, make("b", "Gains"), first, second, make("span", "", {}, "keep ", ...keep.map(([name, box]) => make("label", "", {}, box, ` ${name === "A" ? "angle" : name} `))), make("button", "Tune", { onclick: run }),
    make("button", "Verify on the log shown", { onclick: () => this.hooks.start({ verb: "verify", results: [k], logs: [this.hooks.log()] }) }));
}

/** Where to, and what the result does not hold: quantities that the last export named can be set. */
function exportRow(k, last) {
  const target = make("select", "", { "aria-label": "target of the export" }, ...TARGETS.map((name) => make("option", name)));
  const values = make("input", "", { placeholder: "m=1.4, I_xx=0.02", "aria-label": "values to set, NAME=VALUE with commas" });
  const results = last ? null : [k];
  if (last) target.value = last.target ?? last.to ?? target.value;
  const run = tried(async () => {
    const given = Object.fromEntries(values.value.split(",").map((one) => one.split("=").map((part) => part.trim())).filter((pair) => pair[0]).map(([name, value]) => {
      if (value === undefined || !Number.isFinite(Number(value))) throw new Error(`${name}: NAME=NUMBER is needed, such as m=1.4`);
      return [name, Number(value)];
    }));
    const from = results ?? (await ask("/api/state")).steps[k - 1].step.results;
    await this.hooks.start({ verb: "export", results: from, logs: [], to: target.value, values: given });
  });
  return make("div", "", { class: "use row" }, make("b", last ? "Again" : "Files for"), target, make("label", "set ", {}, values), make("button", "Export", { onclick: run }));
}

