// Spectra and spectrograms of an interval: asked of the server once, drawn again in other units and colors.
import { ask, make, seenAs, shownOmega, times, tried, unitOf, unitText } from "./page.js";
import { gram, lines, released } from "./plots.js";

/** Densities times a factor, as they are or in decibels. */
const inUnit = (found, factor) => (found.density
  ? { ...found, density: times(found.density, factor) }
  : { ...found, density_db: found.density_db.map((row) => row.map((level) => (level === null ? null : level + 10 * Math.log10(factor)))) });

export class Spectra {
  /** `box` holds them, the newest first. */
  constructor(box) {
    this.box = box;
    this.shown = [];
  }

  /** All go away, as another log is shown. */
  clear() {
    released(this.box);
    this.box.replaceChildren();
    this.shown = [];
  }

  add = tried(async (kind, log, { channel, name, unit }, [start, stop]) => {
    const told = await ask(`/api/logs/${log}/${kind}?channel=${channel}&start=${start}&stop=${stop}`), seen = seenAs(unit);
    const found = inUnit(told, seen.factor ** 2);
    if (!(found.density ?? found.density_db).length) throw new Error("The interval holds too few samples for that.");
    // What the server really took may be less than what was asked for.
    const title = `${kind} of ${name}, ${(found.start_s ?? start).toFixed(1)} to ${(found.stop_s ?? stop).toFixed(1)} s`;
    const picture = make("div"), one = { kind, title, found, picture, density: `${unit === "1" ? "1" : `(${unitOf(seen.unit)})²`}/Hz` };
    const box = make("div", "", { class: "spectral" }, make("button", "×", { class: "plain", "aria-label": `remove the ${kind}`, onclick: () => {
      this.shown = this.shown.filter((other) => other !== one);
      released(picture);
      box.remove();
    } }), picture);
    this.box.prepend(box);
    this.shown.push(one);
    this.#draw(one);
  });

  redraw() { this.shown.forEach((one) => this.#draw(one)); }

  #draw({ kind, title, found, picture, density }) {
    released(picture);
    picture.replaceChildren();
    const frequency = found.frequency_rad_s.map(shownOmega);
    if (kind === "spectrum") lines(picture, { title, x: frequency, rows: [{ label: "density", y: found.density.map((value) => (value > 0 ? value : null)) }], xLabel: unitText(), yLabel: density, logY: true });
    else gram(picture, { ...found, title, frequency, unit: unitText(), densityUnit: density });
  }
}
