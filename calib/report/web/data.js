// The page's data, unpacked.

const DATA = JSON.parse(document.getElementById("data").textContent);
const BLUE = "#2f8fdd", ORANGE = "#e8833a"; // of the fields, on light and on dark

/** Return the numbers of an array as they are packed: row by row. */
function numbers({f4, u2}) {
  const bytes = Uint8Array.from(atob(f4 ?? u2), letter => letter.charCodeAt(0));
  return u2 === undefined ? new Float32Array(bytes.buffer) : new Uint16Array(bytes.buffer);
}

/** Return an array of two or more dimensions as a list of its rows, which are typed arrays. */
function rows(array) {
  const all = numbers(array), width = array.shape.slice(1).reduce((product, size) => product * size, 1);
  return Array.from({length: array.shape[0]}, (_, row) => all.subarray(row * width, (row + 1) * width));
}

/** Return a number with so many significant digits, never as 1.2e+3. */
function digits(value, count = 3) {
  if (!Number.isFinite(value)) return "none";
  const places = value === 0 ? 0 : count - 1 - Math.floor(Math.log10(Math.abs(value)));
  return value.toFixed(Math.min(Math.max(places, 0), 9));
}

/** Return a text in which no line breaks between a number and its unit. */
function keepNumbers(text) {
  return text.replace(/(\d) (?=(px|mm|µm|m|times)\b|%|±)|(±) (?=[\d-])/g, "$1$3\u00a0");
}

function element(tag, className = "", text = "") {
  const made = document.createElement(tag);
  if (className) made.className = className;
  made.textContent = text;
  return made;
}
