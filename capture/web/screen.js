/* The page that is the target: it draws what it is told, and says when it has been on the screen. */
"use strict";

const at = id => document.getElementById(id);
const canvas = at("canvas");
const context = canvas.getContext("2d", { alpha: false });
const FRAMES_MEASURED = 40;
const REPLACED = 4000;
let socket = null;
let ready = false;
let pixels = { width: 0, height: 0 };
let refresh = 60;
let picture = "";

function say(message) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

const frame = () => new Promise(resolve => requestAnimationFrame(resolve));

async function measureRefresh() {
  const gaps = [];
  let last = await frame();
  for (let i = 0; i < FRAMES_MEASURED; i++) {
    const now = await frame();
    gaps.push(now - last);
    last = now;
  }
  gaps.sort((a, b) => a - b);
  refresh = Math.min(1000, Math.max(10, 1000 / Math.max(0.1, gaps[FRAMES_MEASURED / 2])));
}

/* The canvas has a pixel for each pixel of the screen, whatever the zoom. */
new ResizeObserver(([entry]) => {
  const box = entry.devicePixelContentBoxSize?.[0];
  const ratio = devicePixelRatio;
  const width = box ? box.inlineSize : Math.round(entry.contentRect.width * ratio);
  const height = box ? box.blockSize : Math.round(entry.contentRect.height * ratio);
  if (width === pixels.width && height === pixels.height) return;
  pixels = { width, height };
  canvas.width = width;
  canvas.height = height;
  if (ready) announce();
}).observe(canvas);

function announce() {
  say({ screen: { ...pixels, refresh_hz: refresh } });
}

function bytes(text) {
  return Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
}

async function show(number, columns, rows) {
  document.body.classList.add("showing");
  at("panel").hidden = true;
  const { width, height } = canvas;
  if (columns.length !== width || rows.length !== height) return announce();
  const image = context.createImageData(width, height);
  const words = new Uint32Array(image.data.buffer);
  for (let y = 0; y < height; y++) {
    const level = rows[y];
    for (let x = 0, i = y * width; x < width; x++, i++) {
      const grey = Math.floor((level * columns[x] + 127) / 255);
      words[i] = 0xff000000 | (grey << 16) | (grey << 8) | grey;
    }
  }
  context.putImageData(image, 0, 0);
  await frame();
  await frame();
  say({ shown: number });
}

function turnTo(phase, sentence, problem) {
  document.body.classList.toggle("showing", phase === "take");
  at("panel").hidden = phase === "take";
  for (const name of ["start", "size", "aim"]) at(name).hidden = name !== phase;
  at("sentence").textContent = sentence;
  at("problem").textContent = problem;
  for (const line of document.querySelectorAll(".line")) line.remove();
  if (phase === "size") drawSize();
  if (phase === "aim") at("take").focus();
}

/* The two lines to measure, in pixels of the screen. */
const lines = () => [Math.round(0.8 * pixels.width), Math.round(0.7 * pixels.height)];

function drawSize() {
  const ratio = devicePixelRatio;
  const [across, down] = lines();
  const bar = (left, top, width, height) => {
    const line = document.createElement("div");
    line.className = "line";
    const sides = { left, top, width, height };
    for (const [side, value] of Object.entries(sides)) line.style[side] = `${value / ratio}px`;
    document.body.append(line);
  };
  const left = Math.round(0.1 * pixels.width), bottom = Math.round(0.94 * pixels.height);
  const top = Math.round(0.15 * pixels.height), right = Math.round(0.95 * pixels.width);
  const mark = Math.round(0.02 * pixels.height);
  bar(left, bottom, across, 2);
  bar(left, bottom - mark, 2, 2 * mark);
  bar(left + across - 2, bottom - mark, 2, 2 * mark);
  bar(right, top, 2, down);
  bar(right - mark, top, 2 * mark, 2);
  bar(right - mark, top + down - 2, 2 * mark, 2);
  sizeCard();
}

function sizeCard() {
  const { width, height } = at("card").elements;
  at("frame").style.width = `${width.value / devicePixelRatio}px`;
  at("frame").style.height = `${height.value / devicePixelRatio}px`;
}

at("card").addEventListener("input", sizeCard);
at("card").addEventListener("submit", event => {
  event.preventDefault();
  const { width, height } = event.target.elements;
  say({ card: { px: [Number(width.value), Number(height.value)] } });
});
at("ruler").addEventListener("submit", event => {
  event.preventDefault();
  const { across, down } = event.target.elements;
  say({ ruler: { px: lines(), mm: [Number(across.value), Number(down.value)] } });
});
at("take").addEventListener("click", () => say({ take: true }));
at("full").addEventListener("click", async () => {
  try {
    await document.documentElement.requestFullscreen();
  } catch {
    at("problem").textContent = "This browser shows no full screen: its window is taken as it is.";
  }
  await measureRefresh();
  ready = true;
  navigator.wakeLock?.request("screen").catch(() => {});
  announce();
});

function connect() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  socket = new WebSocket(`${scheme}://${location.host}/screen`);
  socket.binaryType = "blob";
  socket.addEventListener("open", () => {
    at("problem").textContent = "";
    if (ready) announce();
  });
  socket.addEventListener("message", ({ data }) => {
    if (typeof data !== "string") {
      URL.revokeObjectURL(picture);
      picture = URL.createObjectURL(data);
      at("camera").src = picture;
      return;
    }
    const message = JSON.parse(data);
    if ("show" in message) show(message.show, bytes(message.columns), bytes(message.rows));
    else if ("phase" in message) turnTo(message.phase, message.sentence, message.problem);
    else at("problem").textContent = message.problem;
  });
  socket.addEventListener("close", ({ code }) => {
    document.body.classList.remove("showing");
    at("panel").hidden = false;
    at("problem").textContent = code === REPLACED
      ? "Another page has taken over."
      : "The program has ended: start it again, and open the address that it prints.";
    if (code !== REPLACED) setTimeout(connect, 1000);
  });
}
connect();
