"use strict";
// One cursor for all pictures: curves are read back from their paths, by the scales of their plot.
const LEFT = 58, RIGHT = 892, TOP = 8;
const NAMES = {error_m: "error, m", gap_m: "gap, m", speed_mps: "speed, m/s",
  own_m: "self-estimated error, m", speed_gain: "speed gain", spacing_gain: "spacing error gain"};
const UNITS = {time: "s", place: "m", frequency: "Hz"};
const axes = {};
for (const svg of document.querySelectorAll("svg[data-axis]")) {
  const name = svg.dataset.axis, from = Number(svg.dataset.from), to = Number(svg.dataset.to);
  const axis = axes[name] ??= {name, from, to, pictures: [], curves: []};
  axis.pictures.push(svg);
}

function pointsOf(path) {
  return (path.getAttribute("d").match(/[ML][^ML]+/g) || []).map(piece => {
    const [x, y] = piece.slice(1).split(" ").map(Number);
    return {x, y, gap: piece[0] === "M"};
  });
}

for (const axis of Object.values(axes)) {
  for (const path of axis.pictures.flatMap(svg => [...svg.querySelectorAll("path.curve")])) {
    const svg = path.ownerSVGElement, bottom = svg.viewBox.baseVal.height - 24;
    const low = Number(svg.dataset.low), high = Number(svg.dataset.high);
    axis.curves.push({name: path.dataset.name, quantity: svg.dataset.quantity, points: pointsOf(path),
      value: y => low + (bottom - y) / (bottom - TOP) * (high - low)});
  }
}
const tracks = [...document.querySelectorAll("svg.plan path.track")].map(path => ({
  points: pointsOf(path),
  dot: path.ownerSVGElement.querySelector(`circle[data-name="${CSS.escape(path.dataset.name)}"]`),
}));

function heightAt(points, x) {
  let low = 0, high = points.length - 1;
  if (!points.length || x < points[0].x || x > points[high].x) return null;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (points[middle].x <= x) low = middle; else high = middle;
  }
  const a = points[low], b = points[high];
  if (b.gap && b !== a) return x - a.x < 1 ? a.y : null;
  return b.x === a.x ? b.y : a.y + (x - a.x) / (b.x - a.x) * (b.y - a.y);
}

function moveTo(axis, value) {
  const at = Math.min(Math.max(value, axis.from), axis.to);
  const share = (at - axis.from) / (axis.to - axis.from), x = LEFT + share * (RIGHT - LEFT);
  for (const svg of axis.pictures) {
    svg.classList.add("moved");
    for (const line of svg.querySelectorAll("line.cursor")) {
      line.setAttribute("x1", x);
      line.setAttribute("x2", x);
    }
  }
  if (axis.name === "time") moveDots(share);
  show(axis, at, x);
}

function moveDots(share) {
  for (const {points, dot} of tracks) {
    const place = share * (points.length - 1), row = Math.floor(place);
    const a = points[row], b = points[Math.min(row + 1, points.length - 1)], rest = place - row;
    dot.setAttribute("cx", a.x + rest * (b.x - a.x));
    dot.setAttribute("cy", a.y + rest * (b.y - a.y));
  }
}

function show(axis, at, x) {
  const quantities = [...new Set(axis.curves.map(curve => curve.quantity))];
  const section = document.getElementById(`over-${axis.name}`);
  const names = [...section.querySelectorAll(":scope > .legend .key")].map(key => key.textContent);
  const table = document.createElement("table");
  const head = table.insertRow();
  for (const text of [`${at.toFixed(axis.name === "place" ? 1 : 2)} ${UNITS[axis.name]}`, ...names]) {
    head.appendChild(document.createElement("th")).textContent = text;
  }
  for (const quantity of quantities) {
    const row = table.insertRow();
    row.appendChild(document.createElement("th")).textContent = NAMES[quantity] || quantity;
    for (const name of names) {
      const curve = axis.curves.find(one => one.name === name && one.quantity === quantity);
      const y = curve ? heightAt(curve.points, x) : null;
      row.insertCell().textContent = y === null ? "–" : curve.value(y).toFixed(2).replace("-0.00", "0.00");
    }
  }
  section.querySelector(".readout").replaceChildren(table);
}

for (const axis of Object.values(axes)) {
  for (const svg of axis.pictures.filter(one => !one.classList.contains("plan"))) {
    svg.addEventListener("pointermove", event => {
      const box = svg.getBoundingClientRect();
      const x = (event.clientX - box.left) / box.width * 900;
      moveTo(axis, axis.from + (x - LEFT) / (RIGHT - LEFT) * (axis.to - axis.from));
    });
  }
}
for (const button of document.querySelectorAll("button.at")) {
  button.addEventListener("click", () => {
    if (!axes.time) return;
    moveTo(axes.time, Number(button.dataset.at));
    document.getElementById("over-time").scrollIntoView({behavior: "smooth"});
  });
}
for (const code of document.querySelectorAll("code")) {
  code.title = "copy";
  code.addEventListener("click", () => {
    if (!navigator.clipboard) return;
    navigator.clipboard.writeText(code.textContent).then(() => {
      code.classList.add("copied");
      setTimeout(() => code.classList.remove("copied"), 800);
    }, () => undefined);
  });
}
