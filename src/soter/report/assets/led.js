// Draws where SC would lead from the look of a decision module that its slider is at.
// Purpose: boxes in the plane of the first two states, and of each state over the time to come.
// Non-goals: computing boxes; the page has them.
"use strict";

(() => {
  const WIDTH = 460;
  const [LEFT, RIGHT, TOP, BOTTOM] = [58, 10, 16, 34];
  const COLOURS = ["var(--muted)", "var(--sc)", "var(--bad)"];
  const FAILED = 2;

  // A drawing with axes: `x`, `y` are [low, high, name].
  function axes(x, y, height, equal, inside) {
    const [w, h] = [WIDTH - LEFT - RIGHT, height - TOP - BOTTOM];
    const one = equal ? Math.min(w / (x[1] - x[0]), h / (y[1] - y[0])) : 0;
    const sx = one || w / (x[1] - x[0]);
    const sy = one || h / (y[1] - y[0]);
    const px = (v) => LEFT + (v - x[0]) * sx;
    const py = (v) => height - BOTTOM - (v - y[0]) * sy;
    const digits = (a) => Math.max(0, Math.min(6, 2 - Math.floor(Math.log10(a[1] - a[0]))));
    const label = (v, a) => v.toFixed(digits(a)).replace("-", "−");
    const [right, top] = [px(x[1]), py(y[1])];
    const text = (tx, ty, anchor, what) =>
      `<text x="${tx}" y="${ty}" text-anchor="${anchor}" font-size="12" fill="var(--muted)">${what}</text>`;
    const clip = `led-${(axes.count = (axes.count ?? 0) + 1)}`;
    return (
      `<svg viewBox="0 0 ${WIDTH} ${height}" role="img" aria-label="${y[2]} over ${x[2]}" ` +
      `style="width:100%;max-width:${WIDTH}px;flex:1 1 300px"><clipPath id="${clip}"><rect x="${LEFT}" y="${top}" ` +
      `width="${right - LEFT}" height="${height - BOTTOM - top}"/></clipPath>` +
      `<g clip-path="url(#${clip})">${inside(px, py)}</g><path d="M${LEFT} ${top}V${height - BOTTOM}H${right}" ` +
      'fill="none" stroke="var(--muted)"/>' +
      text(LEFT - 5, height - BOTTOM, "end", label(y[0], y)) + text(LEFT - 5, top + 10, "end", label(y[1], y)) +
      text(LEFT, height - BOTTOM + 14, "start", label(x[0], x)) + text(right, height - BOTTOM + 14, "end", label(x[1], x)) +
      text((LEFT + right) / 2, height - BOTTOM + 26, "middle", x[2]) + text(LEFT + 6, top - 4, "start", y[2]) + "</svg>"
    );
  }

  function boxes(look, x, y, px, py) {
    const drawn = look.boxes.map((b) => {
      const [x0, x1, y0, y1] = [...x(b), ...y(b)];
      const failed = b[0] === FAILED ? 'stroke-dasharray="4 3" stroke-width="1.6"' : 'stroke-width="0.7"';
      return (
        `<rect x="${px(x0)}" y="${py(y1)}" width="${Math.max(px(x1) - px(x0), 0.5)}" ` +
        `height="${Math.max(py(y0) - py(y1), 0.5)}" fill="${COLOURS[b[0]]}" fill-opacity="0.12" ` +
        `stroke="${COLOURS[b[0]]}" ${failed}/>`
      );
    });
    return drawn.join("");
  }

  for (const figure of document.querySelectorAll("figure.led")) {
    const { names, units, scale, looks } = JSON.parse(figure.querySelector("script").textContent);
    const [chosen, told, place] = ["input", ".told", ".drawn"].map((what) => figure.querySelector(what));
    figure.style.margin = 0;
    place.style.cssText = "display:flex;flex-wrap:wrap;align-items:flex-start;gap:0 1rem";
    const of = (k) => (b) => [b[3 + 2 * k] / scale[k], b[4 + 2 * k] / scale[k]];
    const time = (b) => [b[1] / 1e3, b[2] / 1e3];
    const named = (k) => (units[k] ? `${names[k]} / ${units[k]}` : names[k]);
    // what is in sight: where it is good
    const good = looks.filter((l) => l.boxes.every((b) => b[0] !== FAILED));
    const seen = good.length ? good : looks;
    const ends = (list, at) => list.flatMap((l) => l.boxes.flatMap(at)).reduce(
      ([low, high], v) => [Math.min(low, v), Math.max(high, v)], [Infinity, -Infinity]);
    const wide = ([low, high]) => (high > low ? [low, high] : [low - 0.5, high + 0.5]);
    const until = wide(ends(seen, time));
    const span = names.map((_, k) => Math.max(...seen.map((l) => ends([l], of(k))).map(([low, high]) => high - low)));
    const middle = (l, k) => (of(k)(l.boxes[0])[0] + of(k)(l.boxes[0])[1]) / 2;
    const alike = units[0] === units[1] && span[0] < 3 * span[1] && span[1] < 3 * span[0];
    // as much of a state at every look; what fits is in the middle, and the estimate always in sight
    function near(look, k, more) {
      const [low, high] = ends([look], of(k));
      const room = Math.max(span[k], 1e-9) * more;
      const half = 0.48 * room;
      const centre = Math.min(Math.max((low + high) / 2, middle(look, k) - half), middle(look, k) + half);
      return [centre - room / 2, centre + room / 2];
    }
    function draw() {
      const look = looks[Number(chosen.value)];
      told.innerHTML = `Look at ${look.t.toFixed(3)} s: ${look.told}`;
      const drawings = [];
      if (names.length > 1) {
        drawings.push(axes([...near(look, 0, 1.3), named(0)], [...near(look, 1, 1.3), named(1)], 330, alike, (px, py) => {
          const way = looks.map((l) => `${px(middle(l, 0))},${py(middle(l, 1))}`).join(" ");
          return `<polyline points="${way}" fill="none" stroke="var(--muted)" stroke-opacity="0.4"/>` +
            boxes(look, of(0), of(1), px, py);
        }));
      }
      const bands = names.map((_, k) => {
        return axes([0, until[1], "s from the estimate on"], [...near(look, k, 1.05), named(k)], 110, false, (px, py) =>
          boxes(look, time, of(k), px, py));
      });
      place.innerHTML = `${drawings.join("")}<div style="flex:1 1 300px">${bands.join("")}</div>`;
    }
    chosen.addEventListener("input", draw);
    draw();
  }
})();
