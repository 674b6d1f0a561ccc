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

// The impact of a family that delivers e, in SI units.
function impact(family, e, n, given) {
  const q = Math.log(e), f = grids.families[family].find((piece) => q <= piece.q[piece.q.length - 1] + 1e-12);
  const length = ((given.mass * given.speed ** 2) / given.stiffness) ** (1 / (n + 1));
  const unit = { duration: length / given.speed, max_force: (given.mass * given.speed ** 2) / length, max_indentation: length };
  const hit = { e };
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

const PREFIX = [[1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"]];
const prefix = (x) => PREFIX.find(([size]) => x >= size) ?? PREFIX[PREFIX.length - 1];
// Four digits.
function shown(x, unit) {
  const [size, letter] = prefix(x);
  return `${(x / size).toPrecision(4)} ${letter}${unit}`;
}

let plots = [];
function draw(list, hits, e) {
  for (const plot of plots) plot.destroy();
  const options = (id, series, scales, extra) => ({
    width: at(id).clientWidth, height: Math.min(340, Math.max(260, at(id).clientWidth * 0.75)),
    legend: { show: false }, cursor: { show: false }, pxAlign: 0, padding: [12, 12, 0, 0],
    axes: [{ size: 36 }, { size: 52 }], scales, series: [{}, ...series], ...extra,
  });
  const line = (law, more) => ({ label: law.title, stroke: law.stroke, width: 2, dash: law.dash, points: { show: false }, spanGaps: true, ...more });
  const asked = Array.from({ length: 96 }, (_, k) => 0.05 + 0.01 * k);
  const spot = (law, k) => ({ label: `${law.title} at e`, stroke: law.stroke, paths: () => null, points: { show: true, size: 9, fill: law.stroke } });
  const nearest = Math.round((e - 0.05) / 0.01);
  const first = new uPlot(
    options(
      "delivered",
      [...list.map((law) => line(law)), line({ title: "what is asked for", stroke: "#888", dash: [6, 6] }, { width: 1 }), ...list.map(spot)],
      { x: { time: false, range: [0, 1] }, y: { range: [0, 1] } },
    ),
    [asked, ...list.map((law) => asked.map(law.ask)), asked, ...hits.map((hit) => asked.map((_, k) => (k === nearest ? hit.e : null)))],
    at("delivered"),
  );
  const most = Math.max(...hits.map((hit) => hit.max_indentation));
  const [length, mm] = prefix(most);
  const [size, kilo] = prefix(Math.max(...hits.map((hit) => hit.max_force)));
  at("depth-unit").textContent = `${mm}m`;
  at("force-unit").textContent = `${kilo}N`;
  const smooth = { paths: uPlot.paths.spline() };
  // Compression and restitution are one line each, over increasing indentation.
  const half = (hits[0].depth.length + 1) / 2;
  const tables = hits.flatMap((hit) => {
    const x = hit.depth.map((y) => y / length), y = hit.force.map((f) => f / size);
    return [[x.slice(0, half), y.slice(0, half)], [x.slice(half - 1).reverse(), y.slice(half - 1).reverse()]];
  });
  const second = new uPlot(
    options("loop", list.flatMap((law) => [line(law, smooth), line(law, smooth)]), {
      x: { time: false, range: [0, (1.03 * most) / length] },
      y: { range: (_, low, high) => [Math.min(0, low), high * 1.04] },
    }),
    uPlot.join(tables),
    at("loop"),
  );
  plots = [first, second];
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

function update() {
  const e = Number(at("e").value);
  at("e-shown").textContent = e.toFixed(2);
  at("n-shown").textContent = Number(at("n").value).toFixed(2);
  at("alpha-shown").textContent = Number(at("alpha").value).toFixed(2);
  const numbers = given();
  if (!numbers) return;
  const list = curves();
  const hits = list.map((law) => impact(law.family, law.ask(e), law.n, numbers));
  at("rows").replaceChildren(
    ...list.map((law, k) => {
      const row = document.createElement("tr");
      row.dataset.law = law.name;
      const mark = document.createElement("span");
      mark.className = "mark";
      mark.style.borderColor = law.stroke;
      mark.style.borderTopStyle = law.dash.length ? "dashed" : "solid";
      const title = law.exponent ? `${law.title} (n = ${law.exponent})` : law.title;
      const hit = hits[k];
      const cells = [[mark, title], [hit.e.toFixed(4)], [shown(hit.max_force, "N")], [shown(hit.duration, "s")], [shown(hit.max_indentation, "m")]];
      for (const content of cells) {
        const cell = document.createElement("td");
        cell.append(...content);
        row.append(cell);
      }
      return row;
    }),
  );
  draw(list, hits, e);
}

for (const [k, name] of names.entries()) {
  const law = grids.laws[name], label = document.createElement("label"), box = document.createElement("input");
  Object.assign(box, { type: "checkbox", checked: chosen.has(name), value: name });
  label.append(box, law.title);
  label.style.borderColor = style(k).stroke;
  box.addEventListener("change", () => {
    if (box.checked) chosen.add(name);
    else chosen.delete(name);
    update();
  });
  at("laws").append(label);
  const line = document.createElement("li");
  line.textContent = `${law.title}: ${law.formula}. ${law.source}.`;
  at("formulas").append(line);
}
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
