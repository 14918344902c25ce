// Replays an exploration: which cells were known, where the vehicle was, who was in control.
// Purpose: a canvas; `window.exploredAt(t)` tells tests what is shown.
// Non-goals: the player (`player.js`); the still picture, the strips over time: Python drew them.
"use strict";

(() => {
  const run = JSON.parse(document.getElementById("explored").textContent);
  const { n, cell, x0, y0, home } = run.grid;
  const root = document.documentElement;
  root.classList.add("scripted");
  const canvas = document.getElementById("map");
  const reading = document.getElementById("reading");
  const player = document.querySelector(".explored .player");
  const NEW_MS = 1000; // for so long a cell is drawn as new
  const DOTS = run.decisions.length > 160 ? 1.8 : run.decisions.length > 48 ? 2.8 : 4; // px

  const bytes = Uint8Array.from(atob(run.known), (c) => c.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  const known = Array.from({ length: n * n }, (_, k) => view.getUint32(4 * k, true));
  const sorted = known.filter((ms) => ms !== run.never).sort((a, b) => a - b);
  const age = known.map((ms) => run.ages.findIndex((limit) => ms <= limit));
  const path = Object.fromEntries(Object.entries(run.path).map(([name, list]) => [name, soterUnpacked(list)]));

  // How many of the first entries are not later than t.
  const count = (list, t, of) => soterLatest(list, t, of) + 1;
  const latest = (rows, t) => rows[soterLatest(rows, t, ([since]) => since)];

  function shownAt(t) {
    const upTo = t + 1e-6;
    const at = Math.max(soterLatest(path.t, upTo), 0);
    return {
      known: count(sorted, 1000 * upTo) / (n * n),
      ac: path.ac[at] === 1,
      speed: path.v[at],
      at,
      decisions: count(run.decisions, upTo, ([since]) => since),
      box: latest(run.flown, upTo)?.[1] ?? [],
      corridor: latest(run.corridors, upTo)?.[1] ?? [],
      goal: latest(run.next, upTo)?.[1],
    };
  }
  window.exploredAt = shownAt;

  // ---------------------------------------------------------------- colours
  const probe = document.createElement("span");
  let colours = {};
  function readColours() {
    document.body.append(probe);
    const names = ["unknown", "hidden", "new", "ink", "paper", "ac", "sc", "takeover", "giveback", "bad", "muted"];
    for (const name of [...names, ...run.ages.map((_, k) => `known-${k}`)]) {
      probe.style.color = `var(--${name})`;
      colours[name] = getComputedStyle(probe).color;
    }
    probe.remove();
    hatch = hatched();
  }

  let hatch = null;
  function hatched() {
    const tile = document.createElement("canvas");
    tile.width = tile.height = 8;
    const pen = tile.getContext("2d");
    pen.strokeStyle = colours.hidden;
    pen.lineWidth = 2.5;
    for (const from of [-8, 0, 8]) {
      pen.beginPath();
      pen.moveTo(from, 8);
      pen.lineTo(from + 8, 0);
      pen.stroke();
    }
    return pen.createPattern(tile, "repeat");
  }

  // ---------------------------------------------------------------- drawing
  const pen = canvas.getContext("2d");
  const cells = document.createElement("canvas");
  cells.width = cells.height = n;
  let scale = 1; // px a metre
  let size = 0; // px, of the square
  const place = (x, y) => [(x - x0) * scale, size - (y - y0) * scale];

  function drawCells(ms) {
    const ground = cells.getContext("2d");
    ground.fillStyle = colours.unknown;
    ground.fillRect(0, 0, n, n);
    let colour = null;
    for (let k = 0; k < n * n; k += 1) {
      if (known[k] > ms) {
        continue;
      }
      const next = known[k] > 0 && ms - known[k] < NEW_MS && ms < 1000 * run.end ? "new" : `known-${age[k]}`;
      if (next !== colour) {
        ground.fillStyle = colours[next];
        colour = next;
      }
      ground.fillRect(Math.floor(k / n), n - 1 - (k % n), 1, 1);
    }
    pen.imageSmoothingEnabled = false;
    pen.drawImage(cells, 0, 0, size, size);
  }

  function outline(points, style) {
    pen.setLineDash(style.dash ?? []);
    pen.lineWidth = style.width ?? 1.1;
    pen.strokeStyle = style.stroke;
    pen.beginPath();
    points.forEach(([x, y]) => pen.lineTo(...place(x, y)));
    pen.closePath();
    if (style.fill) {
      pen.fillStyle = style.fill;
      pen.fill();
    }
    pen.stroke();
    pen.setLineDash([]);
  }
  const box = ([a, b, c, d], style) => outline([[a, b], [c, b], [c, d], [a, d]], style);

  function drawPath(last) {
    let k = 0;
    while (k < last) {
      const ac = path.ac[k];
      pen.strokeStyle = ac ? colours.ac : colours.sc;
      pen.lineWidth = ac ? 2.2 : 2.6;
      pen.beginPath();
      pen.moveTo(...place(path.x[k], path.y[k]));
      do {
        k += 1;
        pen.lineTo(...place(path.x[k], path.y[k]));
      } while (k < last && path.ac[k] === ac);
      pen.stroke();
    }
  }

  function dot(x, y, radius, fill, stroke, width) {
    pen.beginPath();
    pen.arc(...place(x, y), radius, 0, 2 * Math.PI);
    pen.fillStyle = fill;
    pen.fill();
    pen.strokeStyle = stroke;
    pen.lineWidth = width;
    pen.stroke();
  }

  // Many that lie close together have one outline.
  function dots(decided, inside, around) {
    for (const [colour, radius] of [[around, DOTS + 1.2], [inside, DOTS - 0.5]]) {
      pen.fillStyle = colour;
      pen.beginPath();
      for (const [, , x, y] of decided) {
        const [a, b] = place(x, y);
        pen.moveTo(a + radius, b);
        pen.arc(a, b, radius, 0, 2 * Math.PI);
      }
      pen.fill();
    }
  }

  function cross(x, y, arm, colour) {
    const [a, b] = place(x, y);
    pen.strokeStyle = colour;
    pen.lineWidth = 2.4;
    pen.beginPath();
    pen.moveTo(a - arm, b - arm);
    pen.lineTo(a + arm, b + arm);
    pen.moveTo(a - arm, b + arm);
    pen.lineTo(a + arm, b - arm);
    pen.stroke();
  }

  function drawMarks(t, now) {
    const decided = run.decisions.slice(0, now.decisions);
    dots(decided.filter(([, to]) => to === "AC"), colours.paper, colours.giveback);
    dots(decided.filter(([, to]) => to === "SC"), colours.takeover, colours.paper);
    run.violations.filter(([since]) => since <= t + 1e-6).forEach(([, x, y]) => cross(x, y, 7, colours.bad));
    pen.font = `600 13px ${getComputedStyle(document.body).fontFamily}`;
    pen.textAlign = "center";
    run.goals.forEach(([x, y], k) => {
      const [a, b] = place(x, y);
      cross(x, y, 5, k === now.goal ? colours.takeover : colours.ink);
      pen.lineWidth = 3;
      pen.strokeStyle = colours.paper;
      pen.strokeText(`${k + 1}`, a, b - 9);
      pen.fillStyle = colours.ink;
      pen.fillText(`${k + 1}`, a, b - 9);
    });
    dot(path.x[now.at], path.y[now.at], 6, colours.ink, colours.paper, 1.5);
  }

  let drawn = run.end; // s
  function draw(t) {
    const now = shownAt(t);
    drawn = t;
    drawCells(1000 * (t + 1e-6));
    run.walls.forEach((wall) => outline(wall, { fill: hatch, stroke: colours.hidden, dash: [5, 3] }));
    now.corridor.forEach((b) => box(b, { stroke: colours.ink, dash: [2, 3] }));
    now.box.forEach((b) => box(b, { stroke: colours.ink, width: 2 }));
    const [hx, hy] = place(...home);
    pen.fillStyle = colours.giveback;
    pen.fillRect(hx - 6, hy - 6, 12, 12);
    drawPath(now.at);
    drawMarks(t, now);
    const goal = now.goal < run.goals.length ? ` · to goal ${now.goal + 1}` : "";
    reading.textContent =
      `${t.toFixed(1)} s · ${(100 * now.known).toFixed(1)} % known · ${now.ac ? "AC" : "SC"} in control · ` +
      `${now.speed.toFixed(1)} m/s${goal}`;
    player.querySelector("input").setAttribute("aria-valuetext", reading.textContent);
    for (const line of document.querySelectorAll(".explored .now")) {
      const x = Number(line.dataset.left) + t * Number(line.dataset.scale);
      line.setAttribute("x1", x);
      line.setAttribute("x2", x);
    }
  }

  // ---------------------------------------------------------------- what moves it
  const go = soterPlayer(player, run.end, draw);
  for (const strip of document.querySelectorAll(".explored .seek")) {
    strip.addEventListener("click", (event) => {
      const svg = strip.querySelector("svg");
      const line = svg.querySelector(".now");
      const area = svg.getBoundingClientRect();
      const x = ((event.clientX - area.left) / area.width) * svg.viewBox.baseVal.width;
      go((x - Number(line.dataset.left)) / Number(line.dataset.scale));
    });
  }

  function fit() {
    const ratio = window.devicePixelRatio || 1;
    size = canvas.clientWidth;
    scale = size / (n * cell);
    canvas.width = canvas.height = Math.round(size * ratio);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    readColours();
    draw(drawn);
  }
  window.addEventListener("resize", fit);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", fit);
  // Paper is white.
  window.addEventListener("beforeprint", () => root.classList.add("on-paper"));
  window.addEventListener("afterprint", () => {
    root.classList.remove("on-paper");
    fit();
  });
  fit();
  go(run.end);
})();
