// Pictures of responses and spectra. They draw what they are given and compute nothing.
import { make, number, raised } from "./page.js";

const LINES = ["#1f77b4", "#d9480f", "#2b8a3e", "#9c36b5", "#c2255c", "#0b7285"];
const DARK_LINES = ["#6bb3ea", "#ff9a66", "#69c48a", "#cf9bea", "#f78fb3", "#66c7d6"];
export const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
export const isDark = () =>
  (document.documentElement.dataset.theme ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
export const colors = () => (isDark() ? DARK_LINES : LINES);

export function phaseOf(re, im) {
  let before = null, turn = 0;
  return re.map((x, k) => {
    if (x === null || im[k] === null) return null;
    let angle = (Math.atan2(im[k], x) * 180) / Math.PI + turn;
    while (before !== null && angle - before > 180) { angle -= 360; turn -= 360; }
    while (before !== null && angle - before < -180) { angle += 360; turn += 360; }
    before = angle;
    return angle;
  });
}

export const axisOf = (label, size = 52) => ({
  label: label || undefined, labelSize: 16, size, font: "11px system-ui", labelFont: "11px system-ui",
  stroke: () => style("--quiet"), grid: { stroke: () => style("--line"), width: 0.6 }, ticks: { stroke: () => style("--line") },
});

export const widthOf = (box) => {
  const { paddingLeft, paddingRight } = getComputedStyle(box);
  return Math.max(Math.floor((box.clientWidth || 320) - parseFloat(paddingLeft) - parseFloat(paddingRight)), 200);
};

/** Ticks of a logarithmic axis: powers of ten as such, nothing between. */
const powers = (value) => (value > 0 && Number.isInteger(Math.round(Math.log10(value) * 1e6) / 1e6) ? `10${raised(Math.round(Math.log10(value)))}` : "");

/** A number beside a curve. */
const read = (_, value) => (value === null || value === undefined ? "–" : number(value));

/** Curves over a logarithmic axis; a drag calls `brush` with its two ends. `within`: the lower and upper edge of a strip around the first curve. A `faded` curve is gray and dashed, a `dashed` one dashed; `color` is the number of its color. */
export function lines(box, { title, x, rows, within = [], xLabel, yLabel, logY = false, brush = null, sync = null, height = 190 }) {
  const place = make("div");
  box.append(place);
  const palette = colors(), edges = within.map((y) => ({ y, stroke: "transparent" }));
  const all = [...rows, ...edges];
  const plot = new uPlot({
    title, width: widthOf(place), height, legend: { show: true, live: true },
    cursor: { drag: { x: Boolean(brush), y: false, setScale: false }, sync: sync ? { key: sync } : undefined },
    scales: { x: { time: false, distr: 3 }, y: { distr: logY ? 3 : 1 } },
    axes: [axisOf(xLabel, 34), { ...axisOf(yLabel), ...(logY ? { values: (_, ticks) => ticks.map(powers) } : {}) }],
    bands: within.length ? [{ series: [rows.length + 2, rows.length + 1], fill: `${palette[0]}40` }] : [],
    series: [{ label: xLabel, value: read }, ...all.map((row, k) => ({
      label: row.label, stroke: row.stroke ?? (row.faded ? style("--quiet") : palette[(row.color ?? k) % palette.length]), width: row.stroke ? 0 : row.faded ? 1 : 1.6, dash: row.faded || row.dashed ? [4, 4] : undefined, points: { show: false }, value: read,
    }))],
    hooks: { setSelect: [(u) => {
      if (!brush || u.select.width <= 3) return;
      brush(u.posToVal(u.select.left, "x"), u.posToVal(u.select.left + u.select.width, "x"));
      u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    }] },
  }, [x, ...all.map((row) => row.y)], place);
  // The strip belongs to the curve that it surrounds: its edges need no words of their own.
  [...plot.root.querySelectorAll(".u-series")].slice(1 + rows.length).forEach((row) => { row.hidden = true; });
  plot.root.setAttribute("role", "group");
  plot.root.setAttribute("aria-label", title);
  fitted(plot, place);
  return plot;
}

const PLOTS = new WeakMap();

/** Keep a picture as wide as its place, until it goes away. */
export function fitted(plot, place) {
  PLOTS.set(plot.root, plot);
  const watcher = new ResizeObserver(() => {
    const width = widthOf(place);
    if (place.isConnected && place.clientWidth && Math.abs(width - plot.width) > 1) plot.setSize({ width, height: plot.height });
  });
  watcher.observe(place);
  (plot.hooks.destroy ??= []).push(() => watcher.disconnect());
}

/** Pictures in a place go away, and let go of what they hold. */
export function released(box) { for (const root of box.querySelectorAll(".uplot")) PLOTS.get(root)?.destroy(); }

/** Dark to bright for 0 to 1. */
const shade = (s) => [255 * Math.min(1, 1.6 * s), 255 * s * s, 255 * (0.35 + 0.4 * s - 0.6 * s * s)];

/** A spectrogram with its axes, a scale of its colors, and what stands under the pointer. `frequency` is in the unit `unit`. */
export function gram(box, { title, time_s, frequency, unit, density_db: rows, densityUnit }) {
  const columns = time_s.length, flat = rows.flat().filter((value) => value !== null).sort((a, b) => a - b), low = flat[Math.floor(flat.length * 0.05)], high = flat.at(-1);
  const canvas = new OffscreenCanvas(columns, rows.length), context = canvas.getContext("2d"), image = context.createImageData(columns, rows.length);
  rows.forEach((row, k) => row.forEach((value, n) => {
    // Where the log has a gap there is nothing to see.
    if (value !== null) image.data.set([...shade(Math.max(0, Math.min(1, (value - low) / (high - low || 1)))), 255], 4 * ((rows.length - 1 - k) * columns + n));
  }));
  context.putImageData(image, 0, 0);
  const place = make("div"), under = make("span", "", { class: "value soft" }), scale = make("canvas", "", { class: "scale", width: 120, height: 1, role: "img", "aria-label": "colors, dark to bright" });
  const colored = scale.getContext("2d"), strip = colored.createImageData(120, 1);
  for (let k = 0; k < 120; k += 1) strip.data.set([...shade(k / 119), 255], 4 * k);
  colored.putImageData(strip, 0, 0);
  box.append(place, make("div", "", { class: "row soft" }, `${Math.round(low)}`, scale, `${Math.round(high)} dB of ${densityUnit}`, under));
  // A column and a row stand for what is half a step around their middle.
  const ends = (values) => { const half = values.length > 1 ? (values[1] - values[0]) / 2 : 0.5; return [values[0] - half, values.at(-1) + half]; };
  const [x, y] = [ends(time_s), ends(frequency)];
  const nearest = (values, [first, last], at) => Math.min(Math.max(Math.floor(((at - first) / (last - first)) * values.length), 0), values.length - 1);
  const plot = new uPlot({
    title, width: widthOf(place), height: 240, legend: { show: false },
    cursor: { drag: { x: false, y: false, setScale: false }, points: { show: false } },
    scales: { x: { time: false, auto: false, range: () => x }, y: { auto: false, range: () => y } },
    axes: [axisOf("s", 34), axisOf(unit)],
    series: [{}, { stroke: "transparent", points: { show: false } }],
    hooks: {
      drawClear: [(u) => { u.ctx.imageSmoothingEnabled = false; u.ctx.drawImage(canvas, u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height); }],
      setCursor: [(u) => {
        const { left, top } = u.cursor, inside = left >= 0 && top >= 0;
        const n = inside ? nearest(time_s, x, u.posToVal(left, "x")) : 0, k = inside ? nearest(frequency, y, u.posToVal(top, "y")) : 0;
        under.textContent = inside ? `${time_s[n].toFixed(2)} s, ${number(frequency[k], 3)} ${unit}: ${rows[k][n] === null ? "a gap" : `${number(rows[k][n], 3)} dB`}` : "";
      }],
    },
  }, [x, [null, null]], place);
  plot.root.setAttribute("role", "img");
  plot.root.setAttribute("aria-label", title);
  fitted(plot, place);
}
