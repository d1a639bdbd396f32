// The camera's picture, with lines over it: the detected board, and the place to hold it next.

import {send} from "./link.js";

const SVG = "http://www.w3.org/2000/svg";
const KINDS = {"+": "found", "▒": "hint", "◆": "worst", "·": "line"};
const box = document.getElementById("picture"), image = box.querySelector("img"), over = box.querySelector("svg");
let coming = null, drawnFor = "", screen = "";

/** Remember the data of the next picture. */
export function expect(said) {
  coming = said;
}

/** Show the picture only on the screen that it belongs to. */
export function pictureOf(said) {
  screen = said.pictures ? said.screen : "";
  box.hidden = !screen || drawnFor !== screen;
}

export function drawPicture(jpeg) {
  const said = coming, address = URL.createObjectURL(new Blob([jpeg], {type: "image/jpeg"}));
  const done = () => {
    URL.revokeObjectURL(address);
    send({drawn: said.number});
  };
  image.onload = () => {
    over.setAttribute("viewBox", `-0.5 -0.5 ${said.width} ${said.height}`);
    over.replaceChildren(...said.marks.flatMap((mark) => drawn(mark, said.width)),
      ...said.marks.filter((mark) => mark.label && mark.points.length).map((mark) => label(mark, said.width))); // over all marks
    drawnFor = said.screen;
    box.hidden = drawnFor !== screen;
    done();
  };
  image.onerror = done;
  image.src = address;
}

function drawn(mark, width) {
  const kind = KINDS[mark.kind], at = mark.points.map(([x, y]) => `${x} ${y}`);
  if (!at.length) return [];
  const path = mark.closed ? `M${at.join("L")}Z` : at.map((each) => `M${each}h0`).join("");
  const names = kind === "line" ? [kind] : [`${kind} halo`, kind];
  return names.map((name) => (kind === "worst" ? ring(name, mark.points[0], width) : shape("path", {class: name, d: path})));
}

function ring(name, [x, y], width) {
  return shape("circle", {class: name, cx: x, cy: y, r: width / 50});
}

function label(mark, width) {
  const middle = (axis) => mark.points.reduce((sum, each) => sum + each[axis], 0) / mark.points.length;
  const text = shape("text", {x: middle(0), y: middle(1), "font-size": width / 22});
  text.textContent = mark.label;
  return text;
}

function shape(tag, attributes) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}
