// The session in space: shared geometry, and the cover from the side and from above.

/** Return the (3,) m in the camera frame of a point on a view's board, m. */
function onBoard([rx, ry, rz, tx, ty, tz], [x, y, z = 0]) {
  const angle = Math.hypot(rx, ry, rz), scale = angle > 1e-12 ? Math.sin(angle) / angle : 1;
  const half = angle > 1e-12 ? (1 - Math.cos(angle)) / angle ** 2 : 0.5, dot = rx * x + ry * y + rz * z;
  const cosine = Math.cos(angle); // Rodrigues' formula
  return [
    cosine * x + scale * (ry * z - rz * y) + half * dot * rx + tx,
    cosine * y + scale * (rz * x - rx * z) + half * dot * ry + ty,
    cosine * z + scale * (rx * y - ry * x) + half * dot * rz + tz,
  ];
}

const POSES = rows(DATA.views.pose);

/** Return the four outer corners of a view's board in the camera frame, m. */
function boardOutline(view, [halfX, halfY]) {
  return [[-halfX, -halfY], [halfX, -halfY], [halfX, halfY], [-halfX, halfY]].map(place => onBoard(POSES[view], place));
}

/** Return the eight corners of the box around a target that is not flat, in the camera frame, m. */
function boxCorners(view, box) {
  const ends = rows(box);
  return Array.from({length: 8}, (_, corner) => onBoard(POSES[view], [0, 1, 2].map(axis => ends[corner >> axis & 1][axis])));
}

/** Return the rays of a view: lists of points from the lens through every surface to the corner. */
function raysOf(packed, view) {
  const ways = rows(packed.rays), corners = numbers(packed.rayCorner), views = numbers(packed.rayView);
  return Array.from(views.keys()).filter(ray => views[ray] === view).map(ray => ({
    corner: corners[ray], points: Array.from({length: ways[ray].length / 3}, (_, step) => Array.from(ways[ray].subarray(3 * step, 3 * step + 3))),
  }));
}

function drawSideView(host, packed) {
  const space = DATA.figures.scene, distances = POSES.map(pose => Math.hypot(...pose.slice(3)));
  const byDistance = Array.from(POSES.keys()).sort((first, second) => distances[first] - distances[second]);
  let view = byDistance[byDistance.length >> 1];
  const label = element("label", "slider", "board "), select = element("select");
  for (const choice of byDistance) {
    const option = element("option", "", `${nameOf(choice)}, ${digits(distances[choice], 2)} m`);
    option.value = choice;
    select.append(option);
  }
  select.value = view;
  label.append(select);
  const draws = [
    sidePanel(host, packed, space, () => view, "side", "from the side", [2, 1], "y"),
    sidePanel(host, packed, space, () => view, "above", "from above", [2, 0], "x"),
  ];
  select.addEventListener("change", () => { view = Number(select.value); draws.forEach(draw => draw()); });
  const list = element("dl", "numbers");
  for (const [name, value] of packed.numbers) {
    const item = element("div");
    item.append(element("dt", "", name), element("dd", "", value));
    list.append(item);
  }
  host.before(label);
  host.after(list);
}

/** Add a cut of the cover. axes: the components that go to the right and down. */
function sidePanel(host, packed, space, viewOf, plane, title, axes, downName) {
  const flat = point => ({x: 1e3 * point[axes[0]], y: 1e3 * point[axes[1]]}); // mm
  const surfaces = packed.profiles[plane].map(profile => rows(profile).map(flat));
  const glass = surfaces.flat().filter(point => Number.isFinite(point.x + point.y));
  const extreme = [...glass, {x: 0, y: 0}, ...packed.round ? [flat(packed.origin)] : []];
  const ends = axis => [Math.min(...extreme.map(point => point[axis])), Math.max(...extreme.map(point => point[axis]))];
  const [left, right] = ends("x"), [top, bottom] = ends("y"), middle = [(left + right) / 2, (top + bottom) / 2];
  const boards = POSES.map((_, view) => boardOutline(view, space.half).map(flat));
  const farthest = Math.max(right, ...boards.flat().map(point => point.x));
  const size = width => {
    const height = Math.round(0.72 * width), inner = width - MARGINS.marginLeft - MARGINS.marginRight;
    const from = Math.min(left, 0) - 0.02 * farthest, to = 1.02 * farthest, perPixel = (to - from) / inner;
    const half = (height - MARGINS.marginTop - MARGINS.marginBottom) * perPixel / 2;
    return {height, from, to, half};
  };
  const alongPlane = ({corner}) => plane === "side"
    ? corner % DATA.board.columns === DATA.board.columns >> 1
    : Math.floor(corner / DATA.board.columns) === DATA.board.rows >> 1;
  return addPanel(host, {
    title, label: `the cover ${title}`,
    zoomed: [middle[0] - 0.7 * (right - left), middle[0] + 0.7 * (right - left), middle[1] - 0.8 * (bottom - top), middle[1] + (bottom - top)],
    options: width => {
      const {height, from, to, half} = size(width), view = viewOf();
      const rays = raysOf(space, view).filter(alongPlane).map(({corner, points}) => ({corner, points: points.map(flat)}));
      const bends = rays.flatMap(ray => ray.points.map((point, step) => ({...point, step, corner: ray.corner})));
      const axis = {...AXIS, ticks: 6};
      return {
        ...MARGINS, height, clip: "frame",
        x: {...axis, domain: [from, to], label: "z, ahead (mm)"}, y: {...axis, domain: [half, -half], label: `${downName} (mm)`},
        marks: [
          Libraries.Plot.frame({stroke: "var(--faint)", clip: null}),
          ...boards.map((board, own) => Libraries.Plot.line([...board, board[0]], {
            x: "x", y: "y", stroke: own === view ? "var(--series-1)" : "var(--line)", strokeWidth: own === view ? 2 : 1,
          })),
          ...glassBodies(surfaces),
          ...rays.map(ray => Libraries.Plot.line(ray.points, {x: "x", y: "y", stroke: "var(--series-1)", strokeWidth: 1.2})),
          ...dimensionMarks(packed, surfaces, flat, [top, bottom]),
          Libraries.Plot.dot([{x: 0, y: 0}], {x: "x", y: "y", r: 4, fill: "var(--ink)"}),
          tip(bends, ({corner, step, x, y}) => `ray to the corner in column ${corner % DATA.board.columns + 1}, row ${Math.floor(corner / DATA.board.columns) + 1}`
            + `\n${step === 0 ? "leaves the lens" : step > surfaces.length ? "reaches the corner" : `meets surface ${step}`} at ${digits(x, 4)}, ${digits(y, 4)} mm`),
        ],
      };
    },
  });
}

/** Marks of the glass between each surface and the next one. */
function glassBodies(surfaces) {
  const known = surface => surface.filter(point => Number.isFinite(point.x + point.y));
  return surfaces.flatMap((surface, place) => {
    const inner = known(surface), outer = surfaces[place + 1] && known(surfaces[place + 1]);
    const edge = Libraries.Plot.line(inner, {x: "x", y: "y", stroke: "var(--series-0)", strokeWidth: 1.5});
    if (!outer || place % 2) return [edge];
    const body = [...inner, ...outer.slice().reverse()];
    return [Libraries.Plot.line(body, {x: "x", y: "y", stroke: "none", fill: "var(--series-0)", fillOpacity: 0.22}), edge];
  });
}

/** Marks of the numbers that place and size the cover, as docs/measuring.md draws them: above and below the glass, with thin lines down to them. */
function dimensionMarks(packed, surfaces, flat, [top, bottom]) {
  const texts = new Map(packed.numbers), origin = flat(packed.origin);
  const crossing = (surface, level) => surface.filter(point => Number.isFinite(point.x + point.y) && point.x > 0)
    .reduce((best, point) => Math.abs(point.y - level) < Math.abs(best.y - level) ? point : best, {x: NaN, y: Infinity});
  const tall = bottom - top, inner = crossing(surfaces[0], 0).x, lines = [], labels = [], threads = [];
  const add = (name, x1, x2, y) => {
    if (!texts.has(name)) return;
    lines.push({x1, x2, y});
    threads.push(...[x1, x2].map(x => ({x, y1: 0, y2: y + 0.02 * tall * Math.sign(y)})));
    labels.push({x: (x1 + x2) / 2, y, text: `${name.replaceAll("_", " ").replace(".", " ")} ${texts.get(name)}`});
  };
  if (packed.round) {
    add("inner_radius", origin.x, inner, bottom + 0.2 * tall);
    for (const name of ["axis_offset.z", "centre.z"]) add(name, 0, origin.x, bottom + 0.42 * tall);
  } else {
    add("distance", 0, inner, bottom + 0.2 * tall);
  }
  if (surfaces[1]) add("thickness", inner, crossing(surfaces[1], 0).x, top - 0.06 * tall);
  return [
    ...packed.round ? [Libraries.Plot.dot([origin], {x: "x", y: "y", symbol: "times", r: 6, stroke: "var(--faint)", strokeWidth: 2})] : [],
    Libraries.Plot.ruleX(threads, {x: "x", y1: "y1", y2: "y2", stroke: "var(--series-4)", strokeWidth: 0.6, strokeDasharray: "2 3"}),
    Libraries.Plot.link(lines, {x1: "x1", x2: "x2", y1: "y", y2: "y", stroke: "var(--series-4)", strokeWidth: 1.4, markerStart: "arrow-reverse", markerEnd: "arrow"}),
    dimensionLabels(labels),
  ];
}

const LETTER_WIDTH = 7, LINE_HEIGHT = 14; // px of a label in a panel
const WITH_SIGMA = 360; // px: a narrower panel has no room for standard deviations

/** A mark of labels above their lines, each inside of the panel and none over another. */
function dimensionLabels(labels) {
  return (_, {x, y}, channels, {width, height, marginLeft, marginRight, marginTop, marginBottom}) => {
    const group = document.createElementNS(SVG, "g"), placed = [];
    for (const label of labels) {
      const words = width < WITH_SIGMA ? label.text.replace(/ ± \S+/, "") : label.text;
      const half = LETTER_WIDTH * words.length / 2, left = marginLeft + half + 3, right = width - marginRight - half - 3;
      const across = Math.max(left, Math.min(right, x(label.x)));
      let down = y(label.y) - 9;
      if (!(down > marginTop && down < height - marginBottom)) continue; // its line is outside of the panel
      while (placed.some(other => Math.abs(other.across - across) < half + other.half && Math.abs(other.down - down) < LINE_HEIGHT)) down += LINE_HEIGHT;
      placed.push({across, down, half});
      const text = document.createElementNS(SVG, "text");
      text.textContent = words;
      text.setAttribute("x", across);
      text.setAttribute("y", down + 3);
      group.append(text);
    }
    group.setAttribute("class", "dimensions");
    return group;
  };
}
