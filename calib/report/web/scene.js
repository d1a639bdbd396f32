// The session in space, by three.js.

const BOARD_OPACITY = 0.3, POINTED_OPACITY = 0.8, OTHER_OPACITY = 0.1; // of faces: boards behind a board show through it
const SIGHT_COLOUR = "--series-2"; // of the border of what a camera sees
const NAME_LETTER = 8, NAME_HEIGHT = 16, NAME_GAP = 8; // px of a camera's name
const TICK_STEPS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50], MAX_TICKS = 6, TICK_PART = 0.08; // m; of the optical axis
const FIT_MARGIN = 0.08; // of half the picture, free beside the points that are shown
const BOX_FACES = [0, 1, 3, 0, 3, 2, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4, 2, 3, 7, 2, 7, 6, 0, 2, 6, 0, 6, 4, 1, 3, 7, 1, 7, 5];
const BOX_EDGES = [0, 1, 2, 3, 4, 5, 6, 7, 0, 2, 1, 3, 4, 6, 5, 7, 0, 4, 1, 5, 2, 6, 3, 7];
const BOX_FAINTNESS = 0.4; // of a box's faces, which show its points
const CROSS_PART = 0.02; // of a target's size, to each side of a point
const THREE_WORDS = "This browser draws no 3D (it has no WebGL).";

function drawScene(host, packed) {
  const three = Libraries.THREE, box = element("div", "scene"), canvas = element("canvas");
  const said = element("div", "scene-tip"), buttons = element("div", "buttons");
  host.append(buttons, box);
  if (!document.createElement("canvas").getContext("webgl2")) {
    box.replaceWith(element("p", "", THREE_WORDS));
    return;
  }
  box.append(canvas, said);
  said.hidden = true;
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "camera, cover and boards in space");
  const renderer = new three.WebGLRenderer({canvas, alpha: true, antialias: true, preserveDrawingBuffer: true});
  renderer.setPixelRatio(Math.min(2, devicePixelRatio));
  const scene = new three.Scene(), world = new three.Group(), camera = new three.PerspectiveCamera(38, 1, 0.002, 200);
  world.rotation.x = Math.PI; // from the camera's frame, y down and z ahead, to y up
  scene.add(world, new three.AmbientLight(0xffffff, 1.8), new three.DirectionalLight(0xffffff, 1.6));
  const theme = getComputedStyle(document.documentElement);
  const colour = name => new three.Color(theme.getPropertyValue(name).trim());
  const boards = addBoards(three, world, packed, colour);
  addCover(three, world, packed);
  const lines = addCamera(three, world, packed, colour), names = [addName(box, packed.name ?? "camera", world)];
  for (const other of packed.others ?? []) { // the further cameras of a rig, each in its own frame
    const frame = new three.Group();
    frame.matrixAutoUpdate = false;
    frame.matrix.set(...other.pose);
    world.add(frame);
    addCover(three, frame, other);
    lines.push(...addCamera(three, frame, other, colour));
    names.push(addName(box, other.name, frame));
  }
  const ruler = addRuler(three, box, world, packed.reach[1], colour);
  lines.push(ruler.line);
  names.push(...ruler.names);
  const rays = new three.LineSegments(new three.BufferGeometry(), new three.LineBasicMaterial({color: new three.Color(ORANGE)}));
  world.add(rays);

  const controls = new three.OrbitControls(camera, canvas);
  controls.enableZoom = false; // until a click, so that the wheel scrolls the page
  canvas.style.touchAction = "pan-y";
  const glass = packed.surfaces.flatMap(surface => Array.from(numbers(surface).filter(Number.isFinite), Math.abs));
  const size = Math.min(3 * (glass.length ? glass.reduce((a, b) => Math.max(a, b)) : 0.05), packed.reach[1]);
  const shown = scenePoints(three, boards, packed);
  const from = (...direction) => () => fittingPlace(three, camera, shown, new three.Vector3(...direction).normalize());
  const places = {
    whole: from(-0.8, 0.4, 0.5),
    ...packed.surfaces.length ? {cover: () => [[-0.9 * size, 0.7 * size, 0.9 * size], [0, 0, 0]]} : {},
    "from above": from(-1e-3, 1, 0), "from the side": from(-1, 0, 0),
  };
  const render = () => {
    renderer.render(scene, camera);
    placeNames(three, box, names, camera);
  };
  const goTo = ([position, target]) => {
    camera.position.set(...position);
    controls.target.set(...target);
    controls.update();
    render();
  };
  for (const [name, place] of Object.entries(places)) {
    const button = element("button", "", name);
    button.type = "button";
    button.addEventListener("click", () => goTo(place()));
    buttons.append(button);
  }
  controls.addEventListener("change", render);
  new ResizeObserver(() => {
    const {clientWidth: width, clientHeight: height} = box;
    if (!width) return;
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    render();
  }).observe(box);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    const inked = boards.flatMap(board => board.children).filter(line => line.userData.colour);
    for (const line of [...lines, ...inked]) line.material.color = colour(line.userData.colour);
    render();
  });

  const pointer = new three.Raycaster();
  let pointed = null, pressed = null;
  function look(event) {
    const area = canvas.getBoundingClientRect();
    pointer.setFromCamera(new three.Vector2(2 * (event.clientX - area.left) / area.width - 1, 1 - 2 * (event.clientY - area.top) / area.height), camera);
    const view = pointer.intersectObjects(boards, false)[0]?.object.userData.view ?? null;
    said.style.left = `${Math.min(event.clientX - area.left + 14, area.width - 170)}px`;
    said.style.top = `${event.clientY - area.top + 14}px`;
    if (view !== pointed) point(view);
  }
  function point(view) {
    pointed = view;
    said.hidden = view === null;
    canvas.style.cursor = view === null ? "grab" : "pointer";
    for (const board of boards) board.material.opacity = board.userData.faces * (view === null ? BOARD_OPACITY : board.userData.view === view ? POINTED_OPACITY : OTHER_OPACITY);
    const segments = view === null ? [] : raysOf(packed, view).flatMap(({points}) => points.slice(1).flatMap((next, step) => [...points[step], ...next]));
    rays.geometry.dispose();
    rays.geometry = new three.BufferGeometry().setAttribute("position", new three.Float32BufferAttribute(segments, 3));
    if (view !== null) said.textContent = `${nameOf(view)}\n${VIEW_ERRORS[view].toFixed(3)} px, ${digits(Math.hypot(...POSES[view].slice(3)), 2)} m away`;
    box.dataset.view = view ?? "";
    box.dataset.rays = segments.length / 6;
    render();
  }
  canvas.addEventListener("pointermove", look);
  canvas.addEventListener("pointerleave", () => { controls.enableZoom = false; point(null); });
  canvas.addEventListener("pointerdown", event => { controls.enableZoom = true; pressed = [event.clientX, event.clientY]; });
  canvas.addEventListener("click", event => {
    if (!pressed || Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return; // it was turned
    look(event);
    if (pointed !== null && !packed.others) openView(pointed);
  });
  camera.aspect = box.clientWidth / box.clientHeight;
  goTo(places.whole());
  addLegend(host, packed);
  addColourKey(host, `board error: ${digits(packed.errors[0], 2)} px`, `${digits(packed.errors[1], 2)} px or more`, `${errorColour(0)}, ${errorColour(0.5)}`, errorColour(1));
  box.camera = camera; // for whoever looks at the page with a program
}

/** Return the points that a place to look from shows, in the frame of the scene: the corners of the boards, the cameras, the borders of what they see, and the cover. */
function scenePoints(three, boards, packed) {
  const corners = boards.flatMap(board => {
    const place = board.geometry.attributes.position;
    return Array.from({length: place.count}, (_, corner) => new three.Vector3(place.getX(corner), -place.getY(corner), -place.getZ(corner)));
  });
  const fields = [packed, ...packed.others ?? []].flatMap(camera => {
    const {matrix} = new three.Group();
    if (camera.pose) matrix.set(...camera.pose);
    return fieldBorders(camera, camera.reach[1]).flat().map(place => new three.Vector3(...place).applyMatrix4(matrix));
  }).map(({x, y, z}) => new three.Vector3(x, -y, -z));
  const cameras = (packed.others ?? []).map(({pose}) => new three.Vector3(pose[3], -pose[7], -pose[11]));
  const glass = packed.surfaces.flatMap(surface => rows({...surface, shape: [surface.shape[0] * surface.shape[1], 3]}))
    .filter(place => place.every(Number.isFinite)).map(([x, y, z]) => new three.Vector3(x, -y, -z));
  return [...corners, new three.Vector3(), ...cameras, ...fields, ...glass];
}

/**
 * Return where the camera stands, and the point that it looks at, so that some points just fit into its picture.
 *
 * direction: from the points to the camera. The camera's sides are planes: each touches the point that lies farthest out.
 */
function fittingPlace(three, camera, points, direction) {
  const right = new three.Vector3(0, 1, 0).cross(direction).normalize(), up = direction.clone().cross(right);
  const tall = Math.tan(camera.fov / 2 * Math.PI / 180) * (1 - FIT_MARGIN), wide = tall * camera.aspect;
  const reach = (axis, slope) => Math.max(...points.map(point => point.dot(axis) + slope * point.dot(direction)));
  const [rightmost, leftmost] = [right, right.clone().negate()].map(axis => reach(axis, wide));
  const [highest, lowest] = [up, up.clone().negate()].map(axis => reach(axis, tall));
  const away = Math.max((rightmost + leftmost) / (2 * wide), (highest + lowest) / (2 * tall));
  const depth = points.reduce((sum, point) => sum + point.dot(direction), 0) / points.length; // it turns about their middle
  const at = length => right.clone().multiplyScalar((rightmost - leftmost) / 2)
    .addScaledVector(up, (highest - lowest) / 2).addScaledVector(direction, length).toArray();
  return [at(away), at(depth)];
}

/** Add a quadrilateral for every board, with lines through its corners, or a box with the points of a target that is not flat, and return them. */
function addBoards(three, world, packed, colour) {
  const [smallest, largest] = packed.errors, faces = packed.box ? BOX_FAINTNESS : 1;
  const points = rows(DATA.board.points), {columns} = DATA.board, count = points.length, seen = packed.box ? pointsOfViews() : [];
  return POSES.map((pose, view) => {
    const outline = packed.box ? boxCorners(view, packed.box) : boardOutline(view, packed.half), corners = points.map(place => onBoard(pose, place));
    const geometry = new three.BufferGeometry();
    geometry.setAttribute("position", new three.Float32BufferAttribute(outline.flat(), 3));
    geometry.setIndex(packed.box ? BOX_FACES : [0, 1, 2, 0, 2, 3]);
    const part = largest > smallest ? Math.min(1, Math.max(0, (VIEW_ERRORS[view] - smallest) / (largest - smallest))) : 0;
    const board = new three.Mesh(geometry, new three.MeshBasicMaterial({
      color: new three.Color(errorColour(part)), side: three.DoubleSide, transparent: true, opacity: faces * BOARD_OPACITY, depthWrite: false,
    }));
    Object.assign(board.userData, {view, faces});
    const grid = [];
    if (count > columns) { // a target of points has no lines
      for (let first = 0; first < count; first += columns) grid.push(corners[first], corners[first + columns - 1]);
      for (let first = 0; first < columns; first += 1) grid.push(corners[first], corners[count - columns + first]);
    }
    const own = () => board.material.color.clone();
    const border = lineSegments(three, packed.box ? BOX_EDGES.map(corner => outline[corner]) : ring(outline), own, "", 1);
    board.add(border, lineSegments(three, grid, colour, "--ink", 0.15));
    if (packed.box) board.add(lineSegments(three, seen[view].flatMap(corner => cross(corners[corner], packed.half)), own, "", 1));
    world.add(board);
    return board;
  });
}

/** Return for every view the points that it shows and the figures draw. */
function pointsOfViews() {
  const seen = POSES.map(() => []), corners = numbers(DATA.corners.corner);
  numbers(DATA.corners.view).forEach((view, row) => seen[view].push(corners[row]));
  return seen;
}

/** Return the ends of three lines that cross at a point. */
function cross(point, half) {
  const reach = CROSS_PART * Math.max(...half);
  return [0, 1, 2].flatMap(axis => [-reach, reach].map(step => point.map((value, place) => value + (place === axis ? step : 0))));
}

function addCover(three, world, packed) {
  for (const [place, surface] of packed.surfaces.entries()) {
    const [lines, columns] = surface.shape, geometry = new three.BufferGeometry(), all = numbers(surface), faces = [];
    for (let row = 0; row + 1 < lines; row += 1) {
      for (let column = 0; column + 1 < columns; column += 1) {
        const first = row * columns + column, square = [first, first + 1, first + columns, first + columns + 1];
        if (square.every(corner => Number.isFinite(all[3 * corner]))) faces.push(square[0], square[2], square[1], square[1], square[2], square[3]);
      }
    }
    geometry.setAttribute("position", new three.Float32BufferAttribute(all.map(value => Number.isFinite(value) ? value : 0), 3));
    geometry.setIndex(faces);
    geometry.computeVertexNormals();
    const glass = new three.Mesh(geometry, new three.MeshLambertMaterial({
      color: new three.Color(BLUE), side: three.DoubleSide, transparent: true, opacity: place ? 0.22 : 0.16, depthWrite: false,
    }));
    world.add(glass);
  }
}

/** Return the rays of the picture's corners to a distance, m, each a list of points; without those that do not leave the cover. */
function fieldBorders(packed, far) {
  const ahead = rows(packed.borderDirection);
  return rows(packed.border).map((way, corner) => {
    const points = Array.from({length: way.length / 3}, (_, step) => Array.from(way.subarray(3 * step, 3 * step + 3)));
    const last = points.at(-1);
    points.push(last.map((value, axis) => value + 1.05 * far * ahead[corner][axis]));
    return points;
  }).filter(points => points.flat().every(Number.isFinite));
}

/** Add the camera's body and the border of what it sees, from the rays of the picture's four corners, and return their lines. */
function addCamera(three, world, packed, colour) {
  const borders = fieldBorders(packed, packed.reach[1]);
  const segments = borders.flatMap(points => points.slice(1).flatMap((next, step) => [points[step], next]));
  if (borders.length === 4) segments.push(...ring(borders.map(points => points.at(-1))));
  const field = lineSegments(three, segments, colour, SIGHT_COLOUR, 0.8);
  const size = 0.012, {width, height} = DATA.camera, side = size * 0.5, up = side * height / width;
  const window_ = [[-side, -up, size], [side, -up, size], [side, up, size], [-side, up, size]];
  const body = [...ring(window_), ...window_.flatMap(corner => [[0, 0, 0], corner])];
  const lens = lineSegments(three, body, colour, "--ink", 1);
  world.add(field, lens);
  return [field, lens];
}

/** Add the optical axis with a tick and a distance every few centimetres, as far as the boards are, and return its lines and its names. */
function addRuler(three, box, world, far, colour) {
  const step = TICK_STEPS.find(length => far / length <= MAX_TICKS) ?? far, points = [[0, 0, 0], [0, 0, far]], names = [];
  for (let count = 1; count * step <= far; count += 1) {
    const depth = count * step, half = step * TICK_PART, tick = new three.Group();
    points.push([-half, 0, depth], [half, 0, depth]);
    tick.position.set(0, 0, depth);
    world.add(tick);
    names.push(addName(box, `${Number(depth.toFixed(3))} m`, tick));
  }
  const line = lineSegments(three, points, colour, "--ink", 0.5);
  world.add(line);
  return {line, names};
}

/** Return the ends of the lines from each point to the next one, and from the last to the first. */
function ring(points) {
  return points.flatMap((point, place) => [point, points[(place + 1) % points.length]]);
}

/** Return lines between pairs of points. name: that of their colour, which differs on light and on dark. */
function lineSegments(three, points, colour, name, opacity) {
  const geometry = new three.BufferGeometry().setAttribute("position", new three.Float32BufferAttribute(points.flat(), 3));
  const lines = new three.LineSegments(geometry, new three.LineBasicMaterial({color: colour(name), transparent: true, opacity}));
  lines.userData.colour = name;
  return lines;
}

/** Add the name of a camera, whose origin is that of an object. */
function addName(box, text, object) {
  const label = element("span", "scene-name", text);
  box.append(label);
  return {label, object, text};
}

/** Move the names beside their cameras as the scene shows them, below or above; without room, a name is hidden. */
function placeNames(three, box, names, camera) {
  const placed = [];
  for (const {label, object, text} of names) {
    const {x, y, z} = object.getWorldPosition(new three.Vector3()).project(camera);
    const width = NAME_LETTER * text.length, left = Math.min((x + 1) / 2 * box.clientWidth + NAME_GAP, box.clientWidth - width - NAME_GAP);
    const near = placed.filter(other => left < other.left + other.width && other.left < left + width);
    const top = [NAME_GAP, -NAME_GAP - NAME_HEIGHT]
      .map(shift => Math.min((1 - y) / 2 * box.clientHeight + shift, box.clientHeight - NAME_HEIGHT))
      .find(line => near.every(other => Math.abs(other.top - line) >= NAME_HEIGHT));
    label.hidden = top === undefined || Math.max(Math.abs(x), Math.abs(y), Math.abs(z)) > 1;
    if (label.hidden) continue;
    placed.push({left, top, width});
    label.style.left = `${left}px`;
    label.style.top = `${top}px`;
  }
}

/** Add what the lines and faces of the scene are. */
function addLegend(host, packed) {
  const legend = element("p", "key legend"), rays = numbers(packed.rayView).length > 0;
  const entries = [[`var(${SIGHT_COLOUR})`, "line", "border of what the camera sees"], ["var(--ink)", "line", "optical axis, with the distance from the lens"]];
  if (packed.surfaces.length) entries.push([BLUE, "face", "cover"]);
  if (rays) entries.push([ORANGE, "line", "rays to the board that you point at"]);
  for (const [colour, kind, text] of entries) {
    const entry = element("span", "", text), sample = element("i", kind);
    sample.style.background = colour;
    entry.prepend(sample);
    legend.append(entry);
  }
  host.after(legend);
}
