// The search of the docs, over all of their words, and a menu that is closed on a phone.
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

  // How well a part fits: words that it lacks, and its score; words of its heading count most, then how often they come.
  function fits(part, words) {
    const asked = words.join(" ");
    let lacks = 0, score = part.head.includes(asked) ? 20 : part.body.includes(asked) ? 5 : 0;
    for (const word of words) {
      const times = part.body.split(word).length - 1;
      if (!times && !part.head.includes(word)) lacks += 1;
      score += (` ${part.head}`.includes(` ${word}`) ? 10 : part.head.includes(word) ? 5 : 0) + Math.min(times, 4);
    }
    return { part, lacks, score };
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
    const words = find.value.toLowerCase().split(/\s+/).filter(Boolean);
    if (!words.length || !parts) return found.replaceChildren();
    const tried = parts.map((part) => fits(part, words)).sort((a, b) => a.lacks - b.lacks || b.score - a.score);
    const least = tried[0].lacks;
    const hits = tried.filter((hit) => hit.lacks === least && least < words.length);
    const told = document.createElement("li");
    told.textContent = `${hits.length} parts of pages have ${least ? words.length - least + " of these words" : "it"}`;
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
  if (window.matchMedia("(max-width: 1000px)").matches) {
    document.querySelector(".menu").open = false;
  }
})();
