// A click shows a figure large, to zoom and to move in; the mark nearest to the pointer tells what it is.
// Nothing is lost without this script: each mark has its words, and each figure its caption, in the page itself.
"use strict";
const make = (tag, kind, text = "") => Object.assign(document.createElement(tag), { className: kind, textContent: text });
const tip = make("div", "tip"), large = make("dialog", "large"), words = make("p", "note");
const NEAR = 16, MOST = 40, STEP = 1.25;

const known = new WeakMap();
const marks = svg => {
  if (!known.has(svg)) known.set(svg, [...svg.querySelectorAll("path > title")].map(title => {
    const path = title.parentNode, d = path.getAttribute("d"), [x, y] = d.slice(1).match(/-?[\d.]+/g);
    title.remove();  // the browser's own words would come too, a second later
    return { path, x: +x, y: +y, text: title.textContent, bar: /^M[^a-z]+h/.test(d) };
  }));
  return known.get(svg);
};
const nearest = (svg, event) => {
  let found = null, least = NEAR, group = null, m = null;
  for (const mark of marks(svg)) {
    if (mark.path === event.target) return mark;
    if (mark.path.parentNode !== group) { group = mark.path.parentNode; m = group.getScreenCTM(); }
    const off = Math.hypot(m.a * mark.x + m.e - event.clientX, m.d * mark.y + m.f - event.clientY);
    if (off < least && !mark.bar) { least = off; found = mark; }
  }
  return found;
};
const tell = event => {
  const svg = event.target.closest?.("figure svg, .large svg"), mark = svg && nearest(svg, event);
  tip.hidden = !mark;
  if (!mark) return;
  (large.open ? large : document.body).append(tip);
  tip.textContent = mark.text;
  const room = document.documentElement.clientWidth - tip.offsetWidth - 4;
  tip.style.left = `${Math.max(4, Math.min(event.clientX + 12, room))}px`;
  tip.style.top = `${Math.max(4, event.clientY - tip.offsetHeight - 12)}px`;
};

let shown = null, home = null, whole = null;
const look = (x, y, share) => {
  const box = shown.viewBox.baseVal;
  box.width = share * whole.width;
  box.height = share * whole.height;
  box.x = Math.min(Math.max(x, whole.x), whole.x + whole.width - box.width);
  box.y = Math.min(Math.max(y, whole.y), whole.y + whole.height - box.height);
  for (const { path, x, y, bar } of marks(shown))  // marks keep their size, so that they part from each other
    if (!bar) path.setAttribute("transform", `translate(${x} ${y}) scale(${share}) translate(${-x} ${-y})`);
};
const zoom = (factor, at) => {
  const box = shown.viewBox.baseVal, before = box.width / whole.width;
  const share = Math.min(Math.max(before / factor, 1 / MOST), 1), k = share / before;
  const x = at ? at.x : box.x + box.width / 2, y = at ? at.y : box.y + box.height / 2;
  look(x - k * (x - box.x), y - k * (y - box.y), share);
};
const tools = make("div", "tools");
for (const [name, label, act] of [
  ["+", "zoom in", () => zoom(STEP * STEP)], ["\u2212", "zoom out", () => zoom(1 / STEP / STEP)],
  ["whole", "show the whole figure", () => look(0, 0, 1)], ["close", "close", () => shut()],
]) {
  const button = make("button", "", name);
  button.type = "button";
  button.ariaLabel = label;
  button.addEventListener("click", act);
  tools.append(button);
}
const open = part => {
  home = part.parentNode;
  shown = part.querySelector("svg[font-family]");
  for (const button of [...tools.children].slice(0, 3)) button.hidden = !shown;
  words.textContent = home.querySelector("figcaption").textContent;
  large.replaceChildren(tools, part, words);
  if (shown) { const { x, y, width, height } = shown.viewBox.baseVal; whole = { x, y, width, height }; }
  large.showModal();
};
const shut = () => {
  if (!home) return;
  if (shown) look(0, 0, 1);
  home.prepend(large.children[1]);
  shown = home = null;
  tip.hidden = true;
  large.close();
};
large.addEventListener("close", shut);
large.addEventListener("click", event => event.target === large && shut());
large.addEventListener("wheel", event => {
  if (!shown) return;
  event.preventDefault();
  zoom(event.deltaY < 0 ? STEP : 1 / STEP, new DOMPoint(event.clientX, event.clientY).matrixTransform(shown.getScreenCTM().inverse()));
}, { passive: false });
large.addEventListener("pointermove", event => {
  if (!shown || !(event.buttons & 1)) return;
  const box = shown.viewBox.baseVal, { a } = shown.getScreenCTM();
  look(box.x - event.movementX / a, box.y - event.movementY / a, box.width / whole.width);
});

for (const part of document.querySelectorAll("figure > div")) {
  part.classList.add("opens");
  part.tabIndex = 0;
  part.addEventListener("click", () => large.open || open(part));
  part.addEventListener("keydown", event => event.key === "Enter" && !large.open && open(part));
}
tip.hidden = true;
document.body.append(large, tip);
document.addEventListener("pointermove", tell);
document.addEventListener("pointerdown", tell);
if (document.querySelector(".opens"))
  document.querySelector("nav").append(make("p", "note", "A click or Enter shows a figure large: there the wheel zooms and dragging moves. What the pointer is near tells what it is."));
