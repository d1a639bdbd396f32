// The figures over the picture, the board, the glass and the depths.

function drawBoardErrors(host, {panels, errors}) {
  const worstLast = (first, second) => VIEW_ERRORS[first.view] - VIEW_ERRORS[second.view]; // and so above the others
  const sets = errors.map(packed => rows(packed).map(([x, y], row) => ({...CORNERS[row], x, y})).sort(worstLast));
  for (const {title, errors: set, reach} of panels) {
    const points = sets[set];
    addPanel(host, {
      title, label: "corner errors on the board", onClick: openCorner, onPoint: markView,
      options: width => squareOptions(width, reach, "mm", [
        Libraries.Plot.ruleX([0], {stroke: "var(--line)"}), Libraries.Plot.ruleY([0], {stroke: "var(--line)"}),
        dots(points, point => viewColour(point.view), 4, 0.75, point => point.view),
        tip(points, point => `${describeCorner(CORNERS[point.row])}\non the board ${digits(point.x, 2)}, ${digits(point.y, 2)} mm`),
      ]),
    });
  }
  addColourKey(host, `view error: ${digits(SMALLEST_ERROR, 2)} px`, `${digits(LARGEST_ERROR, 2)} px`, "var(--weak)", "var(--strong)");
}

/** Mark the dots of the pointed corner's view in a chart; null: of no view. */
function markView(chart, point) {
  for (const path of chart.querySelectorAll(".dots path")) path.classList.toggle("marked", point !== null && path.dataset.group === String(point.view));
}

function drawResiduals(host, {image, board, scales, span, bands, noise, noiseBands, highest}) {
  addArrowPanels(host, {image, board}, scales, span);
  addPanel(host, {
    title: `error by ${DATA.distanceName}; orange: RMS and 68 % band${numbers(noiseBands.noise).length ? "; dashes: the corners' noise" : ""}`, label: "residuals by depth", onClick: openCorner,
    options: width => byDistanceOptions(width, bands, noiseBands, highest),
  });
  addPanel(host, {
    title: `distribution of the errors${noise ? `; line: noise of ${digits(noise / Math.SQRT2, 2)} px in each of x and y` : ""}`, label: "histogram of the residuals",
    options: width => histogramOptions(width, CORNERS.flatMap(corner => [corner.dx, corner.dy]), noise),
  });
}

/** Add the mean residuals over the picture and over the board, from -span to span mm. scales: the length that is drawn for one px. */
function addArrowPanels(host, {image, board}, scales, span, when = "") {
  addPanel(host, {
    title: when + image.title, label: "mean residuals over the picture",
    options: width => pictureOptions(width, arrowMarks(image, scales.image, "of this cell")),
  });
  addPanel(host, {
    title: when + board.title, label: "mean residuals over the board",
    options: width => squareOptions(width, span, "mm", arrowMarks(board, scales.board, "of this corner in all views")),
  });
}

/** Draw the residuals of the given fit and those after a diagnosis, at the same scales. */
function drawComparison(host, {before, after, scales, span}) {
  const errorsOf = side => Array.from(numbers(side.errors)), limit = histogramLimit(errorsOf(before));
  for (const [when, side] of [["given fit", before], ["with effects", after]]) {
    addArrowPanels(host, side, scales, span, `${when}: `);
    addPanel(host, {
      title: `${when}: error ${digits(side.rms)} px`, label: "histogram of the residuals",
      options: width => histogramOptions(width, errorsOf(side), side.noise, limit),
    });
  }
  const earlier = numbers(before.views), later = numbers(after.views);
  const points = Array.from(earlier, (x, view) => ({x, y: later[view], view})), most = 1.08 * Math.max(...earlier, ...later);
  addPanel(host, {
    title: "each view", label: "errors of the views", onClick: ({view}) => openView(view),
    options: width => {
      const options = squareOptions(width, 1, "px", [
        Libraries.Plot.line([[0, 0], [most, most]], {x: "0", y: "1", stroke: "var(--faint)", strokeDasharray: "5 3"}),
        dots(points, ({view}) => viewColour(view), 7, 0.9),
        tip(points, ({view, x, y}) => `${nameOf(view)}\n${digits(x)} px first, ${digits(y)} px with the effects`),
      ]);
      return {...options, x: {...options.x, domain: [0, most], label: "given fit (px)"}, y: {...options.y, domain: [0, most], label: "with effects (px)"}};
    },
  });
}

/** Marks of mean errors as arrows; factor is their drawn length for one px. */
function arrowMarks(arrows, factor, where) {
  const place = rows(arrows.place), mean = rows(arrows.mean), significant = numbers(arrows.significant);
  const points = place.map(([x, y], row) => ({
    x, y, dx: mean[row][0], dy: mean[row][1], length: Math.hypot(...mean[row]), significant: significant[row],
  })).filter(point => Number.isFinite(point.length));
  return [
    Libraries.Plot.arrow(points, {
      x1: point => point.x - factor * point.dx / 2, x2: point => point.x + factor * point.dx / 2,
      y1: point => point.y - factor * point.dy / 2, y2: point => point.y + factor * point.dy / 2,
      stroke: point => point.significant ? "var(--series-1)" : "var(--faint)",
      strokeWidth: point => point.significant ? 1.8 : 1.1, headLength: 5, insetEnd: 0,
    }),
    tip(points, point => `mean ${where}: ${digits(point.length, 2)} px\n(${digits(point.dx, 2)}, ${digits(point.dy, 2)})`),
  ];
}

function byDistanceOptions(width, bands, noiseBands, highest) {
  const middle = numbers(bands.middle), rms = numbers(bands.rms), low = numbers(bands.low), high = numbers(bands.high);
  const points = CORNERS.map(corner => ({...corner, x: corner.distance, y: corner.length}));
  const far = points.reduce((most, point) => Math.max(most, point.x), 0), near = points.reduce((least, point) => Math.min(least, point.x), far);
  const steps = Array.from(middle, (x, band) => ({x, rms: rms[band], low: low[band], high: high[band]}));
  const pad = 0.03 * (far - near) || 0.01, levels = numbers(noiseBands.noise);
  const noise = Array.from(numbers(noiseBands.middle), (x, band) => ({x, y: levels[band]}));
  return chartOptions(
    width, Math.max(240, Math.round(0.62 * width)), {domain: [near - pad, far + pad], label: `${DATA.distanceName} (m)`},
    {domain: [0, highest], label: "error (px)"},
    [
      dots(points, BLUE, 3, 0.4),
      Libraries.Plot.areaY(steps, {x: "x", y1: "low", y2: "high", fill: "var(--series-1)", fillOpacity: 0.25}),
      Libraries.Plot.line(steps, {x: "x", y: "rms", stroke: "var(--series-1)", strokeWidth: 2}),
      Libraries.Plot.line(noise, {x: "x", y: "y", stroke: "var(--ink)", strokeWidth: 1.4, strokeDasharray: "5 3"}),
      Libraries.Plot.dot(noise, {x: "x", y: "y", r: 3, fill: "var(--ink)"}),
      tip(points, describeCorner),
    ],
  );
}

const BINS = 41;

/** Return a count for an axis, 1500 as 1.5k. */
function shortCount(count) {
  return count < 1000 ? String(count) : `${count / 1000}k`;
}

/** Return where the axis of a histogram ends: nearly all values lie between there and its opposite. */
function histogramLimit(values) {
  const sizes = values.filter(Number.isFinite).map(Math.abs).sort((a, b) => a - b);
  return 1.1 * sizes[Math.floor(0.996 * (sizes.length - 1))] || 1;
}

/** The distribution of the x and y of errors, and that of the noise alone. */
function histogramOptions(width, values, noise, limit = histogramLimit(values)) {
  const all = values.filter(Number.isFinite);
  const step = 2 * limit / BINS, counts = new Array(BINS).fill(0);
  for (const value of all) {
    const bin = Math.floor((value + limit) / step);
    if (bin >= 0 && bin < BINS) counts[bin] += 1;
  }
  const sigma = noise / Math.SQRT2; // noise is that of both axes together
  const normal = x => all.length * step / (sigma * Math.sqrt(2 * Math.PI)) * Math.exp(-0.5 * (x / sigma) ** 2);
  const bars = counts.map((count, bin) => ({x1: bin * step - limit, x2: (bin + 1) * step - limit, x: (bin + 0.5) * step - limit, count}));
  const curve = noise ? Array.from({length: 161}, (_, place) => ({x: (place / 80 - 1) * limit})).map(({x}) => ({x, y: normal(x)})) : [];
  const highest = 1.12 * Math.max(...counts, ...curve.map(point => point.y));
  return chartOptions(
    width, Math.max(240, Math.round(0.62 * width)), {domain: [-limit, limit], label: "error in x or in y (px)"},
    {domain: [0, highest], label: "number", tickFormat: shortCount},
    [
      Libraries.Plot.rectY(bars, {x1: "x1", x2: "x2", y: "count", fill: "var(--series-0)", fillOpacity: 0.7, inset: 0.5}),
      Libraries.Plot.line(curve, {x: "x", y: "y", stroke: "var(--ink)", strokeWidth: 1.6}),
      tip(bars, bar => `${digits(bar.x1, 2)} to ${digits(bar.x2, 2)} px: ${bar.count}`
        + (noise ? `\nnoise alone: ${Math.round(normal(bar.x))}` : ""), "x", "count", 60),
    ],
  );
}

/** Return the vectors of the distortion at a depth, on its grid. */
function distortionAt(field, depth) {
  return field.atInfinity.map(([x, y], node) => {
    const [alongX, alongY] = field.parallax[node];
    return {dx: x + alongX / depth, dy: y + alongY / depth};
  });
}

/** Return the grid of a figure's field, with the lists that its arrays hold. */
function gridOf(packed) {
  return {x: numbers(packed.x), y: numbers(packed.y)};
}

function distortionField(packed) {
  const pairs = array => Array.from({length: array.length / 2}, (_, row) => array.subarray(2 * row, 2 * row + 2));
  return {...gridOf(packed), atInfinity: pairs(numbers(packed.atInfinity)), parallax: pairs(numbers(packed.parallax))};
}

const ARROWS_ACROSS = 15;

function drawDistortion(host, packed) {
  const field = distortionField(packed), depths = [...packed.depths], redraws = [];
  const redrawAll = () => redraws.forEach(redraw => redraw());
  for (const place of depths.keys()) {
    const panelHost = element("div");
    host.append(panelHost);
    const where = () => packed.central ? "at every depth" : `at ${digits(depths[place], 2)} m`;
    redraws.push(addVectorPanel(panelHost, field, {
      title: where, label: "distortion over the picture", largest: packed.largest, levels: packed.levels,
      vectorsOf: () => distortionAt(field, depths[place]),
    }));
    if (!packed.central) addDepthSlider(panelHost, depths[place], packed.reach, chosen => { depths[place] = chosen; redrawAll(); });
  }
  addColourKey(host, "0", `${digits(packed.largest, 2)} px`);
  if (depths.length < 2) return;
  const [first, second] = depths.map(depth => distortionAt(field, depth));
  const change = vectorsBetween(first, second), largest = Math.max(...lengthsOf(change).filter(Number.isFinite)) || 1;
  const panelHost = element("div");
  host.append(panelHost);
  redraws.push(addVectorPanel(panelHost, field, {
    title: () => `${digits(depths[0], 2)} m minus ${digits(depths[1], 2)} m`, label: "difference of the distortion between two depths",
    largest, levels: Libraries.ticks(0, largest, 5).filter(level => level > 0 && level < largest),
    vectorsOf: () => vectorsBetween(...depths.map(depth => distortionAt(field, depth))),
  }));
}

function vectorsBetween(first, second) {
  return first.map(({dx, dy}, node) => ({dx: dx - second[node].dx, dy: dy - second[node].dy}));
}

function lengthsOf(vectors) {
  return vectors.map(({dx, dy}) => Math.hypot(dx, dy));
}

/** Add a panel of the vectors of a field: their lengths as colour and contours, and arrows. Returns a function that draws it again. */
function addVectorPanel(host, field, {title, label, vectorsOf, largest, levels}) {
  let range = [0, 0], factor = 1;
  return addPanel(host, {
    title: () => `${title()}: ${range.map(size => size < 1 ? digits(size, 2) : size.toFixed(1)).join(" to ")} px\narrows drawn ${digits(factor, 2)} times as long`, label,
    options: width => {
      const vectors = vectorsOf(), sizes = lengthsOf(vectors), known = sizes.filter(Number.isFinite);
      range = [Math.min(...known), Math.max(...known)];
      const nodes = fieldNodes(field, sizes).map(node => ({...node, ...vectors[node.place]}));
      const apart = Math.round(field.x.length / ARROWS_ACROSS);
      factor = Number((1.1 * DATA.camera.width / ARROWS_ACROSS / (range[1] || 1)).toPrecision(2));
      const sparse = nodes.filter(({place}) => place % field.x.length % apart === 1 && Math.floor(place / field.x.length) % apart === 1);
      return pictureOptions(width, [
        ...fieldMarks(field, sizes, largest, levels),
        Libraries.Plot.arrow(sparse, {
          x1: "x", y1: "y", x2: node => node.x + factor * node.dx, y2: node => node.y + factor * node.dy,
          stroke: "var(--faint)", strokeWidth: 1.1, headLength: 4, insetEnd: 0,
        }),
        levelLabels(field, sizes, levels, {unit: " px"}),
        tip(nodes, node => `at ${Math.round(node.x)}, ${Math.round(node.y)} px\n${digits(node.value)} px (${digits(node.dx)}, ${digits(node.dy)})`),
      ], FIELD_SCALES);
    },
  });
}

const MARK_COLOURS = [0, 1, 2, 3].map(series => `var(--series-${series})`);

function drawByDepth(host, packed) {
  const inverse = numbers(packed.inverse), mean = numbers(packed.mean), lengths = rows(packed.lengths), pixels = rows(packed.pixels);
  const field = gridOf(packed), change = Array.from(numbers(packed.change));
  const whole = DATA.figures.distortion && distortionField(DATA.figures.distortion);
  const lineOf = (values, mark, name, colour) => ({mark, name, colour, points: Array.from(values, (y, step) => ({x: inverse[step], y, name}))});
  const lines = lengths.map((values, pixel) => lineOf(
    values, packed.marks[pixel], `(${Array.from(pixels[pixel], Math.round).join(", ")})`, MARK_COLOURS[pixel]));
  lines.push(lineOf(mean, "╌", "mean", "var(--ink)"));
  const known = lines.filter(line => line.points.every(point => Number.isFinite(point.y)));
  let pointed = null;
  const redraw = addPanel(host, {
    title: "at four pixels", label: "distortion by inverse depth",
    options: width => {
      const shown = pointed ? [...known, pointed] : known, all = shown.flatMap(line => line.points);
      const perLine = width > 420 ? 2 : 1;
      const rise = line => line.points.at(-1).y - line.points[0].y;
      return chartOptions(
        width, Math.max(260, Math.round(0.7 * width)), {domain: [inverse[0], inverse.at(-1)], label: "inverse depth (1/m)", grid: true},
        {domain: [0, (perLine === 2 ? 1.45 : 1.8) * Math.max(...all.map(point => point.y))], label: "distortion (px)", grid: true},
        [
          Libraries.Plot.rect([packed.trained], {x1: "0", x2: "1", fill: "var(--faint)", fillOpacity: 0.15}),
          ...shown.map(line => Libraries.Plot.line(line.points, {
            x: "x", y: "y", stroke: line.colour, strokeWidth: 2, strokeDasharray: line.name === "mean" ? "5 3" : line === pointed ? "2 3" : "",
          })),
          ...shown.flatMap((line, place) => {
            const at = {frameAnchor: "top-left", dx: 8 + place % perLine * 0.5 * (width - 60), dy: 8 + 16 * Math.floor(place / perLine)};
            const text = `${line.name}: ${rise(line) < 0 ? "" : "+"}${rise(line).toFixed(2)} px`;
            return [
              Libraries.Plot.text([line.mark], {...at, fill: line.colour, fontWeight: 900}),
              Libraries.Plot.text([text], {...at, dx: at.dx + 16, fill: "var(--ink)"}),
            ];
          }),
          tip(all, point => `${point.name}\nat ${digits(1 / point.x, 2)} m: ${digits(point.y)} px`),
        ],
      );
    },
  });
  const nodes = fieldNodes(field, change), largest = Math.max(...nodes.map(node => node.value)), levels = Libraries.ticks(0, largest, 6);
  const marks = pixels.map(([x, y], mark) => ({x, y, mark}));
  addPanel(host, {
    title: "change per inverse depth, px per 1/m; a click adds the line of a pixel", label: "change of the distortion by inverse depth",
    onClick: node => {
      if (!whole) return;
      const [x, y] = whole.atInfinity[node.place], [alongX, alongY] = whole.parallax[node.place];
      pointed = lineOf(inverse.map(d => Math.hypot(x + alongX * d, y + alongY * d)), "┄", `(${Math.round(node.x)}, ${Math.round(node.y)})`, "var(--series-4)");
      redraw();
    },
    options: width => pictureOptions(width, [
      ...fieldMarks(field, change, largest, levels), levelLabels(field, change, levels, {marks}),
      Libraries.Plot.text(marks, {
        x: "x", y: "y", text: ({mark}) => packed.marks[mark], fill: ({mark}) => MARK_COLOURS[mark], fontSize: 15,
      }),
      tip(nodes, node => `at ${Math.round(node.x)}, ${Math.round(node.y)} px\n${digits(node.value)} px per 1/m`),
    ], FIELD_SCALES),
  });
}

function drawGlass(host, packed) {
  const field = gridOf(packed), visible = numbers(packed.visible), frame = rows(packed.frame);
  const outline = Libraries.Plot.line([...frame, frame[0]], {x: "0", y: "1", stroke: "var(--faint)"});
  const clip = {type: "Polygon", coordinates: [[...frame, frame[0]].map(point => Array.from(point))]};
  const panel = (title, values, limit, levels, colour, key, more) => {
    const panelHost = element("div");
    host.append(panelHost);
    addPanel(panelHost, {
      title, label: "the glass surface",
      options: width => glassOptions(width, packed, frame, [
        ...fieldMarks(field, values, limit, levels, {colour, clip}), outline, ...more, levelLabels(field, values, levels, {visible}),
        tip(fieldNodes(field, values).filter(({place}) => visible[place]), node => `${digits(node.value, 2)} µm\nat ${digits(node.x)}, ${digits(node.y)}`),
      ]),
    });
    panelHost.append(key);
  };
  const heights = colourKey(`${digits(-packed.limit, 2)} µm`, `${digits(packed.limit, 2)} µm`, `${ORANGE}, transparent`, BLUE);
  panel(packed.heightTitle, numbers(packed.height), packed.limit, Libraries.ticks(-packed.limit, packed.limit, 9), value => value < 0 ? ORANGE : BLUE, heights, []);
  if (!packed.sigma) return;
  const sigmas = colourKey("0", `${digits(packed.sigmaLimit, 2)} µm or more`);
  panel(packed.sigmaTitle, numbers(packed.sigma), packed.sigmaLimit, [], () => BLUE, sigmas, [dots(exitPoints(), "#808080", 2, 0.7)]);
}

function drawGlassDetail(host, packed) {
  const field = gridOf(packed), values = numbers(packed.height), colour = value => value < 0 ? ORANGE : BLUE;
  addPanel(host, {
    title: packed.heightTitle, label: "the glass in detail",
    options: width => pictureOptions(width, [
      ...fieldMarks(field, values, packed.limit, [], {colour}),
      tip(fieldNodes(field, values), node => `${digits(node.value, 3)} µm\nat ${Math.round(node.x)}, ${Math.round(node.y)} px`),
    ], FIELD_SCALES),
  });
  addColourKey(host, `${digits(-packed.limit, 2)} µm`, `${digits(packed.limit, 2)} µm`, `${ORANGE}, transparent`, BLUE);
}

/** Return where the corners' rays leave the glass. */
function exitPoints() {
  const packed = DATA.figures.coverage?.exits;
  return packed ? rows(packed).map(([x, y], row) => ({...CORNERS[row], x, y})) : [];
}

function glassOptions(width, {labels}, frame, marks) {
  const range = axis => {
    const places = frame.map(point => point[axis]), low = Math.min(...places), high = Math.max(...places);
    return [low - 0.04 * (high - low), high + 0.04 * (high - low)];
  };
  const [top, bottom] = range(1);
  const height = Math.max(240, Math.round(0.75 * width));
  return {...chartOptions(width, height, {domain: range(0), label: labels[0]}, {domain: [bottom, top], label: labels[1]}, marks), ...FIELD_SCALES};
}

const FILLED_ROW = 3; // panels
const CURVE_STEPS = 60;

function drawSigma(host, packed) {
  const chosen = packed.depths.slice();
  const redraws = chosen.map((depth, place) => {
    const panelHost = element("div");
    host.append(panelHost);
    const redraw = addSigmaMap(panelHost, packed, () => chosen[place]);
    addDepthSlider(panelHost, depth, packed.reach, moved => { chosen[place] = moved; redraws.forEach(draw => draw()); });
    return redraw;
  });
  if (chosen.length < FILLED_ROW) redraws.push(addSigmaCurve(host, packed, () => chosen));
  addColourKey(host, "0", `${digits(packed.limit, 2)} px or more`);
}

/** Add the map of the standard deviation at a depth, which may change. */
function addSigmaMap(host, packed, depthOf) {
  const field = gridOf(packed), variance = numbers(packed.variance), atCorners = numbers(packed.atCorners);
  return addPanel(host, {
    title: () => `at ${digits(depthOf(), 2)} m: ${digits(medianOf(sigmasAt(atCorners, depthOf())), 2)} px, median where board corners were`,
    label: "standard deviation of the map",
    options: width => {
      const depth = depthOf(), sigma = sigmasAt(variance, depth);
      const sorted = sigma.filter(Number.isFinite).sort((a, b) => a - b), quantile = part => sorted[Math.floor(part * (sorted.length - 1))];
      const levels = [...new Set([0.25, 0.5, 0.75, 0.95].map(part => Number(quantile(part).toPrecision(1))))];
      return pictureOptions(width, [
        ...fieldMarks(field, sigma, packed.limit, levels), dots(CORNERS, "#808080", 1.4, 0.5), levelLabels(field, sigma, levels),
        tip(fieldNodes(field, sigma), node => `${digits(node.value)} px\nat ${Math.round(node.x)}, ${Math.round(node.y)} px, ${digits(depth, 2)} m deep`),
      ], FIELD_SCALES);
    },
  });
}

/** Add the median and the largest standard deviation by depth. Dashes: the depths of the maps beside it. */
function addSigmaCurve(host, packed, depthsOf) {
  const variance = numbers(packed.variance), atCorners = numbers(packed.atCorners), [near, far] = packed.reach;
  const points = Array.from({length: CURVE_STEPS + 1}, (_, step) => {
    const depth = near * (far / near) ** (step / CURVE_STEPS);
    return {depth, median: medianOf(sigmasAt(atCorners, depth)), most: Math.max(...sigmasAt(variance, depth).filter(Number.isFinite))};
  });
  const highest = 1.05 * Math.max(...points.map(point => point.most)), pad = 0.03 * (far - near) || 0.01;
  return addPanel(host, {
    title: `sigma by ${DATA.distanceName}; blue: median over the corners; orange: largest`, label: "standard deviation by depth",
    options: width => chartOptions(
      width, pictureOptions(width, []).height, {domain: [near - pad, far + pad], label: `${DATA.distanceName} (m)`},
      {domain: [0, highest], label: "sigma (px)"},
      [
        Libraries.Plot.ruleX(depthsOf(), {stroke: "var(--faint)", strokeDasharray: "5 3"}),
        Libraries.Plot.line(points, {x: "depth", y: "most", stroke: "var(--series-1)", strokeWidth: 2}),
        Libraries.Plot.line(points, {x: "depth", y: "median", stroke: "var(--series-0)", strokeWidth: 2}),
        tip(points, point => `at ${digits(point.depth, 2)} m\nmedian ${digits(point.median, 2)} px\nlargest ${digits(point.most, 2)} px`, "depth", "median", 400),
      ],
    ),
  });
}

/** Return the standard deviations at a depth in m, from three coefficients of the variance each. */
function sigmasAt(variance, depth) {
  return Array.from({length: variance.length / 3}, (_, place) =>
    Math.sqrt(Math.max(0, variance[3 * place] + variance[3 * place + 1] / depth + variance[3 * place + 2] / depth ** 2)));
}

function medianOf(values) {
  const sorted = values.filter(Number.isFinite).sort((a, b) => a - b), middle = (sorted.length - 1) / 2;
  return (sorted[Math.floor(middle)] + sorted[Math.ceil(middle)]) / 2;
}

const DEPTH_BARS = 16;

function drawCoverage(host, packed) {
  const [lines, columns] = packed.counts.shape, {width: pixelWidth, height: pixelHeight} = DATA.camera;
  const cells = Array.from(numbers(packed.counts), (count, place) => ({
    count, x1: place % columns / columns * pixelWidth - 0.5, x2: (place % columns + 1) / columns * pixelWidth - 0.5,
    y1: Math.floor(place / columns) / lines * pixelHeight - 0.5, y2: (Math.floor(place / columns) + 1) / lines * pixelHeight - 0.5,
  }));
  const most = Math.max(...cells.map(cell => cell.count));
  addPanel(host, {
    title: packed.imageTitle, label: "corners over the picture",
    options: width => pictureOptions(width, [
      Libraries.Plot.rect(cells.filter(cell => cell.count), {x1: "x1", x2: "x2", y1: "y1", y2: "y2", fill: BLUE, fillOpacity: cell => 0.1 + 0.85 * cell.count / most}),
      dots(CORNERS, "#808080", 2, 0.6),
      tip(cells.map(cell => ({...cell, x: (cell.x1 + cell.x2) / 2, y: (cell.y1 + cell.y2) / 2})), cell => `${cell.count} corners`, "x", "y", 60),
    ], FIELD_SCALES),
  });
  const depths = CORNERS.map(corner => corner.distance).filter(Number.isFinite);
  const near = depths.reduce((a, b) => Math.min(a, b)), far = depths.reduce((a, b) => Math.max(a, b)), step = (far - near) / DEPTH_BARS || 1;
  const bars = Array.from({length: DEPTH_BARS}, (_, bar) => ({x1: near + bar * step, x2: near + (bar + 1) * step, x: near + (bar + 0.5) * step, count: 0}));
  for (const depth of depths) bars[Math.min(DEPTH_BARS - 1, Math.floor((depth - near) / step))].count += 1;
  addPanel(host, {
    title: packed.depthTitle, label: "corners by depth",
    options: width => chartOptions(
      width, Math.max(240, Math.round(0.75 * width)), {domain: [near, far === near ? near + 1 : far], label: `${DATA.distanceName} (m)`},
      {domain: [0, 1.1 * Math.max(...bars.map(bar => bar.count))], label: "corners", tickFormat: shortCount},
      [
        Libraries.Plot.rectY(bars, {x1: "x1", x2: "x2", y: "count", fill: "var(--series-0)", inset: 0.5}),
        tip(bars, bar => `${digits(bar.x1)} to ${digits(bar.x2)} m: ${bar.count} corners`, "x", "count", 80),
      ],
    ),
  });
  if (!packed.exits) return;
  const exits = exitPoints(), frame = rows(packed.frame);
  addPanel(host, {
    title: "glass: where the rays leave it", label: "exit points on the glass", onClick: openCorner,
    options: width => glassOptions(width, packed, frame, [
      Libraries.Plot.line([...frame, frame[0]], {x: "0", y: "1", stroke: "var(--faint)"}),
      dots(exits, BLUE, 3, 0.6), tip(exits, point => describeCorner(CORNERS[point.row])),
    ]),
  });
}
