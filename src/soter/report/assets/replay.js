// Replays a run on the diagram of its program: values, who is in control, who steps.
// Purpose: a slider, a play button, steps from instant to instant; `window.soterMoment` for tests.
// Non-goals: time lines. Everything comes ready from Python; figures lend the numbers they drew.
"use strict";

(() => {
  const data = document.getElementById("live");
  if (!data) {
    return;
  }
  const live = JSON.parse(data.textContent);
  const figures = soterFigures();
  const player = document.querySelector(".player");
  const slider = document.getElementById("moment");
  const [shown, play] = [player.querySelector("output"), player.querySelector(".play")];
  const speed = player.querySelector("select");
  const END = Math.round(live.end * 1e9);
  const LIT_MS = 150;
  let now = 0; // ns of the run
  let last = null; // the clock's ms at the frame before, while it plays

  const boxes = (kind, name) =>
    [...document.querySelectorAll(`.program [data-${kind}]`)].filter((e) => e.dataset[kind].split(" ").includes(name));
  const texts = (key) => [...document.querySelectorAll(".program [data-value]")].filter((e) => e.dataset.value === key);

  // The last entry whose time is not later: its index, -1 before the first.
  function latest(times, t, of = (x) => x) {
    let [low, high] = [0, times.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      of(times[middle]) <= t ? (low = middle + 1) : (high = middle);
    }
    return low - 1;
  }

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
    return s.at ? latest(s.at, end) + 1 : end < s.phase ? 0 : Math.floor((end - s.phase) / s.period) + 1;
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

  function show(from, clock) {
    const t = now / 1e9 + 1e-9;
    slider.value = now / 1e9;
    shown.textContent = (now / 1e9).toFixed(live.end < 100 ? 3 : 2) + " s";
    player.style.setProperty("--at", END ? now / END : 0);
    for (const row of rows) {
      const values = row.columns.map(({ t: times, v }) => {
        const at = latest(times, t + 5e-5);
        return at < 0 ? null : v[at];
      });
      const text = `${row.label} ${values.map((v) => written(row, v)).join(", ")} ${row.unit}`.trim();
      row.places.forEach((e) => (e.textContent = text));
    }
    for (const c of control) {
      const mode = c.modes[latest(c.modes, t + 5e-5, ([since]) => since)]?.[1];
      c.acs.forEach((e) => e.classList.toggle("on", mode === 1));
      c.scs.forEach((e) => e.classList.toggle("on", mode === 0));
      const saw = c.saw[latest(c.saw, t + 5e-5, ([since]) => since)]?.[1] ?? "";
      c.places.forEach((e) => (e.textContent = saw));
    }
    for (const s of steps) {
      if (count(s, now) > count(s, from)) {
        s.lit = clock;
      }
      const on = last === null ? s.lit === clock : clock - s.lit < LIT_MS;
      s.places.forEach((e) => e.classList.toggle("step", on && s.lit > 0));
    }
  }

  function go(to) {
    now = Math.min(Math.max(to, 0), END);
    show(now - 1, performance.now());
  }

  function stop() {
    last = null;
    play.textContent = "▶";
    play.setAttribute("aria-label", "play");
  }

  function frame(clock) {
    if (last === null) {
      return;
    }
    const from = now;
    now = Math.min(now + (clock - last) * 1e6 * Number(speed.value), END);
    last = clock;
    show(from, clock);
    if (now >= END) {
      stop();
      return;
    }
    window.requestAnimationFrame(frame);
  }

  play.addEventListener("click", () => {
    if (last !== null) {
      stop();
      go(now);
      return;
    }
    if (now >= END) {
      now = 0;
    }
    last = performance.now();
    play.textContent = "❚❚";
    play.setAttribute("aria-label", "pause");
    window.requestAnimationFrame(frame);
  });
  slider.addEventListener("input", () => {
    stop();
    go(Math.round(Number(slider.value) * 1e9));
  });
  player.querySelector(".next").addEventListener("click", () => {
    stop();
    go(Math.min(...steps.map((s) => after(s, now)), END));
  });
  player.querySelector(".back").addEventListener("click", () => {
    stop();
    go(Math.max(...steps.map((s) => before(s, now)), 0));
  });
  for (const strip of player.querySelectorAll(".strip")) {
    strip.addEventListener("click", (event) => {
      stop();
      const box = strip.getBoundingClientRect();
      go(Math.round(((event.clientX - box.left) / box.width) * END));
    });
  }
  go(0);
})();
