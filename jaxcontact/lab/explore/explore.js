"use strict";
// The grids hold outcomes in scaled units on Chebyshev points; between them the interpolation is barycentric.
const grids = JSON.parse(document.getElementById("grids").textContent);
const at = (id) => document.getElementById(id);
const OUTCOMES = ["duration", "max_force", "max_indentation"];
const FIRST = ["hunt_crossley", "lankarani_nikravesh", "exact", "hu_guo", "flores"];
const COLOURS = ["#e69f00", "#56b4e9", "#009e73", "#0072b2", "#d55e00", "#cc79a7", "#999999"];
const DASHES = [[], [8, 4], [2, 3]];
const YOURS = "#000000";

// Weights of the values on Chebyshev points that give the value at x.
function weights(nodes, x) {
  const last = nodes.length - 1;
  if (last === 0) return [1];
  const found = nodes.findIndex((node) => Math.abs(node - x) < 1e-12);
  if (found >= 0) return nodes.map((_, k) => (k === found ? 1 : 0));
  const w = nodes.map((node, k) => ((k % 2 ? -1 : 1) * (k === 0 || k === last ? 0.5 : 1)) / (x - node));
  const sum = w.reduce((a, b) => a + b, 0);
  return w.map((one) => one / sum);
}

const along = (nodes, values, x) => weights(nodes, x).reduce((sum, w, k) => sum + w * values[k], 0);

// Values of `count` numbers each over the grid q × n, q = ln e.
function over(q, n, table, x, y, count) {
  const we = weights(q, x), wn = weights(n, y), found = new Array(count).fill(0);
  for (let i = 0; i < q.length; i++)
    for (let j = 0; j < n.length; j++) {
      const w = we[i] * wn[j], first = (i * n.length + j) * count;
      for (let k = 0; k < count; k++) found[k] += w * table[first + k];
    }
  return found;
}

// Time, force and length of an impact, of which outcomes are multiples.
function units(n, given) {
  const length = ((given.mass * given.speed ** 2) / given.stiffness) ** (1 / (n + 1));
  return { duration: length / given.speed, max_force: (given.mass * given.speed ** 2) / length, max_indentation: length };
}

// The impact of a family that delivers e, in SI units.
function impact(family, e, n, given) {
  const q = Math.log(e), f = grids.families[family].find((piece) => q <= piece.q[piece.q.length - 1] + 1e-12);
  const unit = units(n, given), hit = { e };
  for (const name of OUTCOMES) hit[name] = unit[name] * Math.exp(over(f.q, f.n, f[name], q, n, 1)[0]);
  const count = f.loop.length / (f.loop_q.length * f.loop_n.length);
  const loop = over(f.loop_q, f.loop_n, f.loop, q, n, count);
  hit.depth = loop.slice(0, count / 2).map((x) => x * unit.max_indentation);
  hit.force = loop.slice(count / 2).map((x) => x * unit.max_force);
  return hit;
}

const names = [...FIRST, ...Object.keys(grids.laws).filter((name) => !FIRST.includes(name))];
const chosen = new Set(FIRST);
const style = (k) => ({ stroke: COLOURS[k % COLOURS.length], dash: DASHES[Math.floor(k / COLOURS.length) % DASHES.length] });
const dashes = ({ dash: [long] }) => (long === undefined ? "solid" : long > 3 ? "dashed" : "dotted");

function curves() {
  const n = Number(at("n").value);
  const list = names
    .map((name, k) => ({ name, ...grids.laws[name], ...style(k) }))
    .filter((law) => chosen.has(law.name))
    .map((law) => ({ ...law, n: law.exponent ?? n, ask: (e) => along(grids.asked, law.delivered, e) }));
  const alpha = Number(at("alpha").value);
  const fixed = along(grids.z, grids.damped, alpha / (1 + alpha));
  return [...list, { name: "yours", title: "your α", family: "hunt_crossley", exponent: null, n, stroke: YOURS, dash: [2, 2], ask: () => fixed }];
}

// Laws whose e depends on speed, in scaled units: mass, stiffness and closing speed are 1. `load` is the force of compression,
// `back` that after the largest indentation m, which ends at `end`. `alpha` damps both. `e` is a formula, but for damped ones.
const LOSS = 0.64864140196799; // of a neck, over (F_po⁵/K²)^(1/3)
function yielding(yields, alpha, e) {
  const y = (1.25 * yields ** 2) ** 0.4;
  const load = (x) => (x < y ? x ** 1.5 : y ** 1.5 + 1.5 * Math.sqrt(y) * (x - y));
  const end = (m) => Math.max(0, m - load(m) / Math.sqrt(m));
  const back = (x, m) => load(m) * (Math.max(0, x - end(m)) / (m - end(m))) ** 1.5;
  return { n: 1.5, load, back, end, alpha, e };
}
function plastic(yields) {
  const r = Math.min(1, yields), root = Math.sqrt((6 - r * r) / 5);
  return yielding(yields, 0, Math.sqrt(1.2 * Math.sqrt(3) * (1 - (r * r) / 6) * Math.sqrt(r / (r + 2 * root))));
}
function bilinear(k, c) {
  const back = (x, m) => Math.max(k * (x - (1 - 1 / k) * m), -(c ?? 0) * x);
  const square = c === null ? 1 / k : (1 - c * (k - 2)) / (k + c);
  return { n: 1, load: (x) => x, back, end: (m) => (c === null ? (1 - 1 / k) * m : 0), alpha: 0, e: Math.sqrt(Math.max(0, square)) };
}
const pull = (sticking) => (sticking ** 2 / (2 * LOSS)) ** 0.6;
function dmt(sticking) {
  const load = (x) => Math.max(0, x) ** 1.5 - pull(sticking);
  return { n: 1.5, load, back: load, end: () => 0, alpha: 0, e: 1 };
}
function jkr(sticking) {
  const b = Math.sqrt(pull(sticking)), least = (b / 3) ** (1 / 3);
  // With s = z^(1/4), δ = s⁴ - (4/3) b s. Newton's method from above falls to the root.
  const load = (x) => {
    let s = Math.max(least, 1e-9, Math.sqrt(Math.sqrt(Math.max(0, x))) + Math.cbrt((4 / 3) * b)), step = 1;
    for (let k = 0; k < 60 && step > 1e-14; k++) {
      step = Math.max(0, (s ** 4 - (4 / 3) * b * s - x) / Math.max(1e-30, 4 * s ** 3 - (4 / 3) * b));
      s = Math.max(least, s - step);
    }
    return s ** 6 - 2 * b * s ** 3;
  };
  const end = b === 0 ? 0 : least ** 4 - (4 / 3) * b * least;
  return { n: 1.5, load, back: load, end: () => end, alpha: 0, e: Math.sqrt(Math.max(0, 1 - sticking ** 2)) };
}
// At s times the closing speed of the page.
const scaled = {
  thornton_plastic: (p, s) => plastic(p.yield / s),
  viscoplastic: (p, s) => yielding(p.yield / s, p.alpha * s),
  walton_braun: (p, s) => bilinear(1 + (p.ratio - 1) * s, null),
  luding: (p, s) => bilinear(1 + (p.ratio - 1) * s, p.adhesion),
  jkr: (p, s) => jkr(p.sticking / s),
  dmt: (p, s) => dmt(p.sticking / s),
  wet_restitution: (p, s) => ({ e: Math.max(0, p.e * (1 - p.sticking / s)) }),
};
const MEMORIES = Object.keys(scaled), remembered = new Set(MEMORIES);
const SLIDERS = ["e", "n", "alpha", "yield", "ratio", "adhesion", "sticking"];

// Runge-Kutta steps h to the end of a contact, or to the next turn of bodies that stick.
function follow({ load, back, end, alpha }, h) {
  const path = [[0, load(0)]];
  let x = 0, v = 1, t = 0, m = null, turn = 0;
  const force = (x, v) => (m === null ? load(x) : back(x, m)) * (1 + alpha * v);
  for (;;) {
    const a = -force(x, v), b = -force(x + (h / 2) * v, v + (h / 2) * a);
    const vc = v + (h / 2) * b, c = -force(x + (h / 2) * (v + (h / 2) * a), vc), d = -force(x + h * vc, v + h * c);
    const next = x + h * v + ((h * h) / 6) * (a + b + c), after = v + (h / 6) * (a + 2 * b + 2 * c + d);
    if (m !== null && (next <= end(m) || after > 0)) {
      const stuck = next > end(m), part = stuck ? 0 : (x - end(m)) / (x - next);
      if (!stuck) path.push([end(m), force(end(m), after)]);
      return { path, turn, m, stuck, duration: t + part * h, e: stuck ? 0 : -(v + part * (after - v)) };
    }
    [x, v, t] = [next, after, t + h];
    if (m === null && v <= 0) {
      m = x + v ** 2 / (2 * load(x));
      turn = path.length;
      path.push([m, load(m)]);
    } else path.push([x, force(x, v)]);
  }
}

const restitution = (law, s) => {
  const one = scaled[law.name](law.p, s);
  return one.e ?? follow(one, 0.02).e;
};

const LOOP = 60; // points of each half
function memory(law, s, given) {
  const one = scaled[law.name](law.p, s);
  const n = one.n ?? law.p.n, unit = units(n, given);
  // Force and indentation are drawn over those of an impact without loss.
  const deepest = ((n + 1) / 2) ** (1 / (n + 1)), strongest = deepest ** n;
  if (!one.load) {
    if (one.e < 0.03) return { e: one.e, stuck: one.e === 0 };
    const hit = impact("hunt_crossley", one.e, n, given);
    hit.depth = hit.depth.map((x) => x / unit.max_indentation / deepest);
    hit.force = hit.force.map((f) => f / unit.max_force / strongest);
    return hit;
  }
  const run = follow(one, 0.002), last = run.path.length - 1;
  // Points are dense at touch and at the end, where forces are steep.
  const even = Array.from({ length: LOOP }, (_, k) => k / LOOP);
  const times = [...even.map((u) => run.turn * u ** 2), ...even.map((u) => last - (last - run.turn) * (1 - u) ** 2), last];
  const loop = times.map((k) => run.path[Math.round(k)]);
  return {
    e: one.e ?? run.e, stuck: run.stuck, duration: run.stuck ? undefined : run.duration * unit.duration,
    max_force: Math.max(...run.path.map(([, f]) => f)) * unit.max_force, max_indentation: run.m * unit.max_indentation,
    depth: loop.map(([x]) => x / deepest), force: loop.map(([, f]) => f / strongest),
  };
}

function ofSpeed() {
  const p = Object.fromEntries(SLIDERS.map((name) => [name, Number(at(name).value)]));
  return MEMORIES.map((name, k) => ({ name, ...grids.of_speed[name], ...style(k), p })).filter((law) => remembered.has(law.name));
}

const PREFIX = [[1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"]];
const prefix = (x) => PREFIX.find(([size]) => x >= size) ?? PREFIX[PREFIX.length - 1];
// Four digits.
function shown(x, unit) {
  const [size, letter] = prefix(x);
  return `${(x / size).toPrecision(4)} ${letter}${unit}`;
}

const spline = { paths: uPlot.paths.spline() };
const line = (law, more) => ({ label: law.title, stroke: law.stroke, width: 2, dash: law.dash, points: { show: false }, spanGaps: true, ...more });
const spot = (law) => ({ label: `${law.title}, now`, stroke: law.stroke, paths: () => null, points: { show: true, size: 9, fill: law.stroke } });
const plots = {};
function plot(id, series, scales, table) {
  plots[id]?.destroy();
  const options = {
    width: at(id).clientWidth, height: Math.min(340, Math.max(260, at(id).clientWidth * 0.75)),
    legend: { show: false }, cursor: { show: false }, pxAlign: 0, padding: [12, 12, 0, 0],
    axes: [{ size: 36 }, { size: 52 }], scales, series: [{}, ...series],
  };
  plots[id] = new uPlot(options, table, at(id));
}

// Lines e(x), and the spot of each law at x[now].
function drawRestitution(id, list, x, lines, hits, now, scale, extra = []) {
  const spots = hits.map((hit) => x.map((_, k) => (k === now ? hit.e : null)));
  const series = [...list.map((law) => line(law)), ...extra.map(([one]) => one), ...list.map(spot)];
  plot(id, series, { x: { time: false, ...scale }, y: { range: [0, 1] } }, [x, ...lines, ...extra.map(([, y]) => y), ...spots]);
}

function drawLoops(id, list, hits) {
  const drawn = list.map((law, k) => [law, hits[k]]).filter(([, hit]) => hit.depth);
  let length = 1, size = 1;
  if (at(`${id}-depth`)) {
    const [[long, mm], [strong, kilo]] = ["max_indentation", "max_force"].map((name) => prefix(Math.max(...drawn.map(([, hit]) => hit[name]))));
    [length, size] = [long, strong];
    at(`${id}-depth`).textContent = `${mm}m`;
    at(`${id}-force`).textContent = `${kilo}N`;
  }
  // Compression and restitution are one line each, over increasing indentation.
  const tables = drawn.flatMap(([, hit]) => {
    const x = hit.depth.map((y) => y / length), y = hit.force.map((f) => f / size), half = (x.length + 1) / 2;
    return [[x.slice(0, half), y.slice(0, half)], [x.slice(half - 1).reverse(), y.slice(half - 1).reverse()]];
  });
  const scales = {
    x: { time: false, range: (_, low, high) => [Math.min(0, low), 1.03 * high] },
    y: { range: (_, low, high) => [Math.min(0, low), high * 1.04] },
  };
  plot(id, drawn.flatMap(([law]) => [line(law, spline), line(law, spline)]), scales, uPlot.join(tables));
}

function given() {
  const numbers = {};
  for (const name of ["mass", "stiffness", "speed"]) {
    numbers[name] = Number(at(name).value);
    if (!(numbers[name] > 0 && Number.isFinite(numbers[name]))) {
      at("fault").textContent = `The ${name === "speed" ? "closing speed" : name} must be a positive number.`;
      return null;
    }
  }
  at("fault").textContent = "";
  return numbers;
}

function fill(id, list, hits) {
  at(id).replaceChildren(
    ...list.map((law, k) => {
      const row = document.createElement("tr");
      row.dataset.law = law.name;
      const mark = document.createElement("span");
      mark.className = "mark";
      mark.style.borderColor = law.stroke;
      mark.style.borderTopStyle = dashes(law);
      const title = law.exponent ? `${law.title} (n = ${law.exponent})` : law.title;
      const hit = hits[k], cells = [[mark, title], [hit.e.toFixed(4)]];
      if (hit.stuck) cells[1].push(" (sticks)");
      for (const [name, unit] of [["max_force", "N"], ["duration", "s"], ["max_indentation", "m"]])
        cells.push([hit[name] === undefined ? "–" : shown(hit[name], unit)]);
      for (const content of cells) {
        const cell = document.createElement("td");
        cell.append(...content);
        row.append(cell);
      }
      return row;
    }),
  );
}

function update() {
  for (const name of SLIDERS) at(`${name}-shown`).textContent = Number(at(name).value).toFixed(2);
  const numbers = given();
  if (!numbers) return;
  const e = Number(at("e").value), list = curves();
  const hits = list.map((law) => impact(law.family, law.ask(e), law.n, numbers));
  fill("rows", list, hits);
  const asked = Array.from({ length: 96 }, (_, k) => 0.05 + 0.01 * k);
  const same = [line({ title: "what is asked for", stroke: "#888", dash: [6, 6] }, { width: 1 }), asked];
  drawRestitution("delivered", list, asked, list.map((law) => asked.map(law.ask)), hits, Math.round((e - 0.05) / 0.01), { range: [0, 1] }, [same]);
  drawLoops("loop", list, hits);

  const memories = ofSpeed(), found = memories.map((law) => memory(law, 1, numbers));
  fill("speed-rows", memories, found);
  const times = Array.from({ length: 121 }, (_, k) => 10 ** ((k - 80) / 40)), speeds = times.map((s) => s * numbers.speed);
  const lines = memories.map((law) => times.map((s) => restitution(law, s)));
  drawRestitution("of-speed", memories, speeds, lines, found, 80, { distr: 3, range: [speeds[0], speeds[120]] });
  drawLoops("memory", memories, found);
}

// Boxes to choose laws, and their formulas.
function offer(id, names, laws, chosen) {
  for (const [k, name] of names.entries()) {
    const law = laws[name], label = document.createElement("label"), box = document.createElement("input");
    Object.assign(box, { type: "checkbox", checked: chosen.has(name), value: name });
    label.append(box, law.title);
    label.style.borderColor = style(k).stroke;
    label.style.borderStyle = dashes(style(k));
    box.addEventListener("change", () => {
      if (box.checked) chosen.add(name);
      else chosen.delete(name);
      update();
    });
    at(id).append(label);
    const line = document.createElement("li");
    line.textContent = `${law.title}: ${law.formula}. ${law.source}.`;
    at("formulas").append(line);
  }
}
offer("laws", names, grids.laws, chosen);
offer("speed-laws", MEMORIES, grids.of_speed, remembered);
at("version").textContent = grids.version;
for (const name of ["e", "outcomes", "loop"]) at(`error-${name}`).textContent = grids.error[name].toExponential(0);
for (const input of document.querySelectorAll(".controls input")) input.addEventListener("input", update);
let width = 0;
new ResizeObserver(() => {
  if (width !== at("delivered").clientWidth) {
    width = at("delivered").clientWidth;
    update();
  }
}).observe(at("delivered"));
