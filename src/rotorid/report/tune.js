"use strict";
// Gains by hand: sliders recompute margins, step and noise from the loops in this page, without a server.
(() => {
  const source = document.getElementById("loops");
  if (!source) return;
  const axes = JSON.parse(source.textContent);
  const NAMES = ["P", "I", "D", "A"];
  const STEP_RAD_S = 0.5;
  const HIGHEST_RAD_S = 300;
  const SHOWN_S = 1.5;
  const TIMES = Array.from({ length: 121 }, (_, k) => (SHOWN_S * k) / 120);

  // A row of complex numbers is { re, im }.
  const row = ([re, im]) => ({ re, im });
  const weighted = (pairs) => {
    const size = pairs[0][1].re.length;
    const re = new Float64Array(size);
    const im = new Float64Array(size);
    for (const [weight, one] of pairs) {
      for (let k = 0; k < size; k += 1) {
        re[k] += weight * one.re[k];
        im[k] += weight * one.im[k];
      }
    }
    return { re, im };
  };
  const times = (a, b) => ({
    re: a.re.map((value, k) => value * b.re[k] - a.im[k] * b.im[k]),
    im: Float64Array.from(a.re, (value, k) => value * b.im[k] + a.im[k] * b.re[k]),
  });
  const plain = (one) => ({ re: Float64Array.from(one.re), im: Float64Array.from(one.im) });

  // A first-order filter of a program that runs every step; none where the cutoff is zero.
  const lowPass = (omega, cutoff, step) => {
    if (!(cutoff > 0)) return { re: omega.map(() => 1), im: omega.map(() => 0) };
    const share = step > 0 ? step / (step + 1 / (2 * Math.PI * cutoff)) : 0;
    const re = [];
    const im = [];
    for (const w of omega) {
      const [x, y] = step > 0
        ? [1 - (1 - share) * Math.cos(w * step), (1 - share) * Math.sin(w * step)]
        : [1, w / (2 * Math.PI * cutoff)];
      const over = (step > 0 ? share : 1) / (x * x + y * y);
      re.push(over * x);
      im.push(-over * y);
    }
    return { re, im };
  };
  const quotient = (a, b) => {
    const size = b.re.map((value, k) => value * value + b.im[k] * b.im[k]);
    return {
      re: a.re.map((value, k) => (value * b.re[k] + a.im[k] * b.im[k]) / size[k]),
      im: a.re.map((value, k) => (a.im[k] * b.re[k] - value * b.im[k]) / size[k]),
    };
  };

  // Another low-pass of D over that of the page.
  const otherLowPass = (axis, omega, cutoff) => (axis.derivative_cutoff_hz > 0
    ? quotient(lowPass(omega, cutoff, axis.derivative_step_s),
               lowPass(omega, axis.derivative_cutoff_hz, axis.derivative_step_s))
    : null);
  const controllers = (axis, gains, cutoff) => {
    const filter = otherLowPass(axis, axis.omega, cutoff);
    const slope = (one) => (filter ? times(plain(one), plain(filter)) : one);
    const rate = weighted([[gains.P, axis.rate.P], [gains.I, axis.rate.I], [gains.D, slope(axis.rate.D)]]);
    const angle = weighted([
      [gains.A * gains.P, axis.angle.P], [gains.A * gains.I, axis.angle.I],
      [gains.A * gains.D, slope(axis.angle.D)], [gains.A, axis.angle.ahead],
    ]);
    return { rate, angle, whole: weighted([[1, rate], [1, angle]]) };
  };

  const crossings = (at, values, level) => {
    const found = [];
    for (let k = 0; k + 1 < values.length; k += 1) {
      const before = values[k] - level;
      const after = values[k + 1] - level;
      if (before * after < 0) found.push(at[k] + (before / (before - after)) * (at[k + 1] - at[k]));
    }
    return found;
  };
  const between = (at, values, place) => {
    let k = 0;
    while (k + 2 < at.length && at[k + 1] < place) k += 1;
    return values[k] + ((place - at[k]) / (at[k + 1] - at[k])) * (values[k + 1] - values[k]);
  };
  // Whether 1 + L does not wind around zero, by its crossings of the negative real axis beyond -1.
  const stable = (gain, phase) => {
    const below = phase.map((value) => Math.floor((value + Math.PI) / TURN));
    let rises = 0;
    for (let k = 0; k + 1 < below.length; k += 1) {
      if (below[k] === below[k + 1]) continue;
      const level = TURN * Math.max(below[k], below[k + 1]) - Math.PI;
      const share = (level - phase[k]) / (phase[k + 1] - phase[k]);
      if (gain[k] + share * (gain[k + 1] - gain[k]) > 0) rises += below[k + 1] - below[k];
    }
    return rises === (gain[0] > 0 ? -below[0] : 0);
  };
  const MOST_LEAD = Math.PI / 6;
  const TURN = 2 * Math.PI;
  // Phases lie in (-330, 30] degrees where the plant begins to be known; the highest phase says nothing of the branch.
  const figures = ({ omega, from_rad_s: from }, loop) => {
    const ln = omega.map(Math.log);
    const gain = Array.from(loop.re, (value, k) => 0.5 * Math.log(value ** 2 + loop.im[k] ** 2));
    const phase = Array.from(loop.re, (value, k) => Math.atan2(loop.im[k], value));
    for (let k = 1; k < phase.length; k += 1) {
      phase[k] -= 2 * Math.PI * Math.round((phase[k] - phase[k - 1]) / (2 * Math.PI));
    }
    const found = omega.findIndex((value) => value >= from);
    const start = Math.min(found < 0 ? omega.length : found, omega.length - 2);
    const shift = TURN * Math.ceil((phase[start] - MOST_LEAD) / TURN);
    const turned = phase.map((value) => value - shift);
    const over = crossings(ln, gain, 0);
    const margins = over.map((place) => Math.PI + between(ln, turned, place));
    const half = crossings(ln, turned, -Math.PI).map((place) => between(ln, gain, place)).filter((one) => one < 0);
    const peak = Math.max(...Array.from(loop.re, (value, k) => 1 / Math.hypot(1 + value, loop.im[k])));
    return {
      crossover: over.length ? Math.exp(over[over.length - 1]) : NaN,
      phase: margins.length ? (Math.min(...margins) * 180) / Math.PI : NaN,
      stable: stable(gain.slice(start), turned.slice(start)),
      gain: half.length ? (-20 / Math.LN10) * Math.max(...half) : Infinity,
      peak,
    };
  };
  const noise = (axis, rate) => {
    let sum = 0;
    for (let k = 0; k + 1 < axis.omega.length; k += 1) {
      const [low, high] = [k, k + 1].map((at) => axis.noise[at] * (rate.re[at] ** 2 + rate.im[at] ** 2));
      sum += 0.5 * (low + high) * (axis.omega[k + 1] - axis.omega[k]);
    }
    return Math.sqrt(sum);
  };

  // Of the whole spectrum of the gyro where the log shows it.
  const loudness = (axis, gains, cutoff, found) => {
    if (!axis.gyro) return noise(axis, found.rate);
    const { omega, of_p: ofP, of_both: [re, im], of_d: ofD } = axis.gyro;
    const filter = otherLowPass(axis, omega, cutoff) ?? { re: omega.map(() => 1), im: omega.map(() => 0) };
    return Math.sqrt(omega.reduce((sum, _, k) => sum + gains.P ** 2 * ofP[k]
      + 2 * gains.P * gains.D * (re[k] * filter.re[k] - im[k] * filter.im[k])
      + gains.D ** 2 * ofD[k] * (filter.re[k] ** 2 + filter.im[k] ** 2), 0));
  };

  // Attitude under a moment of a corner, as rotorid.tuning.loops.attitude_rms.
  const DISTURBANCE_RAD_S = 1.5;
  const attitude = (axis, whole) => {
    const loop = times(plain(axis.plant), whole);
    const power = axis.omega.map((w, k) => (axis.plant.re[k] ** 2 + axis.plant.im[k] ** 2)
      / (w * w * ((1 + loop.re[k]) ** 2 + loop.im[k] ** 2) * (w * w + DISTURBANCE_RAD_S ** 2)));
    let sum = 0;
    for (let k = 0; k + 1 < power.length; k += 1) sum += 0.5 * (power[k] + power[k + 1]) * (axis.omega[k + 1] - axis.omega[k]);
    return Math.sqrt(sum);
  };
  const comparedWithToday = (ratio) => {
    if (ratio <= 1 / 1.5) return `${format(1 / ratio, 2)} times less than`;
    if (ratio >= 1.5) return `${format(ratio, 2)} times more than`;
    const change = Math.round(100 * (ratio - 1));
    return change === 0 ? "as much as" : `${Math.abs(change)} % ${change < 0 ? "less" : "more"} than`;
  };

  // Attitude over its set-point, its real part at even steps, and from that the answer to a step.
  const step = (axis, plant, found) => {
    const closed = quotient(times(plain(plant), found.angle),
                            weighted([[1, { re: plant.re.map(() => 1), im: plant.im.map(() => 0) }],
                                      [1, times(plain(plant), found.whole)]]));
    const real = [];
    let k = 0;
    for (let w = 0; w <= HIGHEST_RAD_S; w += STEP_RAD_S) {
      while (k + 2 < axis.omega.length && axis.omega[k + 1] < w) k += 1;
      const share = Math.min(Math.max((w - axis.omega[k]) / (axis.omega[k + 1] - axis.omega[k]), 0), 1);
      real.push(closed.re[k] + share * (closed.re[k + 1] - closed.re[k]));
    }
    return TIMES.map((t) => {
      let sum = 0.5 * real[0] * t;
      for (let n = 1; n < real.length; n += 1) sum += (real[n] * Math.sin(n * STEP_RAD_S * t)) / (n * STEP_RAD_S);
      return (2 / Math.PI) * STEP_RAD_S * sum;
    });
  };

  const format = (value, digits = 3) => (Number.isFinite(value) ? Number(value.toPrecision(digits)).toString() : "–");

  const set = (place) => {
    const axis = axes[place.dataset.axis];
    for (const part of ["rate", "angle"]) for (const name of Object.keys(axis[part])) axis[part][name] = row(axis[part][name]);
    axis.plant = row(axis.plant);
    axis.draws = axis.draws.map(row);
    const inputs = Object.fromEntries(Array.from(place.querySelectorAll("input"), (one) => [one.name, one]));
    const chosen = () => ({
      gains: Object.fromEntries(NAMES.map((name) => [name, inputs[name]
        ? Number(inputs[name].value) * axis.units[name].per_si : axis.flown[name]])),
      cutoff: inputs.cutoff ? Number(inputs.cutoff.value) : axis.derivative_cutoff_hz,
    });
    const flown = controllers(axis, axis.flown, axis.derivative_cutoff_hz);
    const before = step(axis, axis.plant, flown);
    const quiet = axis.noise_today * loudness(axis, axis.flown, axis.derivative_cutoff_hz, flown);
    const tilted = attitude(axis, flown.whole);

    const show = () => {
      const { gains, cutoff } = chosen();
      const found = controllers(axis, gains, cutoff);
      const rate = figures(axis, times(plain(axis.plant), found.rate));
      const whole = figures(axis, times(plain(axis.plant), found.whole));
      // An unstable loop has no peak.
      const peak = (one) => (one.stable ? one.peak : Infinity);
      const shown = (value) => (Number.isFinite(value) ? format(value) : "unstable");
      const peaks = axis.draws.map((plant) => Math.max(
        peak(figures(axis, times(plain(plant), found.rate))),
        peak(figures(axis, times(plain(plant), found.whole))),
      ));
      const setFigure = (name, text) => { place.querySelector(`[data-figure="${name}"]`).textContent = text; };
      const stands = rate.stable && whole.stable;
      setFigure("disturbance", stands ? comparedWithToday(attitude(axis, found.whole) / tilted) : "more and more, unlike");
      setFigure("crossover", rotorid.frequency(rate.crossover));
      setFigure("phase", `${format(rate.phase)}°`);
      setFigure("gain", `${format(rate.gain)} dB`);
      setFigure("peak", `${shown(peak(rate))}, with the angle loop ${shown(peak(whole))}`);
      const worst = Math.max(...peaks);
      setFigure("worst", `${shown(worst)} on the worst of ${peaks.length} likely vehicles`);
      place.querySelector('[data-figure="worst"]').classList.toggle("poor", worst > axis.limit);
      setFigure("noise", `${format((100 * loudness(axis, gains, cutoff, found)) / quiet, 3)} % of today's${axis.noise_seen ? "" : ", if it is white: it was not measured"}`);
      for (const [name, input] of Object.entries(inputs)) {
        place.querySelector(`output[data-of="${name}"]`).textContent = format(Number(input.value), 4);
      }
      place.querySelector("pre").textContent = NAMES.filter((name) => inputs[name])
        .map((name) => `${axis.units[name].name} = ${format(Number(inputs[name].value), 4)}`)
        .concat(inputs.cutoff ? [`D low-pass = ${format(cutoff, 4)} Hz`] : []).join("\n");
      const drawn = place.querySelector("[data-picture]");
      const answers = { flown: before, chosen: step(axis, axis.plant, found) };
      for (const line of rotorid.pictures[drawn.dataset.picture].data) Object.assign(line, { x: TIMES, y: answers[line.name] });
      return rotorid.redraw([drawn]);
    };
    place.querySelector("button").addEventListener("click", () => {
      for (const [name, input] of Object.entries(inputs)) input.value = input.dataset.proposed ?? input.value;
      show();
    });
    for (const input of Object.values(inputs)) input.addEventListener("input", show);
    place.hidden = false;
    return show();
  };
  // A point of the curve, or its number in the table, opens the parameters of that choice.
  const open = (choice) => {
    if (!choice) return;
    choice.open = true;
    choice.scrollIntoView({ block: "nearest" });
  };
  for (const link of document.querySelectorAll('a[href^="#choice-"]')) {
    link.addEventListener("click", () => open(document.querySelector(link.getAttribute("href"))));
  }
  const curve = document.querySelector('[data-picture="filters-curve"]');
  if (curve) {
    rotorid.redraw([curve]).then(() => curve.on("plotly_click", ({ points }) => {
      open(document.getElementById(`choice-${points[0].text}`));
    }));
  }
  Promise.all(Array.from(document.querySelectorAll("[data-axis]"), set)).then(
    () => { document.documentElement.dataset.sliders = "ready"; },
    (error) => { document.documentElement.dataset.sliders = `failed: ${error}`; },
  );
})();
