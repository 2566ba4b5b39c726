"use strict";
// One cursor for all pictures: curves are read back from their paths, by the scales of their plot.
const LEFT = 58, RIGHT = 892, TOP = 8;
const NAMES = {error_m: "error, m", gap_m: "gap, m", speed_mps: "speed, m/s"};
const readout = document.getElementById("readout");
const pictures = [...document.querySelectorAll("svg[data-seconds]")];
const duration = pictures.length ? Number(pictures[0].dataset.seconds) : 0;

function pointsOf(path) {
  return (path.getAttribute("d").match(/[ML][^ML]+/g) || []).map(piece => {
    const [x, y] = piece.slice(1).split(" ").map(Number);
    return {x, y, gap: piece[0] === "M"};
  });
}

const curves = [...document.querySelectorAll("svg.plot path.curve")].map(path => {
  const svg = path.ownerSVGElement, bottom = svg.viewBox.baseVal.height - 24;
  const low = Number(svg.dataset.low), high = Number(svg.dataset.high);
  return {name: path.dataset.name, quantity: svg.dataset.quantity, points: pointsOf(path),
          value: y => low + (bottom - y) / (bottom - TOP) * (high - low)};
});
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

function moveTo(seconds) {
  const at = Math.min(Math.max(seconds, 0), duration);
  const x = LEFT + at / duration * (RIGHT - LEFT);
  document.body.classList.add("moved");
  document.querySelectorAll("line.cursor").forEach(line => {
    line.setAttribute("x1", x);
    line.setAttribute("x2", x);
  });
  for (const {points, dot} of tracks) {
    const place = at / duration * (points.length - 1), row = Math.floor(place);
    const a = points[row], b = points[Math.min(row + 1, points.length - 1)], share = place - row;
    dot.setAttribute("cx", a.x + share * (b.x - a.x));
    dot.setAttribute("cy", a.y + share * (b.y - a.y));
  }
  show(at, x);
}

function show(at, x) {
  const quantities = [...new Set(curves.map(curve => curve.quantity))];
  const names = [...document.querySelectorAll("#pictures > .legend .key")].map(key => key.textContent);
  const table = document.createElement("table");
  const head = table.insertRow();
  for (const text of [`${at.toFixed(2)} s`, ...names]) {
    head.appendChild(document.createElement("th")).textContent = text;
  }
  for (const quantity of quantities) {
    const row = table.insertRow();
    row.appendChild(document.createElement("th")).textContent = NAMES[quantity] || quantity;
    for (const name of names) {
      const curve = curves.find(one => one.name === name && one.quantity === quantity);
      const y = curve ? heightAt(curve.points, x) : null;
      row.insertCell().textContent = y === null ? "–" : curve.value(y).toFixed(2);
    }
  }
  readout.replaceChildren(table);
}

for (const svg of pictures) {
  if (svg.classList.contains("plan")) continue;
  svg.addEventListener("pointermove", event => {
    const box = svg.getBoundingClientRect();
    const x = (event.clientX - box.left) / box.width * 900;
    moveTo((x - LEFT) / (RIGHT - LEFT) * duration);
  });
}
for (const button of document.querySelectorAll("button.at")) {
  button.addEventListener("click", () => {
    moveTo(Number(button.dataset.at));
    document.getElementById("pictures").scrollIntoView({behavior: "smooth"});
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
