// Tracks: channels over time on one axis. They zoom at once with what is drawn, and are redrawn from the pyramid of
// the server; brushed segments lie over them, with edges that mouse, finger and keyboard move.
import { $, ask, make, number, displayUnit, times, unitOf, watched } from "./page.js";
import { axisOf, colors, fitted, style, widthOf } from "./plots.js";

const HEIGHT = 132;
/** A drag of an edge by less than this, in pixels, is a click. */
const STILL = 3;
const round = (value, digits = 3) => Number(value.toFixed(digits));
const between = (value, low, high) => Math.min(Math.max(value, low), high);

export class Tracks {
  /** `hooks`: `bands()`, `marks()`, `segments()`, `brushed(start, stop)`, `edged(k, side, at, last)`, `unedged()`, `viewed()`. */
  constructor(box, hooks) {
    this.box = box;
    this.hooks = hooks;
    this.log = 0;
    this.channels = [];
    this.span = [0, 1];
    this.view = [0, 1];
    this.shown = [];
    this.asked = 0;
  }

  /** Show another log: what is drawn goes away. */
  open(log, channels, span) {
    this.shown.forEach(({ plot }) => plot.destroy());
    this.box.replaceChildren();
    Object.assign(this, { log, channels, span, view: [...span], shown: [] });
  }

  async add(channel) {
    if (this.shown.some((track) => track.channel === channel)) return;
    const row = this.channels[channel], [start, stop] = this.view, log = this.log;
    const samples = await ask(this.#path(channel, start, stop, 1200)), { unit, factor } = displayUnit(row.unit);
    if (log !== this.log) return;
    const value = make("span", "", { class: "value soft" }), picture = make("div", "", { class: "picture" });
    const track = make("div", "", { class: "track" }, make("div", "", { class: "head" }, make("b", row.name),
      make("span", [unitOf(unit), row.topic].filter(Boolean).join(" · "), { class: "soft" }), value,
      make("button", "×", { class: "plain", title: "Remove the track", "aria-label": `remove ${row.name}`, onclick: () => this.remove(channel) })), picture);
    this.box.append(track);
    const plot = new uPlot({
      width: widthOf(picture), height: HEIGHT, legend: { show: false },
      cursor: { drag: { x: false, y: false, setScale: false }, sync: { key: "tracks" }, points: { size: 6 } },
      scales: { x: { time: false, auto: false, range: () => this.view }, y: { range: (_, low, high) => withRoom(low, high) } },
      axes: [axisOf("", 26), { ...axisOf(""), space: 20 }],
      series: [{}, { stroke: () => colors()[0], width: 1, points: { show: false } }],
      hooks: {
        drawClear: [(u) => this.#bands(u)],
        draw: [(u) => { this.#marks(u); this.#segments(u); }],
        setCursor: [(u) => { value.textContent = u.cursor.idx === null || u.cursor.idx === undefined ? "" : `${u.data[0][u.cursor.idx].toFixed(3)} s: ${number(u.data[1][u.cursor.idx], 5)}`; }],
      },
    }, [samples.x, times(samples.y, factor)], picture);
    plot.over.tabIndex = 0;
    plot.over.setAttribute("role", "group");
    plot.over.setAttribute("aria-label", `${row.name} over time; plus, minus, arrows and 0 zoom and move`);
    this.#gestures(plot);
    fitted(plot, picture);
    this.shown.push({ channel, plot, track, factor });
  }

  remove(channel) {
    const removed = this.shown.find((other) => other.channel === channel);
    if (!removed) return;
    this.shown = this.shown.filter((other) => other !== removed);
    removed.plot.destroy();
    removed.track.remove();
  }

  redraw() { this.shown.forEach(({ plot }) => plot.redraw(false)); }

  /** Look at an interval: at once with the points at hand, then with those of the pyramid. */
  look(start, stop) {
    const [first, last] = this.span, least = 0.02;
    const wide = between(stop - start, least, last - first);
    const from = between(start, first, last - wide);
    this.view = [from, from + wide];
    this.shown.forEach(({ plot }) => plot.setScale("x", { min: this.view[0], max: this.view[1] }));
    this.hooks.viewed();
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.#fetch(), 50);
  }

  whole() { this.look(...this.span); }

  #path(channel, start, stop, points) {
    return `/api/logs/${this.log}/track?channel=${channel}&start=${start}&stop=${stop}&points=${points}`;
  }

  #fetch = watched(async () => {
    const asked = (this.asked += 1), [start, stop] = this.view, log = this.log;
    await Promise.all(this.shown.map(async ({ channel, plot, factor }) => {
      const samples = await ask(this.#path(channel, start, stop, plot.width));
      if (asked === this.asked && log === this.log) plot.setData([samples.x, times(samples.y, factor)]);
    }));
  });

  /** Flights as a strip at the bottom, excitations as one at the top with their axis and a tint below it. */
  #bands(u) {
    const { ctx, bbox } = u, px = devicePixelRatio;
    ctx.save();
    ctx.font = `${10 * px}px system-ui`;
    ctx.textAlign = "left";
    ctx.textBaseline = "middle";
    for (const { start, stop, color, label } of this.hooks.bands()) {
      const a = Math.max(u.valToPos(start, "x", true), bbox.left), b = Math.min(u.valToPos(stop, "x", true), bbox.left + bbox.width);
      if (b <= a) continue;
      ctx.fillStyle = style(color);
      if (!label) { ctx.fillRect(a, bbox.top + bbox.height - 4 * px, b - a, 4 * px); continue; }
      ctx.fillRect(a, bbox.top, b - a, 13 * px);
      ctx.globalAlpha = 0.16;
      ctx.fillRect(a, bbox.top + 13 * px, b - a, bbox.height - 13 * px);
      ctx.globalAlpha = 1;
      if (ctx.measureText(label).width > b - a - 6 * px) continue;
      ctx.fillStyle = style("--on-excitation");
      ctx.fillText(label, a + 4 * px, bbox.top + 7 * px);
    }
    ctx.restore();
  }

  #marks(u) {
    u.ctx.fillStyle = style("--finding");
    for (const at of this.hooks.marks()) {
      const x = u.valToPos(at, "x", true);
      if (x < u.bbox.left || x > u.bbox.left + u.bbox.width) continue;
      u.ctx.beginPath();
      u.ctx.moveTo(x - 5 * devicePixelRatio, u.bbox.top);
      u.ctx.lineTo(x + 5 * devicePixelRatio, u.bbox.top);
      u.ctx.lineTo(x, u.bbox.top + 9 * devicePixelRatio);
      u.ctx.fill();
    }
  }

  #segments(u) {
    const wide = u.over.clientWidth, list = this.hooks.segments();
    const old = [...u.over.querySelectorAll(".brushed")];
    list.forEach((segment, k) => {
      const box = old[k] ?? this.#segmentBox(u, k);
      const a = between(u.valToPos(segment.start_s, "x"), -10, wide + 10), b = between(u.valToPos(segment.stop_s, "x"), -10, wide + 10);
      box.style.left = `${a}px`;
      box.style.width = `${Math.max(b - a, 1)}px`;
      box.firstChild.textContent = segment.axis;
      u.over.querySelectorAll(`.edge[data-segment="${k}"]`).forEach((edge) => {
        const at = segment[edge.dataset.side];
        edge.style.left = `${u.valToPos(at, "x")}px`;
        edge.hidden = at < this.view[0] || at > this.view[1];
        edge.setAttribute("aria-valuenow", at);
        edge.setAttribute("aria-valuetext", `${at.toFixed(2)} seconds`);
      });
    });
    old.slice(list.length).forEach((box) => box.remove());
    u.over.querySelectorAll(".edge").forEach((edge) => { if (Number(edge.dataset.segment) >= list.length) edge.remove(); });
  }

  #segmentBox(u, k) {
    const box = make("div", "", { class: "brushed" }, make("span"));
    u.over.append(box);
    for (const side of ["start_s", "stop_s"]) {
      const edge = make("div", "", {
        class: "edge", tabindex: "0", role: "slider", "data-segment": k, "data-side": side,
        "aria-label": `${side === "start_s" ? "start" : "stop"} of segment ${k + 1}`, "aria-valuemin": this.span[0], "aria-valuemax": this.span[1],
      });
      const moveTo = (at, last) => {
        const segment = this.hooks.segments()[k], other = side === "start_s" ? segment.stop_s : segment.start_s;
        const kept = round(side === "start_s" ? between(at, this.span[0], other - 0.05) : between(at, other + 0.05, this.span[1]));
        this.hooks.edged(k, side, kept, last);
      };
      edge.addEventListener("pointerdown", (event) => {
        if (event.button !== 0) return;
        event.stopPropagation();
        edge.setPointerCapture(event.pointerId);
        // The edge keeps its distance from the pointer, wherever in it the drag began.
        const left = u.over.getBoundingClientRect().left, hold = event.clientX - left - u.valToPos(this.hooks.segments()[k][side], "x");
        const drag = new AbortController(), { signal } = drag;
        let moving = false;
        const to = (other, last) => {
          moving ||= Math.abs(other.clientX - event.clientX) >= STILL;
          if (moving) moveTo(u.posToVal(other.clientX - left - hold, "x"), last);
        };
        edge.addEventListener("pointermove", (other) => to(other, false), { signal });
        edge.addEventListener("pointerup", (other) => { drag.abort(); to(other, true); }, { signal });
        for (const lost of ["pointercancel", "lostpointercapture"]) edge.addEventListener(lost, () => { drag.abort(); if (moving) this.hooks.unedged(); }, { signal });
      });
      edge.addEventListener("keydown", (event) => {
        const by = { ArrowLeft: -0.1, ArrowRight: 0.1 }[event.key];
        if (!by) return;
        event.preventDefault();
        event.stopPropagation();
        moveTo(this.hooks.segments()[k][side] + by * (event.shiftKey ? 10 : 1), true);
      });
      u.over.append(edge);
    }
    return box;
  }

  #gestures(plot) {
    const over = plot.over;
    over.addEventListener("wheel", (event) => {
      event.preventDefault();
      const [min, max] = this.view, wide = max - min;
      const sideways = event.shiftKey ? event.deltaY || event.deltaX : Math.abs(event.deltaX) > Math.abs(event.deltaY) ? event.deltaX : 0;
      if (sideways) { this.look(min + (Math.sign(sideways) * wide) / 12, max + (Math.sign(sideways) * wide) / 12); return; }
      const at = plot.posToVal(event.offsetX, "x"), by = event.deltaY > 0 ? 1.25 : 0.8;
      this.look(at - (at - min) * by, at + (max - at) * by);
    }, { passive: false });
    over.addEventListener("dblclick", () => this.whole());
    over.addEventListener("keydown", (event) => {
      const [min, max] = this.view, wide = max - min;
      const act = {
        "+": () => this.look(min + wide / 8, max - wide / 8), "=": () => this.look(min + wide / 8, max - wide / 8),
        "-": () => this.look(min - wide / 6, max + wide / 6), 0: () => this.whole(),
        ArrowLeft: () => this.look(min - wide / 10, max - wide / 10), ArrowRight: () => this.look(min + wide / 10, max + wide / 10),
      }[event.key];
      if (act && !event.ctrlKey && !event.metaKey) { event.preventDefault(); act(); }
    });
    over.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      const { left, width } = over.getBoundingClientRect(), from = event.clientX - left, [min, max] = this.view;
      const mode = event.shiftKey ? "zoom" : $("mode").value;
      const selection = make("div", "", { class: "selection" });
      if (mode !== "move") over.append(selection);
      over.setPointerCapture(event.pointerId);
      const moved = (other) => {
        const to = between(other.clientX - left, 0, width);
        if (mode === "move") { const by = ((from - to) / width) * (max - min); this.look(min + by, max + by); return; }
        selection.style.left = `${Math.min(from, to)}px`;
        selection.style.width = `${Math.abs(to - from)}px`;
      };
      const ended = (other) => {
        over.removeEventListener("pointermove", moved);
        selection.remove();
        const to = between(other.clientX - left, 0, width);
        if (mode === "move" || other.type === "pointercancel" || Math.abs(to - from) < 4) return;
        const [start, stop] = [Math.min(from, to), Math.max(from, to)].map((at) => plot.posToVal(at, "x"));
        if (mode === "zoom") this.look(start, stop); else this.hooks.brushed(...[start, stop].map((at) => round(at, max - min > 20 ? 2 : 3)));
      };
      over.addEventListener("pointermove", moved);
      over.addEventListener("pointerup", ended, { once: true });
      over.addEventListener("pointercancel", ended, { once: true });
    });
  }
}

function withRoom(low, high) {
  if (low === null || high === null || low === undefined) return [-1, 1];
  const pad = high > low ? 0.06 * (high - low) : Math.max(Math.abs(low) * 0.1, 0.1);
  return [low - pad, high + pad];
}

/** The first tracks of a log: the axis that was excited most, its command and its rate. */
export function firstTracks(channels, inspection) {
  const axis = inspection?.excitations?.[0]?.axis ?? "roll";
  const rate = { roll: "p", pitch: "q", yaw: "r", thrust: "az" }[axis] ?? "p";
  const wanted = [`${axis}_command`, rate, { roll: "phi", pitch: "theta" }[axis]].filter(Boolean);
  const found = wanted.map((name) => channels.findIndex((channel) => channel.name === name)).filter((k) => k >= 0);
  return found.length ? found : channels.length ? [0] : [];
}
