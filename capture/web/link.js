// The one websocket, which Textual's terminal opens. Messages for the page for a thumb are taken out of it, and touches are sent through it.

const JPEG = 0xff; // the first byte of a JPEG: no text begins with it
let socket = null;
const heard = {said: () => {}, picture: () => {}, opened: () => {}};

export function listen(handlers) {
  Object.assign(heard, handlers);
}

export function send(asked) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(["phone", asked]));
}

function take(event) {
  if (typeof event.data === "string") {
    const [kind, said] = JSON.parse(event.data);
    if (kind === "phone") heard.said(said);
  } else if (event.data.byteLength && new Uint8Array(event.data, 0, 1)[0] === JPEG) {
    event.stopImmediatePropagation();
    heard.picture(event.data);
  }
}

const Native = window.WebSocket;
window.WebSocket = class extends Native {
  constructor(...where) {
    super(...where);
    socket = this;
    this.addEventListener("message", take);
    this.addEventListener("open", () => heard.opened());
  }
};
