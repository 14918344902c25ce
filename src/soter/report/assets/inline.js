// Unpacks the drawing library of a page in a notebook, then runs the page's scripts.
"use strict";

(async () => {
  const packed = atob(document.getElementById("library").textContent);
  const bytes = Uint8Array.from(packed, (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const later = [...document.querySelectorAll("script.later")].map((e) => e.textContent);
  for (const text of [await new Response(stream).text(), ...later]) {
    const script = document.createElement("script");
    script.textContent = text;
    document.body.append(script);
  }
})();
