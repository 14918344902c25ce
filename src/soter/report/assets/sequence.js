// Goes through the steps of a sequence view.
// Purpose: tell a step in words when it is pointed at or selected; arrow keys go from step to step.
// Non-goals: drawing; everything is on the page already, and the panel copies it from the table.
"use strict";

(() => {
  const frame = document.querySelector(".frame");
  const scroller = document.querySelector(".scroller");
  const head = document.querySelector(".head");
  const corner = document.querySelector(".corner");
  const panel = document.querySelector(".panel");
  const rows = [...document.querySelectorAll(".row")];
  const marks = [...document.querySelectorAll(".gutter .mark")];
  const titles = [...document.querySelectorAll(".steps thead th")].map((th) => th.textContent);
  const violating = rows.findIndex((row) => row.classList.contains("violates"));
  const gap = 24;
  let selected = -1;

  if (rows.length === 0) {
    return;
  }
  for (const element of document.querySelectorAll(".scripted, .panel")) {
    element.hidden = false;
  }
  for (const row of rows) {
    row.tabIndex = -1;
    row.querySelector("title").remove(); // the panel says it
  }

  // Table cells become terms and descriptions; nodes are copied, never read as markup.
  function tell(index) {
    const list = document.createElement("dl");
    const cells = index < 0 ? [] : document.getElementById("step-" + rows[index].dataset.step).cells;
    for (const [k, cell] of [...cells].entries()) {
      if (cell.textContent === "") {
        continue;
      }
      const entry = document.createElement("div");
      const term = document.createElement("dt");
      const description = document.createElement("dd");
      term.textContent = titles[k] || "property";
      description.className = cell.className === "number" ? "" : cell.className;
      description.append(...[...cell.cloneNode(true).childNodes]);
      entry.append(term, description);
      list.append(entry);
    }
    if (index < 0) {
      list.textContent = "No step is selected.";
    }
    panel.replaceChildren(list);
  }

  function paint(name, index) {
    for (const [k, row] of rows.entries()) {
      row.classList.toggle(name, k === index);
      marks[k].classList.toggle(name, k === index);
    }
  }

  // Under the names of the lanes and beside the times, which stay where they are.
  function reveal(row) {
    const top = Number(row.dataset.top);
    const end = Number(row.dataset.end);
    const shown = scroller.clientHeight - head.offsetHeight;
    if (top - gap < scroller.scrollTop) {
      scroller.scrollTop = top - gap;
    } else if (end + gap > scroller.scrollTop + shown) {
      scroller.scrollTop = end + gap - shown;
    }
    const x = Number(row.dataset.x);
    const wide = scroller.clientWidth - corner.offsetWidth;
    if (x > 0 && (x - 90 < scroller.scrollLeft || x + 90 > scroller.scrollLeft + wide)) {
      scroller.scrollLeft = x - wide / 2;
    }
  }

  function select(index, moves) {
    selected = index;
    paint("selected", index);
    tell(index);
    if (moves && index >= 0) {
      reveal(rows[index]);
    }
  }

  function go(index) {
    select(Math.max(0, Math.min(index, rows.length - 1)), true);
  }

  function show(index) {
    go(index);
    frame.scrollIntoView({ block: "nearest" });
    scroller.focus({ preventScroll: true });
  }

  for (const [index, row] of rows.entries()) {
    for (const element of [row, marks[index]]) {
      element.addEventListener("pointerenter", () => {
        paint("pointed", index);
        tell(index);
      });
      element.addEventListener("click", (event) => {
        event.preventDefault();
        select(index, false);
        scroller.focus({ preventScroll: true });
      });
    }
  }
  scroller.addEventListener("pointerleave", () => {
    paint("pointed", -1);
    tell(selected);
  });

  const keys = {
    ArrowDown: () => go(selected + 1),
    ArrowRight: () => go(selected + 1),
    ArrowUp: () => go(selected < 0 ? rows.length - 1 : selected - 1),
    ArrowLeft: () => go(selected < 0 ? rows.length - 1 : selected - 1),
    Home: () => go(0),
    End: () => go(rows.length - 1),
    v: () => violating >= 0 && go(violating),
    Escape: () => select(-1, false),
  };
  scroller.addEventListener("keydown", (event) => {
    if (event.key in keys && !event.ctrlKey && !event.metaKey && !event.altKey) {
      event.preventDefault();
      keys[event.key]();
    }
  });

  document.addEventListener("click", (event) => {
    const link = event.target instanceof Element && event.target.closest('a[href^="#row-"]');
    const index = link ? rows.findIndex((row) => "#" + row.id === link.getAttribute("href")) : -1;
    if (index >= 0) {
      event.preventDefault();
      show(index);
    }
  });

  // Paper is white.
  window.addEventListener("beforeprint", () => document.documentElement.classList.add("on-paper"));
  window.addEventListener("afterprint", () => document.documentElement.classList.remove("on-paper"));

  select(violating, false);
})();
