// The parts of Observable Plot, D3 and three.js that report.html uses, as one global `Libraries`.
export * as Plot from "./libraries.plot.js";
export * as THREE from "./libraries.three.js";
export { ticks } from "d3-array";
export { contours } from "d3-contour";
export { zoom, zoomIdentity } from "d3-zoom";
export { select } from "d3-selection";
