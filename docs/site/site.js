// The search of the docs, over all of their words; what is closed until somebody opens it.
// Purpose: parts of pages that hold the words asked for, the best first, with what stands around it. The words are
// a script of this folder, read when somebody first looks for something: a page from a disk may ask for nothing else.
"use strict";

(() => {
  const MOST = 20, AROUND = 80;
  const find = document.getElementById("find");
  const found = document.getElementById("found");
  const up = document.body.dataset.up;
  let parts; // undefined: not asked for yet; null: on its way

  function read() {
    if (parts !== undefined) return;
    parts = null;
    const script = document.createElement("script");
    script.src = `${up}search.js`;
    script.onload = () => {
      parts = PAGES.map(([page, address, heading, text]) => {
        return { page, address, heading, text, head: `${page} ${heading}`.toLowerCase(), body: text.toLowerCase() };
      });
      show();
    };
    document.head.append(script);
  }

  // How well a part fits: a word counts as much as it is rare, in a heading most, then as often as it comes.
  function fits(part, words) {
    const asked = words.map(({ word }) => word).join(" ");
    let has = 0, score = part.head.includes(asked) ? 20 : part.body.includes(asked) ? 5 : 0;
    for (const { word, rare } of words) {
      const times = part.body.split(word).length - 1;
      const begins = ` ${part.head}`.includes(` ${word}`) ? 10 : part.head.includes(word) ? 5 : 0;
      has += times || begins ? rare : 0;
      score += rare * (begins + Math.min(times, 4));
    }
    return { part, has, score: score + 12 * has };
  }

  function around(part, words) {
    const at = Math.max(Math.min(...words.map((w) => part.body.indexOf(w)).filter((k) => k >= 0)), 0);
    const from = Number.isFinite(at) ? Math.max(at - AROUND, 0) : 0;
    const text = part.text.slice(from, from + 3 * AROUND);
    const line = document.createElement("small");
    const escaped = words.map((w) => w.replace(/[^\w\s]/g, "\\$&"));
    text.split(new RegExp(`(${escaped.join("|")})`, "i")).forEach((piece, k) => {
      line.append(k % 2 ? Object.assign(document.createElement("mark"), { textContent: piece }) : piece);
    });
    return line;
  }

  function show() {
    const typed = find.value.toLowerCase().split(/\s+/).filter(Boolean);
    const words = typed.filter((word) => word.length > 1 || typed.length === 1);
    if (!words.length || !parts) return found.replaceChildren();
    const weighed = words.map((word) => {
      const having = parts.filter((p) => p.head.includes(word) || p.body.includes(word)).length;
      return { word, rare: Math.log(1 + parts.length / (1 + having)) };
    });
    const all = weighed.reduce((sum, { rare }) => sum + rare, 0);
    const hits = parts.map((part) => fits(part, weighed)).filter(({ has }) => has > 0.6 * all);
    hits.sort((a, b) => b.score - a.score);
    const told = document.createElement("li");
    const count = hits.length === 1 ? "1 part of a page" : `${hits.length} parts of pages`;
    told.textContent = hits.length > MOST ? `the best ${MOST} of ${count}` : count;
    const lines = hits.slice(0, MOST).map(({ part }) => {
      const line = document.createElement("li");
      const link = document.createElement("a");
      link.href = up + part.address;
      link.textContent = `${part.page}: ${part.heading}`;
      line.append(link, around(part, words));
      return line;
    });
    found.replaceChildren(...lines, told);
  }

  find.addEventListener("focus", read);
  find.addEventListener("input", () => {
    read();
    show();
  });
  find.addEventListener("keydown", (event) => {
    if (event.key === "Enter") found.querySelector("a")?.click();
    if (event.key === "Escape") {
      find.value = "";
      show();
    }
  });
  document.addEventListener("keydown", (event) => {
    if (event.key === "/" && !/^(INPUT|TEXTAREA|SELECT)$/.test(document.activeElement.tagName)) {
      event.preventDefault();
      find.focus();
    }
  });
  // The playground is large: it comes when somebody opens it.
  document.querySelector(".try")?.addEventListener("toggle", (event) => {
    const frame = event.target.querySelector("iframe");
    frame.src ||= frame.dataset.src;
  });
  if (window.matchMedia("(max-width: 1000px)").matches) {
    document.querySelector(".menu").open = false;
  }
})();
