// The corners and views that all figures of a report share.

const CORNERS = unpackCorners(DATA.corners);

/** Return every shown corner as {view, corner, x, y, dx, dy, length, distance}: px, and distances in m. */
function unpackCorners(packed) {
  const view = numbers(packed.view), corner = numbers(packed.corner), distance = numbers(packed.distance);
  const pixel = rows(packed.pixel), error = rows(packed.error);
  return Array.from(view, (_, row) => ({
    row, view: view[row], corner: corner[row], distance: distance[row],
    x: pixel[row][0], y: pixel[row][1], dx: error[row][0], dy: error[row][1],
    length: Math.hypot(...error[row]),
  }));
}

const VIEW_ERRORS = numbers(DATA.views.error);
const SMALLEST_ERROR = Math.min(...VIEW_ERRORS), LARGEST_ERROR = Math.max(...VIEW_ERRORS);

/** Return the colour of a view: one hue, the stronger the larger its error. */
function viewColour(view) {
  const part = (VIEW_ERRORS[view] - SMALLEST_ERROR) / (LARGEST_ERROR - SMALLEST_ERROR || 1);
  return `color-mix(in oklab, var(--strong) ${Math.round(100 * part)}%, var(--weak))`;
}

/** Return a name that one can read, whatever letters a file name has. */
function nameOf(view) {
  return DATA.views.name[view];
}

function describeCorner({view, corner, dx, dy, length, distance}) {
  const column = corner % DATA.board.columns + 1, row = Math.floor(corner / DATA.board.columns) + 1;
  const place = DATA.board.rows > 1 ? `corner in column ${column}, row ${row}` : `point ${corner + 1}`;
  return `${nameOf(view)}\n${place}\n`
    + `error ${digits(length)} px (${digits(dx, 2)}, ${digits(dy, 2)})\n${DATA.distanceName} ${digits(distance)} m`;
}
