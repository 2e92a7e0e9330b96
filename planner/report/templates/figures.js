"use strict";
/* Unpack what a page holds compressed, plotly among it, and draw the figures. */
async function unpackedText(element) {
  const packed = Uint8Array.from(atob(element.textContent), (c) => c.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"))).text();
}
async function drawFigures() {
  const script = document.createElement("script");
  script.textContent = await unpackedText(document.getElementById("plotly"));
  document.head.append(script);
  for (const one of document.querySelectorAll("[data-figure]")) {
    const { data, layout, config } = JSON.parse(await unpackedText(one)), place = document.getElementById(one.dataset.figure);
    await Plotly.newPlot(place, data, layout, config);
    // plotly draws again when it gets the graphics card back, which it does only if this is asked for
    place.on("plotly_webglcontextlost", ({ event }) => event.preventDefault());
  }
}
