"use strict";
// Draws the figures, in light or dark as the reader or the reader's system asks, and light on paper, and in the units
// chosen. The script of a page of its own puts further pictures into `rotorid.pictures`, as figures or as what makes one.
const rotorid = (() => {
  const { pictures, light, dark } = JSON.parse(document.getElementById("figures").textContent);
  const darkness = window.matchMedia("(prefers-color-scheme: dark)");
  const root = document.documentElement;
  const switches = Array.from(document.querySelectorAll("button[data-unit]"));
  const units = { frequency: root.dataset.frequency ?? "rad/s", magnitude: root.dataset.magnitude ?? "dB" };
  let printing = false;

  const isDark = () => !printing && (root.dataset.theme ? root.dataset.theme === "dark" : darkness.matches);
  const template = () => (isDark() ? dark : light);
  // Pictures are saved as they are printed: lines, not pixels.
  const config = (key) => ({
    displaylogo: false,
    modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
    toImageButtonOptions: { format: "svg", filename: `${document.title} ${key}`.replace(/[^\w.-]+/g, "-") },
  });

  const each = (numbers, change) => numbers.map((number) => (number === null ? null : change(number)));
  const hertz = (omega) => omega / (2 * Math.PI);
  const factor = (decibels) => 10 ** (decibels / 20);

  // A trace comes in rad/s and, on the first axis, in dB. What is not a number is written by Python for each view.
  const converted = (trace, hovertemplate, leveled) => {
    const { x, y, customdata } = trace;
    const across = units.frequency === "Hz" ? { x: each(x, hertz), customdata: customdata && x } : { x };
    const high = leveled && units.magnitude === "linear" && trace.yaxis === "y" ? { y: each(y, factor) } : { y };
    return { ...trace, ...(hovertemplate ? { hovertemplate } : {}), ...across, ...high };
  };
  const seen = (key) => {
    const { data, layout, views } = typeof pictures[key] === "function" ? pictures[key]() : pictures[key];
    if (!views) return { data, layout };
    const leveled = views[`${units.frequency} ${units.magnitude}`];
    const view = leveled ?? views[units.frequency];
    const convert = (trace, number) => converted(trace, view.hover[number], Boolean(leveled));
    return { data: view.data ?? data.map(convert), layout: view.layout };
  };

  // Plotly breaks no lines: a title that is wider than its picture goes on below.
  const pen = document.createElement("canvas").getContext("2d");
  const broken = (title, size, room) => {
    pen.font = `${size}px ${light.layout.font.family}`;
    return title.split(" ").reduce((lines, word) => {
      const longer = lines.length ? `${lines.at(-1)} ${word}` : word;
      return pen.measureText(longer).width <= room ? [...lines.slice(0, -1), longer] : [...lines, word];
    }, []);
  };
  const LINE = 1.3;
  const fitted = (layout, width, size) => {
    const { margin, height, legend, annotations = [], xaxis } = layout;
    if (!margin || !height) return layout;
    const room = width - margin.l - margin.r - 12;
    const fit = (title) => {
      const lines = broken(title, size, room);
      return { text: lines.join("<br>"), more: (lines.length - 1) * LINE * size };
    };
    const labels = annotations.map((one) => (one.xref === "paper" && one.x === 0 ? { ...one, align: "left", ...fit(one.text) } : one));
    const under = fit(xaxis?.title?.text ?? "");
    // What is above the first panel makes room for its title; between panels there is room for two lines.
    const above = Math.max(0, ...labels.filter((one) => one.y === 1).map((one) => one.more ?? 0));
    const inner = height - margin.t - margin.b;
    return {
      ...layout,
      height: height + above + under.more,
      margin: { ...margin, t: margin.t + above, b: margin.b + under.more },
      legend: legend && { ...legend, y: legend.y + above / inner },
      annotations: labels.map(({ more, ...one }) => one),
      xaxis: xaxis?.title ? { ...xaxis, title: { ...xaxis.title, text: under.text } } : xaxis,
    };
  };

  const FONT = 12;
  const onScreen = (place, layout) => fitted(layout, place.clientWidth, FONT);
  // On paper pictures of one kind are two in a row, and a history is as high as its panels need, up to a page.
  const PAPER = { width: 680, half: 336, least: 160, most: 900, font: 9, above: 38, below: 32, legend: 16 };
  // Of the height on a screen: a history of many panels, two panels, bars with names, one panel.
  const shareOnPaper = (layout) => {
    if (layout.yaxis5) return 0.36;
    if (layout.yaxis2) return 0.6;
    return layout.yaxis?.ticktext ? 0.54 : 0.42;
  };
  const onPaper = (place, layout) => {
    const half = place.parentElement.closest(".pictures") !== null;
    const width = half ? PAPER.half : PAPER.width;
    const margin = { ...layout.margin, t: PAPER.above, b: PAPER.below };
    const inner = layout.height - layout.margin.t - layout.margin.b;
    const height = Math.min(Math.max(Math.round(shareOnPaper(layout) * inner) + margin.t + margin.b, PAPER.least), PAPER.most);
    const small = Object.fromEntries(Object.entries(layout).filter(([name]) => /^[xy]axis/.test(name)).map(([name, axis]) =>
      [name, { ...axis, tickfont: { size: PAPER.font - 1 }, title: { ...axis.title, font: { size: PAPER.font } } }]));
    const annotations = (layout.annotations ?? []).map((one) => ({ ...one, font: { ...one.font, size: PAPER.font } }));
    const legend = layout.legend && { ...layout.legend, font: { size: PAPER.font - 1 }, y: 1 + PAPER.legend / (height - margin.t - margin.b) };
    return fitted({ ...layout, ...small, annotations, legend, margin, width, height, autosize: false }, width, PAPER.font);
  };

  // What a picture was drawn with: one that was drawn like this already is not drawn again.
  const drawnWith = new WeakMap();
  const now = () => [isDark(), printing, units.frequency, units.magnitude, window.innerWidth].join();
  const draw = (places) =>
    Promise.all(
      places.map((place) => {
        const key = place.dataset.picture;
        drawnWith.set(place, now());
        const { data, layout } = structuredClone(seen(key));
        const sized = layout.height ? (printing ? onPaper : onScreen)(place, layout) : layout;
        return Plotly.react(place, data, { ...sized, template: template() }, config(key));
      }),
    );
  // In closed details a picture has no width yet; it is drawn when they open.
  const all = (part = document) => Array.from(part.querySelectorAll("[data-picture]"));
  const ready = (place) => pictures[place.dataset.picture] && !place.closest("details:not([open]), [hidden]");
  // Several may be under way, of details that open one inside the other: the state is set when the last is done.
  let [underWay, failed] = [0, ""];
  const redraw = (places = all()) => {
    underWay += 1;
    root.dataset.pictures = "drawing";
    const done = (error) => {
      underWay -= 1;
      failed ||= error ? `failed: ${error}` : "";
      if (underWay > 0) return;
      root.dataset.pictures = failed || "drawn";
      failed = "";
    };
    return draw(places.filter(ready)).then(() => done(), done);
  };

  const press = () => {
    for (const button of switches) {
      button.setAttribute("aria-pressed", String(units[button.dataset.unit] === button.value));
    }
  };
  const choose = ({ currentTarget: button }) => {
    units[button.dataset.unit] = button.value;
    press();
    rewrite();
    redraw(all().filter((place) => pictures[place.dataset.picture]?.views));
  };
  for (const button of switches) button.addEventListener("click", choose);
  for (const group of document.querySelectorAll(".choices")) group.hidden = false;
  for (const details of document.querySelectorAll("details:has([data-picture])")) {
    details.addEventListener("toggle", () => redraw(all(details).filter((place) => drawnWith.get(place) !== now())));
  }
  press();

  // A link into a fold opens it.
  const reveal = (id) => {
    for (let fold = document.getElementById(id)?.closest("details"); fold; fold = fold.parentElement.closest("details")) {
      fold.open = true;
    }
  };
  document.addEventListener("click", ({ target }) => {
    const link = target.closest?.('a[href^="#"]');
    if (link) reveal(decodeURIComponent(link.hash.slice(1)));
  });
  if (location.hash) reveal(decodeURIComponent(location.hash.slice(1)));

  // What a reader sees of an element in one line; of a cell the words below its number apart.
  const isWords = (node) => node.classList?.contains("words");
  const text = (node, skip = () => false) => {
    if (node.nodeName === "BR") return " ";
    if (!node.childNodes.length) return node.textContent;
    return Array.from(node.childNodes).filter((one) => !skip(one)).map((one) => text(one, skip)).join("");
  };
  const tidy = (words) => words.replace(/\s+/g, " ").trim();
  // Rows of a table with a cell for each column: one that spans several rows is in all of them.
  const gridOf = (table) => {
    const above = [];
    return Array.from(table.querySelectorAll("tbody tr"), (row) => {
      const cells = Array.from(row.cells);
      const line = [];
      for (let column = 0; cells.length || above[column]?.left > 0; column += 1) {
        if (above[column]?.left > 0) {
          above[column].left -= 1;
          line.push(above[column].cell);
          continue;
        }
        const cell = cells.shift();
        for (let k = 0; k < cell.colSpan; k += 1) above[column + k] = { cell, left: cell.rowSpan - 1 };
        line.push(...Array(cell.colSpan).fill(cell));
        column += cell.colSpan - 1;
      }
      return line;
    });
  };
  const headsOf = (table) => Array.from(table.querySelectorAll("thead tr:last-child > *"), (head) => tidy(text(head)));

  // On a narrow screen a row becomes a card, in which every number is next to the name of its column.
  for (const table of document.querySelectorAll("table:has(thead)")) {
    const heads = headsOf(table);
    if (heads.length < 3 || table.closest(".fleet-table")) continue;
    table.classList.add("cards");
    for (const line of gridOf(table)) {
      line.forEach((cell, column) => {
        if (cell.dataset.head !== undefined || cell.nodeName !== "TD") return;
        cell.dataset.head = cell.colSpan > 1 ? "" : heads[column];
        if (!cell.childNodes.length) return;
        // Several pieces of a cell stay one piece of the card.
        const inner = document.createElement("div");
        inner.append(...cell.childNodes);
        cell.append(inner);
      });
    }
  }
  // One unit of frequency on a page. Texts and tables come in rad/s; in Hz each number is shown over 2π, with one more
  // decimal. Rates of turning are in rad/s too and stay, so only what is known to be a frequency is converted: columns
  // and rows with the unit in their heading, rows of a frequency by their first words, and in a text a range or a number
  // behind a word such as "at", "above" or "crossover". Code and what is marked `data-exact` stay.
  const PLACES = "body *:not(script, style, noscript, code, pre, button, .picture, [data-exact])";
  const A_NUMBER = String.raw`[−-]?\d+(?:\.\d+)?`;
  const WITH_UNIT = new RegExp(
    String.raw`((?:${A_NUMBER} (?:±|to|and|or) |${A_NUMBER}–)*${A_NUMBER}(?: \(${A_NUMBER} to ${A_NUMBER}\))?) rad/s(?![²\w^·*/])`, "g");
  const NOT_FREQUENCIES = /(?:(?:bias|noise|drift|speed|rate)(?: of)?(?: some| about)?|outside of|value is|output,) $/i;
  const FREQUENCIES = /(?:\b(?:at|above|below|beyond|from|between|up to|over|than|reach(?:ed|es)?|crossover|bandwidth|frequency|needs?)(?: (?:of|is|about|some|the))*|[(±]) ?$/i;
  const A_RANGE = / to |–| and /;
  const TURNING = /\b(?:speeds|gyro\w*)\b[^.;]*$/i;
  const FREQUENCY_ROW = /crossover|bandwidth|frequency|oscillat|resonan|margin at|peak at|lag of 180/i;
  const RADIANS = /\[rad\/s\]/g;
  const decimals = (number) => number.split(".")[1]?.length ?? 0;
  const over = (number, places) => (number.replace("−", "-") / (2 * Math.PI)).toFixed(places).replace("-", "−");
  const alone = (number) => {
    const digits = number.replace(/^[−-]?0*\.?0*|\./g, "").length;
    const value = Math.abs(number.replace("−", "-")) / (2 * Math.PI);
    const wanted = Math.max(2, digits) - 1 - Math.floor(Math.log10(value || 1));
    return over(number, Math.max(0, Math.abs(number.replace("−", "-")) < 1 || digits < 2 ? wanted : decimals(number) + 1));
  };
  const inHertz = (words) => {
    const deviation = new RegExp(`(${A_NUMBER}) ± (${A_NUMBER})`).exec(words)?.[2];
    const places = deviation && Math.max(decimals(deviation) + 1, deviation.length < 2 ? 1 : 0);
    return words.replace(/(?<![·\d.])[−-]?\d+(?:\.\d+)?(?![\d⁻])/g, (number) => (deviation ? over(number, places) : alone(number)));
  };
  const isFrequency = (numbers, before) =>
    !NOT_FREQUENCIES.test(before) && !TURNING.test(before) && (A_RANGE.test(numbers) || FREQUENCIES.test(before));
  const isUnit = (node) => node.textContent.trim() === "rad/s";
  const leaves = (element) => {
    const walker = document.createTreeWalker(element, NodeFilter.SHOW_TEXT, (node) =>
      (node.parentElement.matches(PLACES) && !node.parentElement.closest("code, pre, button, .picture, [data-exact]")
        ? NodeFilter.FILTER_ACCEPT : NodeFilter.FILTER_REJECT));
    const found = [];
    while (walker.nextNode()) if (/\S/.test(walker.currentNode.data)) found.push(walker.currentNode);
    return found;
  };
  const rewritten = new Map();
  const toHertz = (node, words) => { if (words !== node.data) rewritten.set(node, [node.data, words]); };
  const ofCells = (cells) => { for (const node of cells.flatMap(leaves)) if (!/Hz/.test(node.data)) toHertz(node, inHertz(node.data)); };
  const findFrequencies = () => {
    for (const table of document.querySelectorAll("table")) {
      const heads = headsOf(table);
      for (const line of gridOf(table)) {
        const [first, ...others] = line;
        const unit = line.findLast(isUnit);
        if (RADIANS.test(first?.textContent)) ofCells(others);
        else if (unit && line.some((cell) => FREQUENCY_ROW.test(cell.textContent)) && !line.some((cell) => cell.querySelector("code"))) {
          ofCells(others.filter((cell) => cell !== unit));
          for (const node of leaves(unit)) toHertz(node, node.data.replace("rad/s", "Hz"));
        } else ofCells(line.filter((_, column) => /\[rad\/s\]/.test(heads[column] ?? "")));
        RADIANS.lastIndex = 0;
      }
    }
    for (const node of leaves(document.body)) {
      if (rewritten.has(node)) continue;
      const unit = node.data.replace(RADIANS, "[Hz]");
      toHertz(node, unit.replace(WITH_UNIT, (whole, numbers, at, text) =>
        (isFrequency(numbers, text.slice(0, at)) ? `${inHertz(numbers)} Hz` : whole)));
    }
  };
  const rewrite = () => {
    const hertz = units.frequency === "Hz";
    if (hertz && !rewritten.size) findFrequencies();
    for (const [node, words] of rewritten) node.data = words[Number(hertz)];
    const [from, to] = hertz ? ["[rad/s]", "[Hz]"] : ["[Hz]", "[rad/s]"];
    for (const cell of document.querySelectorAll("[data-radians]")) cell.dataset.head = cell.dataset.head.replace(from, to);
  };
  // The same of a number in rad/s that a script of a page writes: text with its unit.
  const frequency = (omega, digits = 3) =>
    (units.frequency === "Hz" ? `${Number(hertz(omega).toPrecision(digits))} Hz` : `${Number(omega.toPrecision(digits))} rad/s`);
  for (const cell of document.querySelectorAll("[data-head*='[rad/s]']")) cell.dataset.radians = "";
  rewrite();

  // What scrolls sideways can be reached by keyboard.
  for (const place of document.querySelectorAll(".scroll, pre, nav")) {
    if (place.scrollWidth > place.clientWidth) place.tabIndex = 0;
  }

  // A table as comma-separated values, for a spreadsheet: value, deviation and ends of an interval in columns of their
  // own, numbers as programs read them, and nothing where there is none.
  const POWERS = "⁰¹²³⁴⁵⁶⁷⁸⁹";
  const plain = (words) => words
    .replace(/−/g, "-").replace(/∞/g, "inf")
    .replace(/·10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)/g, (_, power) => `e${power.replace("⁻", "-").replace(/[⁰¹²³⁴⁵⁶⁷⁸⁹]/g, (one) => POWERS.indexOf(one))}`)
    .replace(/\(([^() ]+) ± ([^() ]+)\)(e-?\d+)/, "$1$3 ± $2$3");
  const NUMBER = String.raw`[+-]?(?:\d+(?:\.\d+)?(?:e-?\d+)?|inf)`;
  const SHAPE = new RegExp(String.raw`^(?:× )?(?<value>${NUMBER})?(?: ?± (?<std>${NUMBER}))?` +
    String.raw`(?:(?:^| ?\(| )(?<low>${NUMBER}) to (?<high>${NUMBER})\)?| \((?<beside>${NUMBER})\))?(?: ?(?<unit>[^\d\s(),:j/-][^\s]*))?$`);
  const NAMES = { value: "", std: "±", low: "from", high: "to", beside: "in parentheses", unit: "unit", note: "note" };
  const numeric = (words) => {
    const found = SHAPE.exec(plain(words))?.groups;
    return found && (found.value ?? found.low) !== undefined ? found : null;
  };
  const partsOf = (cell) => {
    const main = tidy(text(cell, isWords));
    const parts = { ...(main === "" || main === "–" ? {} : numeric(main) ?? { value: plain(main) }) };
    for (const words of Array.from(cell.querySelectorAll(".words"), (one) => tidy(text(one)))) {
      const interval = numeric(words);
      const fits = interval?.low !== undefined && interval.value === undefined && parts.low === undefined;
      Object.assign(parts, fits ? { low: interval.low, high: interval.high } : { note: plain(words) });
    }
    return parts;
  };
  const quoted = (words) => (/[",\n]/.test(words) ? `"${words.replaceAll('"', '""')}"` : words);
  const separated = (table) => {
    const heads = headsOf(table);
    const rows = gridOf(table).filter((line) => line.some((cell) => cell.nodeName === "TD")).map((line) => line.map(partsOf));
    const columns = Array.from({ length: Math.max(heads.length, ...rows.map((row) => row.length)) }, (_, k) => k).flatMap((k) => {
      const used = Object.keys(NAMES).filter((name) => rows.some((row) => row[k]?.[name] !== undefined));
      return (used.length ? used : ["value"]).map((name) => [k, name]);
    });
    const first = columns.map(([k, name]) => `${heads[k] ?? ""} ${NAMES[name]}`.trim());
    return [first, ...rows.map((row) => columns.map(([k, name]) => row[k]?.[name] ?? ""))]
      .map((line) => line.map(quoted).join(",")).join("\n");
  };
  const copied = async (words) => {
    if (navigator.clipboard) return navigator.clipboard.writeText(words);
    const field = document.body.appendChild(document.createElement("textarea"));
    field.value = words;
    field.select();
    document.execCommand("copy");
    return field.remove();
  };
  for (const table of document.querySelectorAll(".scroll > table")) {
    if (table.rows.length < 3 || table.closest(".fleet-table")) continue;
    const button = document.createElement("button");
    button.type = "button";
    button.className = "copy";
    button.textContent = "Copy as CSV";
    button.addEventListener("click", async () => {
      try { await copied(separated(table)); button.textContent = "Copied"; } catch { button.textContent = "The browser refused"; }
      setTimeout(() => { button.textContent = "Copy as CSV"; }, 2000);
    });
    table.parentElement.after(button);
  }

  // The script of the page itself comes behind this one.
  document.addEventListener("DOMContentLoaded", () => redraw());
  darkness.addEventListener("change", () => redraw());
  let [width, waiting] = [window.innerWidth, 0];
  window.addEventListener("resize", () => {
    if (printing || window.innerWidth === width) return;
    width = window.innerWidth;
    cancelAnimationFrame(waiting);
    waiting = requestAnimationFrame(() => redraw());
  });
  // On paper folds are open, but for minor details and for what explains how to read a page.
  let opened = [];
  const turn = (paper) => {
    printing = paper;
    if (paper) opened = Array.from(document.querySelectorAll("details:not([open], .reading, .by-hand, .minor)"));
    for (const details of opened) details.open = paper;
    return redraw();
  };
  window.addEventListener("beforeprint", () => turn(true));
  window.addEventListener("afterprint", () => turn(false));
  return { pictures, redraw, template, frequency };
})();
