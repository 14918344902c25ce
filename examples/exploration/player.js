// The player of a page: a play button, a slider, strips that are clicked.
// Purpose: `soterPlayer` moves through times and has them shown; `soterLatest` finds what counts at one.
// Non-goals: what is shown at a time (`replay.js`, scripts of examples).
"use strict";

// The last entry whose time is not later than t: its index, -1 before the first. `of`: the time of an entry.
function soterLatest(list, t, of = (x) => x) {
  let [low, high] = [0, list.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    of(list[middle]) <= t ? (low = middle + 1) : (high = middle);
  }
  return low - 1;
}

// Times are s, from 0 to `end`. show(t, clock, plays): `clock`: ms; `plays`: t follows the time that was shown before.
// Gives `go`, which stops and shows a time.
function soterPlayer(player, end, show) {
  const [play, slider, pace] = [".play", "input", "select"].map((what) => player.querySelector(what));
  let now = 0;
  let last = null; // the clock's ms at the frame before, while it plays

  function move(t, clock, plays) {
    now = Math.min(Math.max(t, 0), end);
    slider.value = now;
    player.style.setProperty("--at", end ? now / end : 0);
    show(now, clock, plays);
  }

  function stop() {
    last = null;
    play.textContent = "▶";
    play.setAttribute("aria-label", "play");
  }

  function go(t) {
    stop();
    move(t, performance.now(), false);
  }

  function frame(clock) {
    if (last === null) {
      return;
    }
    const next = now + ((clock - last) / 1000) * Number(pace.value);
    last = clock;
    move(next, clock, true);
    if (now >= end) {
      stop();
      return;
    }
    window.requestAnimationFrame(frame);
  }

  play.addEventListener("click", () => {
    if (last !== null) {
      go(now);
      return;
    }
    if (now >= end) {
      go(0);
    }
    last = performance.now();
    play.textContent = "❚❚";
    play.setAttribute("aria-label", "pause");
    window.requestAnimationFrame(frame);
  });
  slider.addEventListener("input", () => go(Number(slider.value)));
  for (const strip of player.querySelectorAll(".strip")) {
    strip.addEventListener("click", (event) => {
      const area = strip.getBoundingClientRect();
      go(((event.clientX - area.left) / area.width) * end);
    });
  }
  return go;
}
