// Goes through the third axis of a region figure.
// Purpose: the slider shows one slice and says where it is; without a script the fullest is there.
// Non-goals: drawing; every slice stands in the page.
"use strict";

for (const control of document.querySelectorAll(".slices")) {
  const input = control.querySelector("input");
  const slices = control.closest("figure").querySelectorAll(".slice");
  const output = control.querySelector("output");
  input.addEventListener("input", () => {
    slices.forEach((slice, k) => {
      slice.setAttribute("display", k === input.valueAsNumber ? "inline" : "none");
    });
    output.textContent = slices[input.valueAsNumber].querySelector("title").textContent;
    input.setAttribute("aria-valuetext", output.textContent);
  });
  input.hidden = false;
}
