// Names every text of a page that a reader cannot read, each with the reason.
// Purpose: a function of the least size of letters in px and the least contrasts, of letters and of large
// ones, over the page as it is drawn; places are those of the window.
// Non-goals: opening the page (`legibility.py`).
((least, contrastLeast, largeLeast) => {
  const wide = document.documentElement.clientWidth;
  const told = new Set();
  if (document.documentElement.scrollWidth > wide) told.add(`page: ${document.documentElement.scrollWidth} px wide`);
  const shown = (e) => e.checkVisibility({ opacityProperty: true, visibilityProperty: true });
  const scrolls = (e) => { for (let p = e; p; p = p.parentElement)
    if (["auto", "scroll"].includes(getComputedStyle(p).overflowX) && p.scrollWidth > p.clientWidth) return p; };
  const rgb = (text) => (text.match(/[\d.]+/g) ?? []).map(Number);
  const over = ([r, g, b, a = 1], [x, y, z]) => [r * a + x * (1 - a), g * a + y * (1 - a), b * a + z * (1 - a)];
  const light = (c) => c.slice(0, 3).map((v) => v / 255)
    .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const contrast = (a, b) => { const [x, y] = [light(a), light(b)].sort((p, q) => q - p); return (x + 0.05) / (y + 0.05); };
  const opacity = (e) => { let o = 1; for (let p = e; p; p = p.parentElement) o *= Number(getComputedStyle(p).opacity); return o; };
  // What is painted at a place below a text, from the page up to it.
  const ground = (element, x, y) => {
    let colour = rgb(getComputedStyle(document.body).backgroundColor);
    const stack = document.elementsFromPoint(x, y).reverse();
    for (const e of stack) {
      const style = getComputedStyle(e);
      if (e.ownerSVGElement && e.getBBox && !(e.getBBox().width * e.getBBox().height)) continue;
      const svg = e.ownerSVGElement && !["text", "tspan", "g", "a", "line", "polyline"].includes(e.tagName);
      if (e.tagName === "CANVAS" || e.tagName === "IMG") return null;
      const paint = rgb(svg ? (style.fill.startsWith("rgb") ? style.fill : "rgba(0,0,0,0)") : style.backgroundColor);
      if (e === element && e.ownerSVGElement) break;
      if (paint.length < 3) continue;
      const alpha = (paint[3] ?? 1) * (svg ? Number(style.fillOpacity) : 1) * opacity(e);
      colour = over([...paint.slice(0, 3), alpha], colour);
      if (e === element) break;
    }
    return colour;
  };
  document.querySelectorAll("*").forEach((e) => { e.style.pointerEvents = "auto"; });
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  const range = document.createRange();
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const e = node.parentElement;
    const words = node.textContent.trim();
    if (!words || ["SCRIPT", "STYLE", "NOSCRIPT", "title", "OPTION"].includes(e.tagName) || !shown(e)) continue;
    range.selectNodeContents(node);
    const box = range.getBoundingClientRect();
    if (!box.width || !box.height) continue;
    const what = words.slice(0, 40);
    const style = getComputedStyle(e);
    const scroller = scrolls(e);
    const outside = [...range.getClientRects()].some((r) => r.left < -1 || r.right > wide + 1);
    if (outside && !scroller) told.add(`cut: ${what}`);
    for (let p = e; p && p !== scroller && p !== document.body; p = p.parentElement) {
      const s = getComputedStyle(p), b = p.getBoundingClientRect();
      const hides = p.tagName === "svg" ? s.overflow !== "visible" : s.overflowX === "hidden";
      if (hides && b.width > 2 && (box.left < b.left - 2 || box.right > b.right + 2)) { told.add(`cut: ${what}`); break; }
    }
    const matrix = e.ownerSVGElement ? e.getScreenCTM() : null;
    const size = parseFloat(style.fontSize) * (matrix ? Math.hypot(matrix.a, matrix.b) : 1);
    if (size < least) told.add(`${size.toFixed(1)} px: ${what}`);
    const first = [...range.getClientRects()].find((r) => r.width > 0);
    const x = first.left + first.width / 2, y = first.top + first.height / 2;
    if (!scroller || (x > 0 && x < wide)) {
      const below = ground(e, x, y);
      const paint = rgb(e.ownerSVGElement ? style.fill : style.color);
      if (below && paint.length >= 3) {
        const ink = over([...paint.slice(0, 3), (paint[3] ?? 1) * opacity(e)], below);
        const large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
        const ratio = contrast(ink, below);
        if (ratio < (large ? largeLeast : contrastLeast)) told.add(`contrast ${ratio.toFixed(1)}: ${what}`);
      }
    }
  }
  // A drawing that scrolls begins with something to see.
  for (const svg of document.querySelectorAll("svg")) {
    const scroller = scrolls(svg.parentElement);
    const top = [...svg.querySelectorAll("text")].filter(shown).map((t) => t.getBoundingClientRect())
      .filter((b) => b.width).sort((a, b) => a.top - b.top)[0];
    if (scroller && top && (top.left + top.width / 2 < 0 || top.left + top.width / 2 > wide))
      told.add(`out of sight: the first box of ${svg.getAttribute("aria-label") ?? "a drawing"}`.slice(0, 80));
  }
  return [...told];
})
