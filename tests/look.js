// What a browser sees of the pages in the iframes of this document: see test_pages.py.
const clipped = node => {
  for (let a = node.parentElement; a; a = a.parentElement) if (getComputedStyle(a).overflowX !== "visible") return true;
  return false;
};
const name = node => `${node.tagName} ${node.textContent.trim().slice(0, 40)}`;

// a text's angle, and its box in axes turned by that angle: texts of one slant lie beside each other there
const box = text => {
  const [, angle = "0"] = /rotate\((-?[\d.]+)/.exec(text.getAttribute("transform") ?? "") ?? [];
  const b = text.getBBox(), x = +text.getAttribute("x"), y = +text.getAttribute("y"), a = -angle * Math.PI / 180;
  const left = b.x + x * Math.cos(a) - y * Math.sin(a) - x, top = b.y + x * Math.sin(a) + y * Math.cos(a) - y;
  return { angle, text: text.textContent, left, top, right: left + b.width, bottom: top + b.height };
};
const cross = (r, s) => r.angle === s.angle &&
  Math.min(r.right, s.right) - Math.max(r.left, s.left) > 0.25 * Math.min(r.right - r.left, s.right - s.left) &&
  Math.min(r.bottom, s.bottom) - Math.max(r.top, s.top) > 0.4 * Math.min(r.bottom - r.top, s.bottom - s.top);
const crossing = svg => {
  const boxes = [...svg.querySelectorAll("text")].filter(t => t.textContent.trim()).map(box);
  return boxes.flatMap((r, i) => boxes.slice(i + 1).filter(s => cross(r, s)).map(s => `${r.text} | ${s.text}`));
};

// what the first mark of a page tells when the pointer is near, how much of its figure is in view once that is shown
// large and zoomed, and where it stands afterwards; null where no mark has words
const tried = page => {
  const path = page.querySelector("figure path > title")?.parentNode, part = path?.closest("figure > div");
  if (!part) return null;
  const svg = part.querySelector("svg"), wanted = path.textContent, d = path.getAttribute("d");
  const isBar = /^M[^a-z]+h/.test(d), [x, y] = d.slice(1).match(/-?[\d.]+/g);
  part.click();
  const at = new DOMPoint(x, y).matrixTransform(path.getScreenCTM()), view = page.defaultView;
  const pointer = { clientX: at.x + 2, clientY: at.y, bubbles: true, cancelable: true, deltaY: -1 };
  (isBar ? path : svg).dispatchEvent(new view.PointerEvent("pointermove", pointer));
  const told = page.querySelector("dialog[open] .tip:not([hidden])")?.textContent, before = svg.viewBox.baseVal.width;
  svg.dispatchEvent(new view.WheelEvent("wheel", pointer));
  const share = svg.viewBox.baseVal.width / before;
  page.querySelector(".tools button:last-child").click();
  return { told, wanted, share, after: svg.viewBox.baseVal.width / before, back: !!svg.closest("figure"), open: page.querySelector("dialog").open };
};

const silent = figure => !figure.querySelector("figcaption")?.textContent.trim() ||
  ![...figure.querySelectorAll("[aria-label], img")].some(n => (n.getAttribute("aria-label") ?? n.alt).trim());
const look = frame => {
  const page = frame.contentDocument, width = page.documentElement.clientWidth;
  const beyond = node => {
    const r = node.getBoundingClientRect();
    return r.width > 0 && r.right > width + 1 && !node.closest("svg, .skip") && !clipped(node);
  };
  return {
    page: frame.dataset.page,
    width: +frame.dataset.width,
    scroll: page.documentElement.scrollWidth - width,
    wide: [...page.querySelectorAll("body *")].filter(beyond).map(name),
    figures: page.querySelectorAll("figure").length,
    silent: [...page.querySelectorAll("figure")].filter(silent).map(name),
    crossing: [...page.querySelectorAll("svg")].flatMap(crossing),
    tried: tried(page),
  };
};
addEventListener("load", () => {
  const out = document.createElement("pre");
  out.id = "found";
  out.textContent = JSON.stringify([...document.querySelectorAll("iframe")].map(look));
  document.body.append(out);
});
