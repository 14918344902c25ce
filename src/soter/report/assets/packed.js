// Unpacks lists of numbers: sums of whole numbers, divided by a power of ten.
"use strict";

function soterUnpacked(list) {
  if (list === undefined || list === null || list.d === undefined) {
    return list;
  }
  const one = 10 ** list.e;
  let sum = 0;
  return list.d.map((step) => (step === null ? null : (sum += step) / one));
}

// The figures of the page: a list of x that traces share stands in the first of them.
function soterFigures() {
  const figures = JSON.parse(document.getElementById("figures")?.textContent ?? "[]");
  for (const { data } of figures) {
    for (const trace of data) {
      if (trace.y !== undefined) {
        trace.y = soterUnpacked(trace.y);
      }
      if (trace.x !== undefined) {
        trace.x = trace.x.of === undefined ? soterUnpacked(trace.x) : data[trace.x.of].x;
      }
    }
  }
  return figures;
}
