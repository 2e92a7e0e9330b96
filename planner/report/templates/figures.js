"use strict";
/* Unpack plotly, which a page holds compressed, and draw the figures with it. */
async function drawFigures() {
  const packed = Uint8Array.from(atob(document.getElementById("plotly").textContent), (c) => c.charCodeAt(0));
  const unpacked = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const script = document.createElement("script");
  script.textContent = await new Response(unpacked).text();
  document.head.append(script);
  for (const one of document.querySelectorAll("[data-figure]")) {
    const { data, layout, config } = JSON.parse(one.textContent), place = document.getElementById(one.dataset.figure);
    await Plotly.newPlot(place, data, layout, config);
    // plotly draws again when it gets the graphics card back, which it does only if this is asked for
    place.on("plotly_webglcontextlost", ({ event }) => event.preventDefault());
  }
}
