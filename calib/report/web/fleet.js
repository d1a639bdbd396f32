// The control charts of fleet.html. They take the place of the drawings that stand there without scripts.

const MAX_NAMES = 8, LINE_HEIGHT = 12, LETTER_WIDTH = 7.2; // of the names beside outliers, px

function drawControlChart(host, {value, outlier, series, spread, lines, domain, logarithmic, unit}) {
  const all = numbers(value), beyond = numbers(outlier), colours = numbers(series), spreads = numbers(spread), [low, high] = domain;
  const points = Array.from(all, (number, camera) => ({
    x: camera + 0.5, y: Math.min(high, Math.max(low, number)), number, camera, beyond: beyond[camera], colour: `var(--series-${colours[camera]})`,
  })).filter(point => Number.isFinite(point.number));
  const usual = points.filter(point => !point.beyond), outliers = points.filter(point => point.beyond);
  const named = outliers.slice().sort((first, second) => Math.abs(spreads[second.camera]) - Math.abs(spreads[first.camera])).slice(0, MAX_NAMES);
  const size = all.length <= 300 ? 5 : all.length <= 2000 ? 3 : 1.8;
  host.replaceChildren();
  addPanel(host, {
    title: "", label: "a number of each camera", onClick: ({camera}) => { location.href = DATA.cameras[camera].link; },
    options: width => chartOptions(
      width, 200, {domain: [0, all.length], label: "", ticks: 0}, {domain, label: unit, type: logarithmic ? "log" : "linear", ticks: logarithmic ? lines.map(line => line.at) : 4, tickFormat: at => digits(at, 3)},
      [
        ...lines.map(line => Libraries.Plot.ruleY([line.at], {
          stroke: line.series === null ? "var(--faint)" : `var(--series-${line.series})`, strokeDasharray: line.limit ? "5 4" : "",
        })),
        dots(usual, point => point.colour, size, 0.9), dots(outliers, "var(--out)", 8, 1), names(named),
        tip(points, ({camera, number}) => `${DATA.cameras[camera].name}\n${digits(number, 5)} ${unit}`),
      ],
    ),
  });
}

/** A mark of cameras' names beside their dots, none over another. */
function names(points) {
  return (_, {x, y}, channels, {width, height, marginLeft, marginRight, marginTop, marginBottom}) => {
    const group = document.createElementNS(SVG, "g"), placed = [];
    const shown = points.map(point => ({...point, across: x(point.x), down: y(point.y) + 4}))
      .filter(({across, down}) => across >= marginLeft && across <= width - marginRight && down > marginTop && down < height - marginBottom + 6);
    for (const {across, down, camera} of shown.sort((first, second) => first.down - second.down)) {
      const {name} = DATA.cameras[camera], wide = LETTER_WIDTH * name.length, left = across + 8 + wide < width ? across + 8 : across - 8 - wide;
      const near = placed.filter(other => other.left < left + wide && left < other.left + other.wide);
      const free = [0, 1, -1, 2, -2, 3, -3, 4, -4].map(step => down + step * LINE_HEIGHT)
        .find(line => line > marginTop + 8 && line < height - marginBottom && near.every(other => Math.abs(other.line - line) >= LINE_HEIGHT));
      if (free === undefined) continue; // a zoom makes room
      placed.push({left, wide, line: free});
      const text = document.createElementNS(SVG, "text");
      text.setAttribute("class", "name");
      text.setAttribute("x", left);
      text.setAttribute("y", free);
      text.textContent = name;
      group.append(text);
    }
    return group;
  };
}

drawPage(drawControlChart);
