// The search of the docs: headings that hold every word; and a menu that is closed on a phone.
"use strict";

(() => {
  const find = document.getElementById("find");
  const found = document.getElementById("found");
  const up = document.body.dataset.up;
  find.addEventListener("input", () => {
    const words = find.value.toLowerCase().split(/\s+/).filter(Boolean);
    const fits = (page) => words.every((w) => `${page.page} ${page.text}`.toLowerCase().includes(w));
    const hits = words.length ? PAGES.filter(fits).slice(0, 20) : [];
    found.replaceChildren(
      ...hits.map((page) => {
        const line = document.createElement("li");
        const link = document.createElement("a");
        link.href = up + page.address;
        link.textContent = `${page.page}: ${page.text}`;
        line.append(link);
        return line;
      })
    );
  });
  if (window.matchMedia("(max-width: 1000px)").matches) {
    document.querySelector(".menu").open = false;
  }
})();
