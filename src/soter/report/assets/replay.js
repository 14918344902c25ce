// Replays a run on the diagram of its program: values, who is in control, who steps.
// Purpose: what the program shows at a time, steps from instant to instant.
// Non-goals: the player (`player.js`), time lines. Everything comes ready from Python; figures lend what they drew.
"use strict";

(() => {
  const data = document.getElementById("live");
  if (!data) {
    return;
  }
  const live = JSON.parse(data.textContent);
  const figures = soterFigures();
  const player = document.querySelector(".player");
  const shown = player.querySelector("output");
  const END = Math.round(live.end * 1e9);
  const LIT_MS = 150;
  let now = 0; // ns of the run

  const boxes = (kind, name) =>
    [...document.querySelectorAll(`.program [data-${kind}]`)].filter((e) => e.dataset[kind].split(" ").includes(name));
  const texts = (key) => [...document.querySelectorAll(".program [data-value]")].filter((e) => e.dataset.value === key);

  // Rows of values. A signal that a time line draws is read from there.
  const grid = soterUnpacked(live.grid);
  function columns(row) {
    if (row.drawn) {
      return row.drawn.map(([figure, trace]) => ({ t: figures[figure].data[trace].x, v: figures[figure].data[trace].y }));
    }
    const t = row.t === undefined ? grid : soterUnpacked(row.t);
    return row.v.map((v) => ({ t, v: soterUnpacked(v) }));
  }
  const rows = live.values.map((row) => ({ ...row, columns: columns(row), places: texts(row.key) }));
  function written(row, value) {
    if (value === null || value === undefined) {
      return "–";
    }
    if (row.words) {
      return row.words[value] ?? String(value);
    }
    return (row.digits === null ? value.toExponential(2) : value.toFixed(row.digits)).replace("-", "−");
  }

  const control = live.control.map((c) => ({
    ...c,
    acs: boxes("component", c.ac),
    scs: boxes("component", c.sc),
    places: texts(c.key),
  }));

  const steps = live.steps.map((s) => ({ ...s, places: boxes("component", s.of), lit: 0 }));
  const upTo = (s, t) => Math.min(t, s.until ?? END, END);
  // How many steps there have been, the one at t among them.
  function count(s, t) {
    const end = upTo(s, t);
    return s.at ? soterLatest(s.at, end) + 1 : end < s.phase ? 0 : Math.floor((end - s.phase) / s.period) + 1;
  }
  const nth = (s, n) => (s.at ? s.at[n] : s.phase + n * s.period);
  const after = (s, t) => {
    const next = nth(s, count(s, t));
    return next !== undefined && next > t && next <= upTo(s, END) ? next : Infinity;
  };
  const before = (s, t) => {
    const n = count(s, t - 1);
    return n > 0 ? nth(s, n - 1) : -Infinity;
  };

  function show(seconds, clock, plays) {
    const ns = Math.round(seconds * 1e9);
    const from = plays ? now : ns - 1;
    now = ns;
    const t = seconds + 1e-9;
    shown.textContent = seconds.toFixed(live.end < 100 ? 3 : 2) + " s";
    for (const row of rows) {
      const values = row.columns.map(({ t: times, v }) => {
        const at = soterLatest(times, t + 5e-5);
        return at < 0 ? null : v[at];
      });
      const text = `${row.label} ${values.map((v) => written(row, v)).join(", ")} ${row.unit}`.trim();
      row.places.forEach((e) => (e.textContent = text));
    }
    for (const c of control) {
      const mode = c.modes[soterLatest(c.modes, t + 5e-5, ([since]) => since)]?.[1];
      c.acs.forEach((e) => e.classList.toggle("on", mode === 1));
      c.scs.forEach((e) => e.classList.toggle("on", mode === 0));
      const saw = c.saw[soterLatest(c.saw, t + 5e-5, ([since]) => since)]?.[1] ?? "";
      c.places.forEach((e) => (e.textContent = saw));
    }
    for (const s of steps) {
      if (count(s, now) > count(s, from)) {
        s.lit = clock;
      }
      const on = plays ? clock - s.lit < LIT_MS : s.lit === clock;
      s.places.forEach((e) => e.classList.toggle("step", on && s.lit > 0));
    }
  }

  const go = soterPlayer(player, END / 1e9, show);
  player.querySelector(".next").addEventListener("click", () => {
    go(Math.min(...steps.map((s) => after(s, now)), END) / 1e9);
  });
  player.querySelector(".back").addEventListener("click", () => {
    go(Math.max(...steps.map((s) => before(s, now)), 0) / 1e9);
  });
  go(0);

  // A diagram wider than the window begins at its topmost box.
  const drawing = document.querySelector(".program .scroll");
  const placed = (e) => e.getBoundingClientRect();
  const [top] = [...drawing.querySelectorAll("[data-component]")].sort((a, b) => placed(a).top - placed(b).top);
  if (top && placed(top).right > placed(drawing).right) {
    const box = placed(top);
    drawing.scrollLeft = box.left + box.width / 2 - placed(drawing).left - drawing.clientWidth / 2;
  }
})();
