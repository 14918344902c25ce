// Draws the figures of a Soter report.
// Purpose: put the style sheet's colours into the figures, switch groups on and off, print.
// Non-goals: computing anything; the figures come ready from Python.
"use strict";

(() => {
  const figures = soterFigures();
  const LETTER_PX_MIN = 9;
  const buttons = [...document.querySelectorAll("button[data-group]")];
  const narrow = window.matchMedia("(max-width: 640px)");
  const coarse = window.matchMedia("(pointer: coarse)");
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const tools = {
    map: ["zoom2d", "pan2d", "resetScale2d", "toImage"],
    solid: ["resetCameraDefault3d", "toImage"],
  };

  const shown = {};
  for (const button of buttons) {
    shown[button.dataset.group] = button.getAttribute("aria-pressed") === "true";
  }

  // "@name" stands for the style sheet's --name.
  function themed(value, style) {
    if (typeof value === "string") {
      return value.startsWith("@") ? style.getPropertyValue("--" + value.slice(1)).trim() : value;
    }
    if (Array.isArray(value)) {
      return typeof value[0] === "number" ? value : value.map((item) => themed(item, style));
    }
    if (value !== null && typeof value === "object") {
      return Object.fromEntries(Object.entries(value).map(([k, v]) => [k, themed(v, style)]));
    }
    return value;
  }

  // A trace of several groups is drawn while all of them are on.
  function groups(trace) {
    return trace.group === undefined ? [] : trace.group.split(" ");
  }

  function isShown(trace) {
    return groups(trace).every((group) => shown[group] !== false);
  }

  // A metre is as long upwards as sideways, and no strip of the place stays empty.
  function mapHeight(width, layout) {
    const { l, r, t, b } = layout.margin;
    const span = (axis) => axis.range[1] - axis.range[0];
    return Math.round(((width - l - r) * span(layout.yaxis)) / span(layout.xaxis) + t + b);
  }

  // Time axes need no tools: drag to zoom, double-click to return.
  function config(key) {
    return {
      displaylogo: false,
      displayModeBar: key in tools && !narrow.matches ? "hover" : false,
      modeBarButtons: key in tools ? [tools[key]] : [],
      toImageButtonOptions: { format: key === "solid" ? "png" : "svg", filename: "soter-" + key },
    };
  }

  // The name of a panel is written smaller where the window is narrower than it, and then without its first parts.
  const pen = document.createElement("canvas").getContext("2d");
  function fitted(note, width) {
    if (note.xref !== "paper" || note.x !== 0) {
      return note;
    }
    pen.font = `${note.font.size}px Verdana, DejaVu Sans, sans-serif`;
    let text = note.text;
    const sized = () => note.font.size * Math.min(1, width / pen.measureText(text).width);
    while (sized() < LETTER_PX_MIN && /^[^ .]*\./.test(text)) {
      text = "…" + text.replace(/^[^ .]*\./, "");
    }
    return { ...note, text, font: { ...note.font, size: Math.max(LETTER_PX_MIN, sized()) } };
  }

  function draw(figure) {
    const place = document.getElementById("figure-" + figure.key);
    if (place.clientWidth === 0) {
      return; // folded
    }
    const style = window.getComputedStyle(document.documentElement);
    const data = figure.data.map((trace) => {
      const { group, ...rest } = themed(trace, style);
      return { ...rest, visible: isShown(trace) };
    });
    const layout = themed(figure.layout, style);
    if (narrow.matches) {
      layout.margin = { ...layout.margin, r: 12 };
    }
    if (layout.yaxis && layout.yaxis.scaleanchor) {
      place.style.height = mapHeight(place.clientWidth, layout) + "px";
    }
    if (coarse.matches && !layout.scene) {
      layout.dragmode = false; // a finger scrolls the page
    }
    layout.width = place.clientWidth;
    if (!layout.height) {
      layout.height = place.clientHeight;
    }
    const drawn = Plotly.react(place, data, layout, config(figure.key));
    if (narrow.matches && layout.annotations) {
      // The numbers of the axes have taken their room by then.
      drawn.then(() => {
        const width = place._fullLayout._size.w - 4;
        Plotly.relayout(place, { annotations: layout.annotations.map((note) => fitted(note, width)) });
      });
    }
  }

  function drawAll() {
    figures.forEach(draw);
  }

  function press(group, on) {
    shown[group] = on;
    for (const button of buttons) {
      if (button.dataset.group === group) {
        button.setAttribute("aria-pressed", String(on));
      }
    }
    for (const figure of figures) {
      const of = (trace, i) => (groups(trace).includes(group) ? [i] : []);
      const indices = figure.data.flatMap(of);
      if (indices.length > 0) {
        const visible = indices.map((i) => isShown(figure.data[i]));
        Plotly.restyle("figure-" + figure.key, { visible }, indices);
      }
    }
  }

  for (const button of buttons) {
    button.addEventListener("click", () => {
      press(button.dataset.group, button.getAttribute("aria-pressed") !== "true");
    });
  }

  // Paper is white and narrower than most windows.
  window.addEventListener("beforeprint", () => {
    document.documentElement.classList.add("on-paper");
    drawAll();
  });
  window.addEventListener("afterprint", () => {
    document.documentElement.classList.remove("on-paper");
    drawAll();
  });

  for (const row of document.querySelectorAll("tr.here")) {
    const box = row.closest(".tall");
    box.scrollTop = row.offsetTop + row.offsetHeight - box.clientHeight;
  }

  let pending = 0;
  window.addEventListener("resize", () => {
    window.clearTimeout(pending);
    pending = window.setTimeout(drawAll, 120);
  });
  dark.addEventListener("change", drawAll);
  document.querySelectorAll("details").forEach((e) => (e.open = e.open && !narrow.matches));
  document.querySelectorAll("details").forEach((e) => e.addEventListener("toggle", drawAll));
  if (typeof Plotly === "undefined") {
    for (const place of document.querySelectorAll(".plot")) {
      place.textContent =
        "Not drawn: the file soter-plotly-….js has to lie beside this page. " +
        "A page that needs none: soter run … --report --self-contained";
      place.className = "note";
      place.style.height = "auto";
    }
    return;
  }
  drawAll();
})();
