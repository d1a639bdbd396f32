// Unpacks the libraries, then draws every figure of a page.

/** Run the libraries, which stand in the page as gzip in base64. The policy of the page knows their hash. */
async function loadLibraries() {
  const packed = Uint8Array.from(atob(document.getElementById("libraries").textContent), letter => letter.charCodeAt(0));
  const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const script = element("script", "", await new Response(unpacked).text());
  document.head.append(script);
}

/** Draw every figure of the page. draw(host, data, name) draws one. */
async function drawPage(draw) {
  await loadLibraries();
  for (const figure of document.querySelectorAll("[data-figure]")) {
    const name = figure.dataset.figure;
    draw(figure.querySelector(".panels"), DATA.figures[name], name);
    await new Promise(done => setTimeout(done)); // the page answers in between
  }
  document.documentElement.dataset.drawn = "";
}
