// A panel: a chart by Observable Plot that fits its width, answers to the pointer, and zooms by d3-zoom.

const SVG = "http://www.w3.org/2000/svg";
const MAX_ZOOM = 80;

/**
 * Add a panel to a figure.
 *
 * options(width): options of Plot.plot for a width in px. Its scales x and y have domains.
 * onClick: called with the datum under the pointer.
 * onPoint: called with the chart and the datum under the pointer, null if there is none.
 * zoomed: [left, right, top, bottom], what the panel shows at first; without it, all.
 * Returns a function that draws the panel again.
 */
function addPanel(host, {title, options, onClick, onPoint, label = "", zoomed = null}) {
  const panel = element("div", "panel"), heading = element("p", "panel-title");
  const frame = element("div", "chart"), reset = element("button", "reset", "reset zoom");
  frame.setAttribute("aria-label", label);
  reset.type = "button";
  reset.hidden = true;
  panel.append(heading, reset, frame);
  host.append(panel);
  let transform = Libraries.zoomIdentity, whole = null, current = null, waiting = false, width = 0;

  function draw() {
    waiting = false;
    const wanted = {...options(width), width};
    heading.textContent = keepNumbers(typeof title === "function" ? title() : title);
    const zooming = transform.k !== 1 || transform.x || transform.y;
    if (!whole || !zooming) {
      current = Libraries.Plot.plot(wanted);
      whole = {x: current.scale("x"), y: current.scale("y")};
    }
    if (zooming) {
      const x = {...wanted.x, domain: inside(whole.x, transform.x, transform.k)};
      const y = {...wanted.y, domain: inside(whole.y, transform.y, transform.k)};
      current = Libraries.Plot.plot({...wanted, x, y});
    }
    current.style.setProperty("--plot-background", "var(--paper)");
    frame.replaceChildren(current);
    const drawn = current;
    if (onPoint) drawn.addEventListener("input", () => onPoint(drawn, drawn.value));
    reset.hidden = !zooming;
  }
  function request() {
    if (!waiting && width) requestAnimationFrame(draw);
    waiting = width > 0;
  }
  let touched = false; // by a person: until then, a panel of another width shows the same area
  let ready = false; // the wheel zooms after a click, so that it scrolls the page until then
  const zoom = Libraries.zoom()
    .scaleExtent([1, MAX_ZOOM])
    .clickDistance(4)
    .extent(() => [[0, 0], [frame.clientWidth, frame.clientHeight]])
    .filter(event => event.type === "wheel" ? ready || event.ctrlKey || event.metaKey
      : event.type.startsWith("touch") ? event.touches.length > 1 : !event.button)
    .on("zoom", event => { transform = event.transform; touched ||= Boolean(event.sourceEvent); request(); });
  const chart = Libraries.select(frame).call(zoom);
  frame.addEventListener("pointerdown", () => { ready = true; }, {capture: true}); // Plot keeps the event to itself
  frame.addEventListener("pointerleave", () => { ready = false; });
  reset.addEventListener("click", () => { touched = true; chart.call(zoom.transform, Libraries.zoomIdentity); });
  if (onClick) frame.addEventListener("click", () => current?.value && onClick(current.value));
  new ResizeObserver(() => {
    const first = !width;
    width = Math.floor(frame.clientWidth);
    if (!width) return;
    zoom.translateExtent([[0, 0], [frame.clientWidth, frame.clientHeight || width]]);
    whole = null;
    const wanted = zoomed && !touched ? zoomOnto(zoomed, options(width), width) : transform;
    if (!first) {
      if (zoomed && !touched) chart.call(zoom.transform, wanted);
      return request();
    }
    transform = wanted;
    draw();
    zoom.translateExtent([[0, 0], [frame.clientWidth, frame.clientHeight]]);
    if (zoomed) chart.call(zoom.transform, transform);
  }).observe(frame);
  return request;
}

/** Return the part of a scale's domain that a zoom shows. */
function inside(scale, shift, factor) {
  return scale.range.map(place => scale.invert((place - shift) / factor));
}

/** Return the zoom that shows an area, [left, right, top, bottom], of a panel with square units. */
function zoomOnto([left, right, top, bottom], {x, y, height}, width) {
  const innerWidth = width - MARGINS.marginLeft - MARGINS.marginRight, innerHeight = height - MARGINS.marginTop - MARGINS.marginBottom;
  const perPixel = (x.domain[1] - x.domain[0]) / innerWidth;
  const factor = Math.max(1, Math.min(MAX_ZOOM, innerWidth * perPixel / (right - left), innerHeight * perPixel / Math.abs(bottom - top)));
  const middle = [MARGINS.marginLeft + ((left + right) / 2 - x.domain[0]) / perPixel,
    MARGINS.marginTop + Math.abs((top + bottom) / 2 - y.domain[1]) / perPixel];
  return Libraries.zoomIdentity
    .translate(MARGINS.marginLeft + innerWidth / 2 - factor * middle[0], MARGINS.marginTop + innerHeight / 2 - factor * middle[1]).scale(factor);
}

/** A mark of many dots as one path for each colour and group; a circle for each would make a slow page. */
function dots(points, colour, size = 4, opacity = 0.75, groupOf = () => "") {
  return (_, {x, y}, channels, {width, height, marginLeft, marginRight, marginTop, marginBottom}) => {
    const paths = new Map();
    for (const point of points) {
      const across = x(point.x), down = y(point.y);
      if (!(across >= marginLeft && across <= width - marginRight && down >= marginTop && down <= height - marginBottom)) continue;
      const own = typeof colour === "function" ? colour(point) : colour;
      const key = `${own}|${groupOf(point)}`, path = paths.get(key) ?? {own, group: groupOf(point), line: ""};
      path.line += `M${across.toFixed(1)} ${down.toFixed(1)}h0`;
      paths.set(key, path);
    }
    const group = document.createElementNS(SVG, "g");
    group.setAttribute("class", "dots");
    for (const {own, group: name, line} of paths.values()) {
      const path = document.createElementNS(SVG, "path");
      path.setAttribute("d", line);
      path.dataset.group = name;
      path.style.stroke = own;
      path.style.strokeWidth = size;
      path.style.opacity = opacity;
      group.append(path);
    }
    return group;
  };
}

/** A mark that says what stands next to the pointer. */
function tip(points, title, x = "x", y = "y", maxRadius = 24) {
  return Libraries.Plot.tip(points, Libraries.Plot.pointer({x, y, title, maxRadius, fontSize: 12, clip: null}));
}

const MARGINS = {marginLeft: 60, marginRight: 12, marginTop: 8, marginBottom: 34};
const AXIS = {labelAnchor: "center", labelArrow: "none"};

/** Options of a panel over the camera's picture. */
function pictureOptions(width, marks, more = {}) {
  const {width: columns, height: lines} = DATA.camera, inner = width - MARGINS.marginLeft - MARGINS.marginRight;
  return {
    ...MARGINS, height: Math.round(inner * lines / columns) + MARGINS.marginTop + MARGINS.marginBottom,
    x: {domain: [-0.5, columns - 0.5], label: "x (px)", ticks: 5, ...AXIS, tickFormat: String},
    y: {domain: [lines - 0.5, -0.5], label: "y (px)", ticks: 5, ...AXIS, tickFormat: String},
    clip: "frame", marks: [Libraries.Plot.frame({stroke: "var(--faint)", clip: null}), ...marks], ...more,
  };
}

/** Options of a panel with square units, from -reach to reach. */
function squareOptions(width, reach, label, marks) {
  const {marginLeft, marginRight, marginTop, marginBottom} = MARGINS, axis = {...AXIS, ticks: Math.min(5, Math.floor(width / 65))};
  return {
    ...MARGINS, height: width - marginLeft - marginRight + marginTop + marginBottom,
    x: {...axis, domain: [-reach, reach], label: `x (${label})`}, y: {...axis, domain: [reach, -reach], label: `y (${label})`},
    clip: "frame", marks: [Libraries.Plot.frame({stroke: "var(--faint)", clip: null}), ...marks],
  };
}

/** Options of a panel with two axes of different kinds. */
function chartOptions(width, height, x, y, marks) {
  const axis = {...AXIS, ticks: Math.max(3, Math.floor(width / 90))};
  return {
    ...MARGINS, height, x: {...axis, ...x}, y: {...axis, ticks: 5, ...y},
    clip: "frame", marks: [Libraries.Plot.frame({stroke: "var(--faint)", clip: null}), ...marks],
  };
}

/** Marks of a field on a grid: its colour, and lines at some levels. Between the nodes it is linear. */
function fieldMarks(field, values, limit, levels, {colour = () => BLUE, clip = "frame"} = {}) {
  const {x, y} = field, stepX = x[1] - x[0], stepY = y[1] - y[0];
  const grid = {
    width: x.length, height: y.length, x1: x[0] - stepX / 2, x2: x[x.length - 1] + stepX / 2,
    y1: y[0] - stepY / 2, y2: y[y.length - 1] + stepY / 2,
  };
  const strength = value => Number.isFinite(value) ? 0.04 + 0.9 * Math.min(1, Math.abs(value) / limit) : 0;
  const lines = levels.flatMap(level => contourLines(field, values, level));
  return [
    Libraries.Plot.raster(values, {...grid, fill: value => colour(value), fillOpacity: strength, clip}),
    ...lines.map(({points}) => Libraries.Plot.line(points, {x: "0", y: "1", stroke: "var(--ink)", strokeWidth: 0.9, clip})),
  ];
}

/** Return the lines of a level as {level, points}, without the border of the field and of what it leaves empty. */
function contourLines({x, y}, values, level) {
  const columns = x.length, lines = y.length, found = [];
  const [{coordinates}] = Libraries.contours().size([columns, lines]).thresholds([level])(values);
  const around = (place, count) => [Math.max(0, Math.floor(place - 0.01)), Math.min(count - 1, Math.ceil(place + 0.01))];
  const known = (across, down) => across >= 0 && down >= 0 && across <= columns - 1 && down <= lines - 1
    && around(across, columns).every(column => around(down, lines).every(row => Number.isFinite(values[row * columns + column])));
  for (const ring of coordinates.flat()) {
    let points = [];
    for (const [right, below] of ring) {
      const across = right - 0.5, down = below - 0.5; // d3 counts from the corners of cells
      if (known(across, down)) points.push([x[0] + across * (x[1] - x[0]), y[0] + down * (y[1] - y[0])]);
      else if (points.length) { found.push({level, points}); points = []; }
    }
    if (points.length) found.push({level, points});
  }
  return found.filter(({points}) => points.length > 1);
}

const LEVEL_LETTER = 6.4, LEVEL_HEIGHT = 14, MARK_SIZE = 18, LEAST_ROOM = 2; // px

/**
 * A mark of the levels' numbers on their lines, each where the panel has the most room for it.
 *
 * visible: for each node, whether it may have a number; without it, every node may.
 * marks: places {x, y} of other marks, which the numbers keep free.
 */
function levelLabels(field, values, levels, {unit = "", visible = null, marks = []} = {}) {
  const nearest = (nodes, place) => Math.round((place - nodes[0]) / (nodes[1] - nodes[0]));
  const isVisible = ([right, down]) => !visible || visible[nearest(field.y, down) * field.x.length + nearest(field.x, right)];
  const lines = levels.flatMap(level => contourLines(field, values, level)).map(({level, points}) => ({level, points: points.filter(isVisible)}));
  return (_, {x, y}, channels, {width, height, marginLeft, marginRight, marginTop, marginBottom}) => {
    const group = document.createElementNS(SVG, "g");
    const placed = marks.map(mark => ({across: x(mark.x), down: y(mark.y), half: MARK_SIZE / 2}));
    for (const level of levels) {
      const words = `${Number(level.toPrecision(3))}${unit}`, half = LEVEL_LETTER * words.length / 2;
      let best = {room: LEAST_ROOM};
      for (const {points} of lines.filter(line => line.level === level)) {
        const places = points.map(([right, down]) => ({across: x(right), down: y(down)}));
        if (Math.max(spread(places, "across"), spread(places, "down")) < 3 * half) continue; // the number would hide the line
        for (const {across, down} of places) {
          const room = Math.min(
            across - half - marginLeft, width - marginRight - half - across,
            down - LEVEL_HEIGHT / 2 - marginTop, height - marginBottom - LEVEL_HEIGHT / 2 - down,
            ...placed.map(other => Math.max(Math.abs(across - other.across) - half - other.half, Math.abs(down - other.down) - LEVEL_HEIGHT)),
          );
          if (room > best.room) best = {room, across, down};
        }
      }
      if (best.across === undefined) continue;
      placed.push({...best, half});
      const text = document.createElementNS(SVG, "text");
      text.textContent = words;
      text.setAttribute("x", best.across);
      text.setAttribute("y", best.down + 4);
      group.append(text);
    }
    group.setAttribute("class", "levels");
    return group;
  };
}

/** Return how far some places lie apart along an axis. */
function spread(places, axis) {
  const all = places.map(place => place[axis]);
  return Math.max(...all) - Math.min(...all);
}

const FIELD_SCALES = {color: {type: "identity"}, opacity: {type: "identity"}};

/** Return the nodes of a field as {x, y, value}, without those that have no value. */
function fieldNodes({x, y}, values) {
  return Array.from(values, (value, place) => ({x: x[place % x.length], y: y[Math.floor(place / x.length)], value, place}))
    .filter(node => Number.isFinite(node.value));
}

/** Add a slider of depths to a panel's host. It calls back with metres. */
function addDepthSlider(host, depth, [near, far], onChange) {
  const low = Math.log(Math.min(near / 2, depth)), high = Math.log(Math.max(far * 2, depth));
  const label = element("label", "slider", "depth "), slider = element("input"), shown = element("output");
  slider.type = "range";
  slider.min = 0;
  slider.max = 1000;
  slider.value = Math.round(1000 * (Math.log(depth) - low) / (high - low));
  slider.setAttribute("aria-label", "depth in metres");
  shown.textContent = `${digits(depth, 2)} m`;
  slider.addEventListener("input", () => {
    const chosen = Math.exp(low + slider.value / 1000 * (high - low));
    shown.textContent = `${digits(chosen, 2)} m`;
    onChange(chosen);
  });
  label.append(slider, shown);
  host.append(label);
}

/** Return the key of a field's colours. */
function colourKey(from, to, low = "transparent", high = BLUE) {
  const key = element("p", "key"), ramp = element("span", "ramp");
  ramp.style.background = `linear-gradient(to right, ${low}, ${high})`;
  key.append(element("span", "", keepNumbers(from)), ramp, element("span", "", keepNumbers(to)));
  return key;
}

/** Add the key of a figure's colours below its panels. */
function addColourKey(host, ...words) {
  host.after(colourKey(...words));
}
