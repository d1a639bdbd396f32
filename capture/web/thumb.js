// The screen for a thumb: it draws the blocks that the app describes, again only where they have changed, and sends touches back.

import {send} from "./link.js";

const byId = (name) => document.getElementById(name);
const page = byId("thumb"), main = page.querySelector("main"), dock = byId("dock"), nav = page.querySelector("nav");
const ASIDE = {question_mark: "help", f1: "help"}; // keys with a button at the top
const aside = ({key, label}) => ASIDE[key] ?? (label === "Quit" ? "quit" : ""); // in the menu, where no finger meets it that meant its neighbour
const DENSE = 0.605; // the width of a letter in a font of fixed pitch, in units of its height
const SMALLEST = 9; // px, the smallest readable letter
const CALM_MS = 450; // ms for which buttons that have just come or moved take no touch: it was meant for what was there
const SETTLE_MS = 300; // ms for a touch to end where it began: no widget may move under the finger
const LONG = 200; // letters, from which on a sentence is a text to read and not a short call
const CAPTION = "view"; // the text about the picture, which stands below it
const DETAILS = "sentence"; // the text below the verdict of the results, which scrolls: the list of views needs its room
const ONWARD = "onward"; // the buttons in words, which scroll with the text
const SHORT = 480, SHORT_ON_ITS_SIDE = 280; // px, the heights below which a keyboard is open: the header makes room
const ON_ITS_SIDE = matchMedia("(min-width: 560px) and (max-height: 520px)"); // as in landscape.css
const HELD_MS = 1000; // ms for the fields of another shape to come: then the form is as far down as before
let held = {screen: "", place: 0, until: 0};
let screen = "", focused = "";
let wrong = null; // the box of a refused field, which stays in view until it is accepted, or another one is typed in

function make(tag, about = {}, ...inside) {
  const made = Object.assign(document.createElement(tag), about);
  made.append(...inside);
  return made;
}

const ask = (what) => send({screen, ...what});

export function drawScreen(said) {
  const scrolled = said.screen === screen ? main.scrollTop : 0;
  screen = said.screen;
  byId("thumb").querySelector("h1").textContent = said.step || "Refracal";
  document.title = `${said.step} · Refracal`;
  const now = said.steps.indexOf(said.step);
  byId("steps").replaceChildren(...said.steps.map((step, place) =>
    make("li", {className: place < now ? "past" : place === now ? "now" : "", textContent: step})));
  page.classList.toggle("pictured", said.pictures > 0);
  page.classList.toggle("rig", said.pictures > 1);
  page.classList.toggle("results", screen.startsWith("Results"));

  const form = said.blocks.some((each) => each.kind === "field"); // its fields keep their places while somebody types
  const read = page.classList.contains("results") ? [ONWARD, DETAILS] : [ONWARD];
  const calls = said.blocks.filter((each) => each.spoken && !read.includes(each.name) && (form || each.text.length <= LONG));
  const caption = said.pictures && said.blocks.find((each) => each.kind === "text" && each.name === CAPTION);
  byId("caption").textContent = caption ? caption.text : "";
  const kept = said.blocks.filter((each) => !calls.includes(each) && each !== caption).sort((one, other) => Boolean(other.spoken) - Boolean(one.spoken));
  arrange(kept);
  const news = kept.some((block, place) => block.spoken && main.children[place].textContent !== block.text);
  kept.forEach((block, place) => renew(main.children[place], block));
  if (main.scrollHeight - main.clientHeight < scrolled - 1) held = {screen, place: scrolled, until: Date.now() + HELD_MS};
  main.scrollTop = news ? 0 : held.screen === screen && Date.now() < held.until ? held.place : scrolled;
  if (news) byId("middle").scrollTop = 0;
  drawCalls(calls);
  byId("notices").replaceChildren(...said.notices.map((each) => make("p", {textContent: each})));
  drawFiles(said.files);
  drawKeys(said.keys);
  // the app moves the focus to a wrong field, which is shown; another field of a screen that opens leaves it at its top
  const refused = said.blocks.some((each) => each.name === "problem" && each.text);
  if (!refused) wrong = null;
  else if (said.focus !== focused && document.activeElement.tagName !== "INPUT") {
    wrong = find(said.focus);
    wrong?.scrollIntoView({block: "nearest"});
  }
  focused = said.focus;
}

/** Draw the boxes of these blocks. Those that are there already stay: a list that is open, and a field that somebody types in. */
function arrange(blocks) {
  if (main.dataset.screen !== screen) main.replaceChildren();
  main.dataset.screen = screen;
  const shapes = blocks.map((each) => JSON.stringify([each.kind, each.name, each.columns]));
  const rest = [...shapes];
  for (const box of [...main.children]) {
    const place = rest.indexOf(box.dataset.shape);
    if (place < 0) box.remove();
    else rest.splice(place, 1);
  }
  shapes.forEach((shape, place) => {
    const there = [...main.children].slice(place).find((box) => box.dataset.shape === shape);
    const box = there ?? drawn(blocks[place]);
    box.dataset.shape = shape;
    if (main.children[place] !== box) main.insertBefore(box, main.children[place] ?? null);
  });
}

/** Show what must be done now, outside of what scrolls. */
function drawCalls(calls) {
  const wanted = JSON.stringify([screen, calls]);
  if (dock.dataset.calls === wanted) return;
  dock.dataset.calls = wanted;
  dock.replaceChildren(...calls.map((each) => {
    const line = make("p", {className: `${each.banner ? "banner" : ""} ${each.tone}`, textContent: each.text});
    line.dataset.name = each.name;
    return line;
  }));
  dock.scrollTop = 0;
}

/** Draw a link for each file that the app offers. */
function drawFiles(files) {
  const box = byId("files"), wanted = JSON.stringify(files);
  if (box.dataset.files === wanted) return;
  box.dataset.files = wanted;
  box.hidden = !files.length;
  box.replaceChildren(...files.map((each) => make("a", {href: each.address, target: "_blank", rel: "noopener", textContent: each.label})));
}

function drawKeys(keys) {
  const wanted = JSON.stringify([screen, keys]);
  if (nav.dataset.keys === wanted) return;
  nav.dataset.keys = wanted;
  for (const name of ["help", "quit"]) {
    const key = keys.find((each) => aside(each) === name);
    byId(name).hidden = !key;
    byId(name).onclick = () => ask({press: key.key});
  }
  const below = keys.filter((each) => !aside(each)), others = below.filter((each) => !each.top); // the first row is always of the same button
  const places = JSON.stringify([screen, below.map((each) => [each.key, each.top])]);
  if (nav.dataset.places !== places) {
    nav.classList.add("moved");
    setTimeout(() => nav.classList.remove("moved"), CALM_MS);
  }
  nav.dataset.places = places;
  const wide = {1: "whole", 2: "half", 4: "half", 7: "quarter", 8: "quarter"}[others.length] ?? "";
  nav.replaceChildren(...[...below.filter((each) => each.top), ...others].map((key) => {
    const rest = key === others[6] && others.length === 7; // the last of two rows fills its row: Back is always there
    const button = make("button", {type: "button", className: `${key.main ? "main" : ""} ${key.top ? "whole" : rest ? "half" : wide}`}, key.label);
    button.dataset.key = key.key;
    button.disabled = key.off;
    if (key.pressed !== null) button.setAttribute("aria-pressed", String(key.pressed));
    button.onclick = () => { closeLists(); ask({press: key.key}); };
    return button;
  }));
}

/** Close the lists of choices that are open; what they hid is shown again. */
function closeLists() {
  for (const list of main.querySelectorAll(".choice ul")) list.hidden = true;
}

const choiceWords = (option) => option.replace(/ {2,}/, ": "); // a terminal has columns there
const find = (name) => main.querySelector(`[data-name="${CSS.escape(name)}"]`);

function drawn(block) {
  const name = block.name;
  const box = {field: drawField, choice: drawChoice, list: () => make("div", {className: "list"}), bar: drawBar, map: drawMap}[block.kind]?.(block)
    ?? make(block.columns ? "pre" : "p");
  if (block.half) box.classList.add("half");
  if (block.banner) box.classList.add("banner");
  if (!box.dataset.name) box.dataset.name = name;
  return box;
}

/** The keyboards of fields that take nothing but a number; others also take 40+-5 or unknown. */
const KEYBOARDS = {columns: "numeric", rows: "numeric", square_mm: "decimal", marker_mm: "decimal", tag_mm: "decimal", spacing: "decimal", depth: "decimal"};

const DECIMAL_COMMAS = /^\s*\d+,\d+(\s+\d+(,\d+)?)*\s*$/; // the keyboard of many languages has no point

function drawField(block) {
  const field = make("input", {id: `field-${block.name}`, type: "text", autocomplete: "off", spellcheck: false, enterKeyHint: "next"});
  field.setAttribute("autocapitalize", "off");
  field.setAttribute("autocorrect", "off");
  field.inputMode = KEYBOARDS[block.name] ?? "text";
  field.onfocus = () => { field.select(); ask({field: block.name, look: true}); };
  const typed = () => (field.inputMode === "decimal" && DECIMAL_COMMAS.test(field.value) ? field.value.replaceAll(",", ".") : field.value);
  field.oninput = () => ask({field: block.name, text: typed()});
  field.onkeydown = (event) => {
    if (event.key !== "Enter") return;
    const fields = [...main.querySelectorAll("input:not(:disabled), .choice > button:not(:disabled)")];
    const next = fields[fields.indexOf(field) + 1];
    if (next?.tagName === "INPUT") next.focus();
    else {
      field.blur();
      next?.click(); // its list opens
    }
  };
  const offer = make("button", {type: "button", className: "suggestion", hidden: true});
  offer.onpointerdown = (event) => event.preventDefault(); // the keyboard stays open
  offer.onclick = () => {
    field.value = offer.dataset.text;
    ask({field: block.name, text: field.value});
  };
  const unknown = make("button", {type: "button", className: "unknown", hidden: !block.unknown, textContent: "not known"});
  unknown.onpointerdown = (event) => event.preventDefault(); // a keyboard stays as it is
  unknown.onclick = () => { // a second touch gives back what was there
    const typed = field.value;
    field.value = typed === block.unknown ? unknown.dataset.typed ?? "" : block.unknown;
    unknown.dataset.typed = typed;
    ask({field: block.name, look: true});
    ask({field: block.name, text: field.value});
  };
  return make("div", {className: "field"}, make("label", {htmlFor: field.id}), field, offer, unknown);
}

function drawChoice(block) {
  const button = make("button", {type: "button", id: `choice-${block.name}`}), list = make("ul", {hidden: true});
  button.onclick = () => {
    ask({field: block.name, look: true});
    list.hidden = !list.hidden;
    if (!list.hidden) list.parentElement.scrollIntoView({block: list.parentElement.offsetHeight > main.clientHeight ? "start" : "nearest"});
  };
  return make("div", {className: "choice"}, make("label", {htmlFor: button.id}), button, list);
}

function drawBar() {
  return make("div", {className: "bar"}, make("span"), make("b"), make("progress", {max: 1}));
}

function drawMap() {
  const picture = make("canvas");
  picture.setAttribute("role", "img");
  return make("figure", {className: "map"}, make("figcaption", {}, make("b"), make("small")), picture);
}

/** Draw a map: dark where nothing is covered, brighter for more coverage, green for full coverage. */
function renewMap(box, block) {
  const [title, picture] = box.children, cells = block.cells.flat();
  if (box.dataset.cells === String(cells)) return;
  box.dataset.cells = String(cells);
  title.children[0].textContent = block.label;
  title.children[1].textContent = `green: ${block.full}`;
  const columns = block.cells[0].length, rows = block.cells.length;
  Object.assign(picture, {width: columns, height: rows});
  picture.setAttribute("aria-label", `${block.label}: ${Math.round(100 * cells.filter((share) => share >= 1).length / cells.length)} % ${block.full}`);
  const pen = picture.getContext("2d");
  cells.forEach((share, place) => {
    pen.fillStyle = share >= 1 ? "#4ade80" : `hsl(217 ${20 + 50 * share}% ${14 + 48 * share}%)`;
    pen.fillRect(place % columns, Math.floor(place / columns), 1, 1);
  });
}

/** Return a font size at which the rows of a table fit; its other lines wrap. */
function fitted(text) {
  const rows = text.split("\n").filter((row) => /\S {2}|[█░]/.test(row)).map((row) => row.trimEnd().length);
  const size = (main.clientWidth - 26) / DENSE / Math.max(1, ...rows);
  return size < 12.5 ? `${Math.max(size, SMALLEST)}px` : "";
}

function renew(box, block) {
  if (block.kind === "text") {
    if (box.textContent === block.text) return;
    box.textContent = block.text;
    if (block.columns) box.style.fontSize = fitted(block.text);
    return;
  }
  if (block.kind === "map") {
    renewMap(box, block);
    return;
  }
  if (block.kind === "bar") {
    const [said, title, bar] = box.children;
    said.textContent = block.text;
    title.textContent = block.label;
    if (block.share === null) bar.removeAttribute("value"); // it moves to and fro
    else bar.value = block.share;
    return;
  }
  if (block.kind === "field") {
    const [label, field, offer, unknown] = box.children;
    label.textContent = `${block.wrong ? "✗ " : ""}${block.label}`;
    label.className = field.className = block.wrong ? "wrong" : "";
    field.placeholder = block.placeholder;
    field.disabled = unknown.disabled = block.disabled;
    unknown.setAttribute("aria-pressed", String(block.value === block.unknown));
    if (document.activeElement !== field && field.value !== block.value) field.value = block.value;
    offer.hidden = block.suggestion.length <= field.value.length || !block.suggestion.startsWith(field.value) || document.activeElement !== field;
    offer.dataset.text = block.suggestion;
    offer.textContent = `${block.suggestion.length > 30 ? "…" : ""}${block.suggestion.slice(-30)}`;
    return;
  }
  const options = JSON.stringify([screen, block.options, block.chosen]);
  if (block.kind === "choice") {
    box.children[0].textContent = block.label;
    box.children[1].textContent = choiceWords(block.options[block.chosen] ?? "");
    box.children[1].disabled = block.disabled;
  }
  if (box.dataset.options === options) return;
  box.dataset.options = options;
  const list = block.kind === "choice" ? box.children[2] : box;
  const made = block.options.map((option, place) => {
    const words = block.kind === "choice" ? choiceWords(option) : option;
    const button = make("button", {type: "button", className: place === block.chosen ? "chosen" : "", textContent: words});
    button.onclick = () => {
      ask({field: block.name, choose: place});
      if (block.kind === "choice") list.hidden = true;
    };
    return block.kind === "choice" ? make("li", {}, button) : button;
  });
  list.replaceChildren(...made);
}

/** Handle what needs no answer of the app: the menu, and the room for a keyboard. */
export function follow() {
  const menu = byId("menu"), more = byId("more");
  addEventListener("click", (event) => {
    const beside = !menu.hidden && event.target !== more && !menu.contains(event.target);
    if (beside) event.stopPropagation(); // it closes the menu, and touches nothing below it
    if (!event.target.closest(".choice")) closeLists();
    if (!menu.hidden && menu.contains(event.target)) setTimeout(() => { menu.hidden = true; });
    else menu.hidden = event.target !== more || !menu.hidden;
    more.setAttribute("aria-expanded", String(event.target === more && !menu.hidden));
  }, true);
  for (const kind of ["mousedown", "pointerdown"]) {
    addEventListener(kind, (event) => { // a touch beside the menu opens no field
      if (!menu.hidden && event.target !== more && !menu.contains(event.target)) event.preventDefault();
    }, true);
  }
  const typed = () => (document.activeElement.tagName === "INPUT" ? document.activeElement : null);
  const typing = () => page.classList.toggle("typing", Boolean(typed()));
  const opened = () => main.querySelector(".choice ul:not([hidden])");
  const keep = () => (opened() ?? typed()?.parentElement ?? wrong)?.scrollIntoView({block: "nearest"}); // a keyboard or a sentence takes its room
  main.addEventListener("focusin", ({target}) => {
    wrong = null;
    const list = opened();
    if (list && !list.parentElement.contains(target)) list.hidden = true; // somebody has gone on
    keep();
    setTimeout(typing, typed() ? 0 : SETTLE_MS);
  });
  main.addEventListener("focusout", () => setTimeout(typing, SETTLE_MS));
  new ResizeObserver(keep).observe(main);
  new ResizeObserver(() => {
    page.style.setProperty("--dock", `${dock.offsetHeight}px`);
    page.style.setProperty("--headline", `${dock.querySelector("[data-name=verdict]")?.offsetHeight ?? 0}px`);
  }).observe(dock);
  new ResizeObserver(() => page.style.setProperty("--files", `${byId("files").offsetHeight}px`)).observe(byId("files"));
  ON_ITS_SIDE.addEventListener("change", () => {
    for (const table of main.querySelectorAll("pre")) table.style.fontSize = fitted(table.textContent);
  });
  for (const change of ["resize", "scroll"]) visualViewport?.addEventListener(change, fill);
  fill();
}

/** Fill what a keyboard leaves of the window, wherever the browser has scrolled it to. */
function fill() {
  const {height, offsetTop} = visualViewport ?? {height: innerHeight, offsetTop: 0};
  page.style.setProperty("--height", `${height}px`);
  page.style.setProperty("--top", `${offsetTop}px`);
  page.classList.toggle("short", height < (ON_ITS_SIDE.matches ? SHORT_ON_ITS_SIDE : SHORT));
}
