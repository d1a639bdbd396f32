// The choice of the view: a phone, held upright or on its side as the page loads, gets the page for a thumb, any other window the terminal; two buttons switch between them.

import {listen, send} from "./link.js";
import {drawScreen, follow} from "./thumb.js";
import {drawPicture, expect, pictureOf} from "./picture.js";
import {hear, speak} from "./sound.js";

const byId = (name) => document.getElementById(name);
const terminal = byId("terminal");
const fits = Math.min(innerWidth / 80 / 0.61, innerHeight / 24 / 1.3); // the size of letters at which 80 columns and 24 rows fit
terminal.dataset.fontSize = Math.max(6, Math.min(16, Math.floor(fits)));

const UPRIGHT = "(max-width: 600px) and (orientation: portrait)", ON_ITS_SIDE = "(pointer: coarse) and (max-height: 520px) and (orientation: landscape)";
let thumb = matchMedia(`${UPRIGHT}, ${ON_ITS_SIDE}`).matches;

function show(asThumb) {
  thumb = asThumb;
  byId("thumb").hidden = !thumb;
  byId("to-thumb").hidden = thumb;
  send({view: thumb});
  if (!thumb) focusTerminal();
}

function focusTerminal() {
  const waiting = setInterval(() => { // so that the terminal takes keys without a click
    const keys = document.querySelector(".xterm-helper-textarea");
    if (thumb || (keys && document.activeElement === keys)) clearInterval(waiting);
    else keys?.focus();
  }, 50);
}

listen({
  opened: () => show(thumb),
  said: (said) => {
    if (said.tone) hear(said.tone);
    else if (said.marks) expect(said);
    else {
      document.body.classList.add("-shown");
      drawScreen(said);
      pictureOf(said);
      speak(said.blocks);
    }
  },
  picture: drawPicture,
});
new MutationObserver((_, watching) => { // Textual's terminal sets this class when it has something to show
  if (!document.body.classList.contains("-first-byte")) return;
  watching.disconnect();
  if (!thumb) document.body.classList.add("-shown");
}).observe(document.body, {attributeFilter: ["class"]});

byId("to-thumb").onclick = () => show(true);
byId("to-terminal").onclick = () => show(false);
byId("again").onclick = () => location.reload();
follow();
if (!thumb) focusTerminal();
