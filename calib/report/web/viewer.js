// A view's picture with the residuals of its corners, magnified.

const DRAWN_ERROR = 1 / 30; // of the picture's width, for a typical error

/** Open the picture of a corner's view. */
function openCorner({view, row}) {
  openView(view, row);
}

function openView(view, marked = null) {
  const dialog = document.getElementById("viewer"), order = viewsByError();
  const place = order.indexOf(view), typical = VIEW_ERRORS.slice().sort()[VIEW_ERRORS.length >> 1] || 1e-3;
  const corners = CORNERS.filter(corner => corner.view === view && Number.isFinite(corner.length));
  const picture = document.querySelector(`.view[data-view="${view}"] img`)?.src;
  let factor = DRAWN_ERROR * DATA.camera.width / typical;
  const body = element("div", "viewer-body"), heading = element("h3", "", `${nameOf(view)}: ${VIEW_ERRORS[view].toFixed(3)} px`);
  const buttons = element("div", "buttons");
  const button = (text, action, disabled = false) => {
    const made = element("button", "", text);
    made.type = "button";
    made.disabled = disabled;
    made.addEventListener("click", action);
    buttons.append(made);
  };
  button("worse", () => openView(order[place - 1]), place === 0);
  button("better", () => openView(order[place + 1]), place === order.length - 1);
  button("close", () => dialog.close());
  const label = element("label", "slider", "errors enlarged "), slider = element("input"), shown = element("output");
  slider.type = "range";
  slider.min = 0;
  slider.max = 200;
  slider.value = 100;
  const middle = factor;
  label.append(slider, shown);
  body.append(heading, buttons, label);
  const said = () => { shown.textContent = `${digits(factor, 2)} times`; };
  said();
  const largest = Math.max(...corners.map(corner => corner.length), 1e-9);
  const across = corners.map(corner => corner.x), down = corners.map(corner => corner.y), around = 0.25;
  const area = (places, low = Math.min(...places), high = Math.max(...places)) => [low - around * (high - low), high + around * (high - low)];
  const redraw = addPanel(body, {
    title: "", zoomed: corners.length > 1 ? [...area(across), ...area(down)] : null, label: "residuals over the picture",
    options: width => pictureOptions(width, [
      pictureMark(picture),
      Libraries.Plot.arrow(corners, {
        x1: "x", y1: "y", x2: corner => corner.x + factor * corner.dx, y2: corner => corner.y + factor * corner.dy,
        stroke: corner => errorColour(corner.length / largest), strokeWidth: 2, headLength: 6, insetEnd: 0,
      }),
      dots(corners, corner => errorColour(corner.length / largest), 5, 1),
      Libraries.Plot.dot(corners.filter(corner => corner.row === marked), {x: "x", y: "y", r: 9, stroke: "var(--series-4)", strokeWidth: 2.5}),
      tip(corners, describeCorner),
    ], {color: {type: "identity"}}),
  });
  slider.addEventListener("input", () => { factor = middle * 10 ** ((slider.value - 100) / 100); said(); redraw(); });
  dialog.replaceChildren(body);
  if (!dialog.open) dialog.showModal();
}

/** Return the views, the worst first. */
function viewsByError() {
  return Array.from(VIEW_ERRORS.keys()).sort((first, second) => VIEW_ERRORS[second] - VIEW_ERRORS[first]);
}

/** A mark of the picture itself, which zooms with the axes. */
function pictureMark(source) {
  return (_, {scales: {x: across, y: down}, x, y}) => {
    const made = (tag, attributes) => {
      const node = document.createElementNS(SVG, tag);
      for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
      return node;
    };
    const {width, height} = DATA.camera, [left, right] = across.range, [bottom, top] = down.range;
    const frame = made("svg", {x: left, y: Math.min(top, bottom), width: right - left, height: Math.abs(bottom - top)}); // it cuts off the rest
    frame.append(made("image", {
      ...source ? {href: source} : {}, x: x(-0.5) - left, y: y(-0.5) - Math.min(top, bottom),
      width: x(width - 0.5) - x(-0.5), height: y(height - 0.5) - y(-0.5), preserveAspectRatio: "none",
    }));
    return frame;
  };
}

const ERROR_COLOURS = [[47, 143, 221], [240, 184, 56], [214, 48, 48]]; // from small to large

/** Return the colour of an error as a fraction of the largest. */
function errorColour(part) {
  const place = (ERROR_COLOURS.length - 1) * Math.min(1, Math.max(0, part)), first = Math.min(ERROR_COLOURS.length - 2, Math.floor(place));
  const mixed = ERROR_COLOURS[first].map((from, channel) => Math.round(from + (ERROR_COLOURS[first + 1][channel] - from) * (place - first)));
  return `rgb(${mixed.join(", ")})`;
}

function wireViews() {
  const dialog = element("dialog");
  dialog.id = "viewer";
  dialog.addEventListener("click", event => { if (event.target === dialog) dialog.close(); });
  document.body.append(dialog);
  for (const card of document.querySelectorAll(".view[data-view]")) {
    const shot = card.querySelector(".shot"), view = Number(card.dataset.view);
    shot.tabIndex = 0;
    shot.setAttribute("role", "button");
    shot.addEventListener("click", () => openView(view));
    shot.addEventListener("keydown", event => { if (event.key === "Enter") openView(view); });
  }
}
