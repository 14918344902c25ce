// The playground: Soter in Pyodide, from what this file carries; no request is ever made.
// Purpose: unpack, ask `soter.playground.session`, show; a run is drawn while it goes on.
// Non-goals: knowing anything of the language.
"use strict";

const $ = (id) => document.getElementById(id);
const SLICE_S = 0.04;
const KEPT = "soter-playground";
let session; // the Python module
let running = 0;

async function unpacked(name) {
  const text = $("packed-" + name).textContent;
  const bytes = Uint8Array.fromBase64 ? Uint8Array.fromBase64(text) : byBytes(atob(text));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function byBytes(text) {
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) {
    bytes[i] = text.charCodeAt(i);
  }
  return bytes;
}

// Where the time goes until the page is ready, in s: for those who measure it.
const marks = (window.soterMarks = {});
const mark = (name) => (marks[name] = (performance.now() / 1000).toFixed(2));

const script = (bytes) => URL.createObjectURL(new Blob([bytes], { type: "text/javascript" }));

// Pyodide asks for its files by address: they are handed over here.
async function load() {
  const [wasm, stdlib, asm, main, lock, soter] = await Promise.all(
    ["wasm", "stdlib", "asm", "pyodide", "lock", "soter"].map(unpacked)
  );
  const files = { "pyodide.asm.wasm": [wasm, "application/wasm"], "python_stdlib.zip": [stdlib, "application/zip"] };
  window.fetch = async (address) => {
    const name = String(address.url ?? address).split("/").pop();
    if (!(name in files)) {
      throw new Error("this page makes no requests: " + name);
    }
    return new Response(files[name][0], { headers: { "Content-Type": files[name][1] } });
  };
  mark("unpacked");
  const { default: createPyodideModule } = await import(script(asm));
  const { loadPyodide } = await import(script(main));
  const python = await loadPyodide({
    indexURL: "blob:here/",
    createPyodideModule,
    lockFileContents: JSON.parse(new TextDecoder().decode(lock)),
  });
  mark("python");
  python.unpackArchive(soter, "zip", { extractDir: "/soter" });
  python.runPython("import sys; sys.path.insert(0, '/soter')");
  python.FS.chdir("/soter/examples");
  session = python.pyimport("soter.playground.session");
  mark("soter");
  window.soterFile = (name) => python.FS.readFile("/soter/examples/" + name, { encoding: "utf8" });
}

function path() {
  return "/soter/examples/" + ($("example").value || "mine.soter");
}

function tell(text, good = false) {
  $("told").textContent = text;
  $("told").className = good ? "good" : "";
}

function check() {
  const found = JSON.parse(session.check(path(), $("program").value));
  $("picture").innerHTML = found.svg ?? ""; // Soter's own drawing, in which every name is escaped
  const before = $("system").value;
  $("system").replaceChildren(...found.systems.map((name) => new Option(name, name)));
  $("system").value = found.systems.includes(before) ? before : found.default ?? "";
  const sound = found.systems.length ? "ok: " + found.systems.join(", ") : "ok";
  tell(found.text || sound, found.ok && !found.text);
  return found.ok;
}

function format() {
  const found = JSON.parse(session.layout(path(), $("program").value));
  if (found.ok) {
    $("program").value = found.program;
  }
  tell(found.text || "laid out", found.ok);
}

function explain(code) {
  tell(JSON.parse(session.explain(code || "P1a")).page);
}

// ---------------------------------------------------------------- a run

async function run() {
  const mine = ++running;
  $("events").replaceChildren();
  $("chart").replaceChildren();
  if (!check()) {
    return;
  }
  const started = session.start(path(), $("program").value, $("system").value, BigInt($("seed").value || 1));
  if (typeof started === "string") {
    tell(started);
    return;
  }
  const about = JSON.parse(started.about());
  const rows = [];
  let draws = 0;
  for (;;) {
    const found = JSON.parse(started.advance(SLICE_S));
    rows.push(...found.rows);
    found.events.forEach(note);
    const at = found.time_s.toFixed(2) + " s of " + about.until;
    const broken = found.violations ? found.violations + " violated" : "no violation";
    const what = `${about.system}: ${broken}, ${at}, seed ${$("seed").value}`;
    tell([what + (found.done ? "" : " …"), ...about.notes].join("\n"), found.done && !found.violations);
    if (found.done || draws++ % 3 === 0) {
      draw(about, rows);
    }
    await new Promise((resume) => setTimeout(resume));
    if (found.done || mine !== running) {
      light(about, rows.at(-1));
      started.destroy();
      document.body.dataset.ran = String(found.violations);
      return;
    }
    light(about, rows.at(-1));
  }
}

function note(event) {
  const line = document.createElement("li");
  line.textContent = `${event.time_s.toFixed(3)} s  ${event.what}  ${event.why}`;
  line.className = event.bad ? "bad" : "";
  $("events").append(line);
}

// Who is in control, on the diagram.
function light(about, row) {
  about.modules.forEach((module, i) => {
    for (const box of $("picture").querySelectorAll("[data-component]")) {
      const name = box.dataset.component;
      if (name === module.ac || name === module.sc) {
        box.classList.toggle("on", row !== undefined && row[1][i] === Number(name === module.ac));
      }
    }
  });
}

const WIDTH = 640, LEFT = 56, PANEL = 84, GAP = 24, BAND = 12;

function shape(name, attributes, text) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) {
    made.setAttribute(key, value);
  }
  if (text !== undefined) {
    made.textContent = text;
  }
  return made;
}

function draw(about, rows) {
  const bands = about.modules.length * (BAND + 18);
  const height = bands + about.signals.length * (PANEL + GAP) + 24;
  const svg = shape("svg", { viewBox: `0 0 ${WIDTH} ${height}`, role: "img", "aria-label": "signals over time" });
  const x = (t) => LEFT + ((WIDTH - LEFT - 6) * Math.max(t, 0)) / about.until_s;
  about.modules.forEach((module, i) => {
    const top = i * (BAND + 18) + 14;
    svg.append(shape("text", { x: LEFT, y: top - 3 }, module.name));
    let from = 0;
    for (let k = 1; k <= rows.length; k++) {
      if (k === rows.length || rows[k][1][i] !== rows[from][1][i]) {
        const end = x(rows[Math.min(k, rows.length - 1)][0]);
        const start = x(rows[from][0]);
        svg.append(shape("rect", { x: start, y: top, width: Math.max(end - start, 0), height: BAND, class: rows[from][1][i] ? "ac" : "sc" }));
        from = k;
      }
    }
  });
  about.signals.forEach((signal, i) => {
    const top = bands + i * (PANEL + GAP) + 16;
    const values = rows.map((row) => row[2][i]).filter((v) => v !== null);
    let low = Math.min(...values), high = Math.max(...values);
    const near = signal.limits.filter((v) => high - low >= (Math.max(high, v) - Math.min(low, v)) / 20);
    low = Math.min(low, ...near);
    high = Math.max(high, ...near);
    if (!(high > low)) {
      low -= 1;
      high += 1;
    }
    const y = (v) => top + PANEL - (PANEL * (v - low)) / (high - low);
    svg.append(shape("rect", { x: LEFT, y: top, width: WIDTH - LEFT - 6, height: PANEL, class: "frame" }));
    svg.append(shape("text", { x: LEFT, y: top - 4 }, signal.name + (signal.unit ? " / " + signal.unit : "")));
    for (const v of [low, high]) {
      svg.append(shape("text", { x: LEFT - 5, y: y(v) + 4, "text-anchor": "end" }, Number(v.toPrecision(3)).toString()));
    }
    for (const v of near) {
      svg.append(shape("line", { x1: LEFT, x2: WIDTH - 6, y1: y(v), y2: y(v), class: "limit" }));
    }
    const points = rows.map((row) => (row[2][i] === null ? "" : `${x(row[0]).toFixed(1)},${y(row[2][i]).toFixed(1)}`));
    svg.append(shape("polyline", { points: points.join(" "), class: "line" }));
  });
  const below = height - 6;
  svg.append(shape("text", { x: LEFT, y: below }, "0"));
  svg.append(shape("text", { x: WIDTH - 6, y: below, "text-anchor": "end" }, "time / s: " + about.until_s));
  $("chart").replaceChildren(svg);
}

// ---------------------------------------------------------------- the page

function guarded(what) {
  return async (event) => {
    event?.preventDefault?.();
    try {
      await what();
    } catch (error) {
      tell("this page failed: " + error);
    }
  };
}

(async () => {
  const began = performance.now();
  $("example").replaceChildren(...EXAMPLES.map((name) => new Option(name.replace(".soter", ""), name)));
  $("example").value = EXAMPLES.find((name) => name.endsWith("cart.soter")) ?? EXAMPLES[0];
  const controls = document.querySelectorAll("button");
  controls.forEach((b) => (b.disabled = true));
  try {
    await load();
  } catch (error) {
    $("state").textContent = "this browser cannot run the page: " + error;
    return;
  }
  controls.forEach((b) => (b.disabled = false));
  const show = () => {
    running++;
    $("program").value = window.soterFile($("example").value);
    $("chart").replaceChildren();
    $("events").replaceChildren();
    check();
  };
  $("example").addEventListener("change", guarded(show));
  $("check").addEventListener("click", guarded(check));
  $("format").addEventListener("click", guarded(format));
  $("run").addEventListener("click", guarded(run));
  $("explain").addEventListener("submit", guarded(() => explain($("code").value)));
  show();
  mark("checked");
  $("state").textContent = "ready after " + ((performance.now() - began) / 1000).toFixed(1) + " s, offline";
  document.body.dataset.ready = "yes";
  if (location.hash === "#run") {
    await guarded(run)();
    document.body.dataset.took = (performance.now() / 1000).toFixed(2);
  }
})();
