// Spectra and spectrograms of an interval: computed by the server once, drawn again in other units and colors.
import { ask, make, displayUnit, shownOmega, times, tried, unitOf, unitText } from "./page.js";
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
    const answer = await ask(`/api/logs/${log}/${kind}?channel=${channel}&start=${start}&stop=${stop}`), display = displayUnit(unit);
    const found = inUnit(answer, display.factor ** 2);
    if (!(found.density ?? found.density_db).length) throw new Error("Too few samples in this interval.");
    // What the server really took may be less than what was asked for.
    const title = `${kind} of ${name}, ${(found.start_s ?? start).toFixed(1)} to ${(found.stop_s ?? stop).toFixed(1)} s`;
    const picture = make("div"), spectral = { kind, title, found, picture, density: `${unit === "1" ? "1" : `(${unitOf(display.unit)})²`}/Hz` };
    const box = make("div", "", { class: "spectral" }, make("button", "×", { class: "plain", "aria-label": `remove the ${kind}`, onclick: () => {
      this.shown = this.shown.filter((other) => other !== spectral);
      released(picture);
      box.remove();
    } }), picture);
    this.box.prepend(box);
    this.shown.push(spectral);
    this.#draw(spectral);
  });

  redraw() { this.shown.forEach((spectral) => this.#draw(spectral)); }

  #draw({ kind, title, found, picture, density }) {
    released(picture);
    picture.replaceChildren();
    const frequency = found.frequency_rad_s.map(shownOmega);
    if (kind === "spectrum") lines(picture, { title, x: frequency, rows: [{ label: "density", y: found.density.map((value) => (value > 0 ? value : null)) }], xLabel: unitText(), yLabel: density, logY: true });
    else gram(picture, { ...found, title, frequency, unit: unitText(), densityUnit: density });
  }
}
