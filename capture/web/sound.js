// The sounds: a tone for a taken view, one for a refused board, one for enough views; and spoken instructions if the person wants them.

const TONES = { // Hz and s of each note: two rising notes, two low ones, and a chord note by note
  taken: [[660, 0.09], [990, 0.14]],
  refused: [[196, 0.12], [165, 0.2]],
  enough: [[523, 0.14], [659, 0.14], [784, 0.14], [1047, 0.4]],
};
const REST_MS = 2000; // ms between two tones of refusal
const SPOKEN = ["now", "verdict", "next", "problem", "sentence", "said"];
const SETTLED_MS = 1200; // ms for which a sentence must stay before it is spoken: it changes often while a board moves
const toneButton = document.getElementById("sound"), voiceButton = document.getElementById("voice");
const picture = document.getElementById("picture");
const on = (button) => button.getAttribute("aria-pressed") === "true";

let audio = null, refusedAt = -REST_MS, before = new Map(), coming = before, waiting = 0, latest = [];

/** Play one of TONES; the picture's frame shows the same by its colour. */
export function hear(name) {
  if (name === "refused") {
    if (performance.now() - refusedAt < REST_MS) return;
    refusedAt = performance.now();
  }
  picture.className = name;
  setTimeout(() => { if (picture.className === name) picture.className = ""; }, 700);
  picture.dataset.heard = `${picture.dataset.heard ?? ""} ${name}`.trim().slice(-200); // a record for tests
  if (!on(toneButton) || audio?.state !== "running") return;
  let at = audio.currentTime;
  for (const [pitch, length] of TONES[name]) {
    note(pitch, at, length);
    at += length;
  }
}

function note(pitch, at, length) {
  const tone = audio.createOscillator(), volume = audio.createGain();
  tone.type = "triangle";
  tone.frequency.value = pitch;
  volume.gain.setValueAtTime(0.0001, at);
  volume.gain.exponentialRampToValueAtTime(0.5, at + 0.01);
  volume.gain.exponentialRampToValueAtTime(0.0001, at + length);
  tone.connect(volume).connect(audio.destination);
  tone.start(at);
  tone.stop(at + length);
}

/** Speak the new sentences of the screen if the person wants spoken hints. */
export function speak(blocks) {
  latest = blocks;
  if (!on(voiceButton)) return;
  const now = new Map(blocks.filter((each) => SPOKEN.includes(each.name)).map((each) => [each.name, each.text]));
  if (JSON.stringify([...now]) === JSON.stringify([...coming])) return;
  coming = now;
  clearTimeout(waiting);
  waiting = setTimeout(() => {
    const news = [...now].filter(([name, text]) => before.get(name) !== text).map(([, text]) => text);
    before = now;
    if (!news.length) return;
    speechSynthesis.cancel();
    speechSynthesis.speak(Object.assign(new SpeechSynthesisUtterance(news.join(" ")), {lang: "en"}));
  }, SETTLED_MS);
}

for (const button of [toneButton, voiceButton]) {
  button.addEventListener("click", () => {
    button.setAttribute("aria-pressed", String(!on(button)));
    if (button !== voiceButton) return;
    before = coming = new Map();
    clearTimeout(waiting);
    speechSynthesis.cancel();
    speak(latest);
  });
}
voiceButton.hidden = !("speechSynthesis" in window);
addEventListener("click", () => { // a browser plays no sound before the first touch
  audio ??= new AudioContext();
  audio.resume();
}, {capture: true});
