export { areaY, arrow, dot, frame, line, link, plot, pointer, raster, rect, rectY, ruleX, ruleY, text, tip } from "@observablehq/plot";
