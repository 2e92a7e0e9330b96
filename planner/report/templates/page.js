"use strict";
(async () => {
  const read = (id) => JSON.parse(document.getElementById(id).textContent);
  const views = read("views"), domains = read("domains"), scene = document.getElementById("plan3d");
  const domainText = document.getElementById("domain");
  let chosen = null;
  try {
    await drawFigures();
  } catch (error) {
    scene.textContent = `This browser draws no 3-D view (${error.message}).`;
    return;
  }

  // the views fit the height; in a picture higher than wide, the eye steps back, but that of a camera stays
  function fitted({ eye, center, up, field }) {
    const { w, h } = scene._fullLayout._size, back = field ? 1 : Math.max(1, (1.1 * h) / w), away = {};
    for (const i of ["x", "y", "z"]) away[i] = center[i] + back * (eye[i] - center[i]);
    return { eye: away, center, up, projection: { type: "perspective" } };
  }
  // plotly has no option for the field of its camera, 45 degrees from top to bottom; that of a setting is its sensor's
  function setField({ field }) {
    const { w, h } = scene._fullLayout._size, plot = scene._fullLayout.scene._scene.glplot;
    if (!plot) return;
    plot.fovy = field ? 2 * Math.atan(1.04 * Math.max(field.y, (field.x * h) / w)) : Math.PI / 4;
    plot.redraw();
  }
  let view = "";
  const show = (name) => Plotly.relayout(scene, { "scene.camera": fitted(views[name]) }).then(() => { view = name; setField(views[name]); });

  function trace({ x, y, z, i, j, k, color }) {
    return {
      type: "mesh3d", name: "chosen domain", x, y, z, i, j, k, color, opacity: 0.35, flatshading: true,
      lighting: { ambient: 0.9, diffuse: 0.2, specular: 0 }, hoverinfo: "skip", showlegend: true,
    };
  }
  async function choose(group) {
    const name = group.dataset.domain, again = name === chosen;
    const old = scene.data.findIndex((one) => one.name === "chosen domain");
    document.querySelectorAll(".graph .chosen").forEach((one) => one.classList.remove("chosen"));
    chosen = again ? null : name;
    domainText.textContent = again ? "" : domains[name].text;
    if (!again) group.classList.add("chosen");
    if (old >= 0) await Plotly.deleteTraces(scene, old);
    if (chosen === name && domains[name].i.length) await Plotly.addTraces(scene, trace(domains[name]));
  }

  // of a chosen target, the witness that its setting uses is bold, its others are dotted, and what is not its setting's is faint
  const picks = JSON.parse(await unpackedText(document.getElementById("picks"))), list = document.getElementById("target"), ways = document.getElementById("ways");
  function lines(name, pieces, color, width, dash) {
    const at = (i) => pieces.flatMap((piece) => [...piece.map((point) => point[i]), null]);
    return { type: "scatter3d", mode: "lines", name, x: at(0), y: at(1), z: at(2), line: { color, width, dash }, hoverinfo: "skip" };
  }
  async function pick() {
    const one = picks[list.value], old = [], own = [], rest = [];
    scene.data.forEach((trace, i) => {
      if (/^(chosen target|its other ways)$/.test(trace.name)) old.push(i);
      else if (trace.legendgroup) (!one || trace.legendgroup === "setting " + one.setting ? own : rest).push(i);
    });
    ways.textContent = one ? one.text : "";
    if (one && one.setting) {
      const button = document.createElement("button");
      button.textContent = "As setting " + one.setting + " sees it";
      button.addEventListener("click", () => show("setting-" + one.setting));
      ways.append(button);
    }
    if (own.length) await Plotly.restyle(scene, { opacity: one ? 0.5 : 1 }, own);
    if (rest.length) await Plotly.restyle(scene, { opacity: 0.12 }, rest);
    if (old.length) await Plotly.deleteTraces(scene, old);
    if (!one) return;
    const more = one.others.length ? [lines("its other ways", one.others, "#5d6976", 5, "dot")] : [];
    await Plotly.addTraces(scene, [lines("chosen target", one.lines, "#000", 10, "solid"), ...more]);
    // next to its cameras, a part is small
    if (view === "everything") await show("part");
  }
  // one after the other, however fast the list is gone through
  let picked = Promise.resolve();
  if (list) list.addEventListener("change", () => { picked = picked.then(pick); });

  document.querySelectorAll("[data-view]").forEach((button) => button.addEventListener("click", () => {
    show(button.dataset.view);
    if (!button.closest(".views")) document.getElementById("space").scrollIntoView();
  }));
  document.querySelectorAll("[data-domain]").forEach((group) => {
    group.addEventListener("click", () => choose(group));
    group.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      choose(group);
    });
  });
  // paper shows no WebGL: of what is drawn, a still picture is kept, which the sheet for print shows in its place
  let due = 0;
  function keepStill() {
    const drawn = scene._fullLayout.scene._scene;
    if (!drawn || !drawn.glplot) return;
    const still = drawn.container.querySelector("img.still") || drawn.container.appendChild(new Image());
    still.className = "still";
    still.alt = "3-D view";
    still.src = drawn.toImage("png");
  }
  scene.on("plotly_afterplot", () => { clearTimeout(due); due = setTimeout(keepStill, 300); });
  scene.on("plotly_relayout", () => { clearTimeout(due); due = setTimeout(keepStill, 300); });
  // a picture that is drawn for the screen is made as small as the paper
  const frame = scene.closest(".scene").style;
  addEventListener("beforeprint", () => {
    const { width, height } = scene._fullLayout;
    frame.width = width + "px";
    frame.height = height + "px";
    frame.zoom = Math.min(1, 400 / width);
  });
  addEventListener("afterprint", () => { frame.zoom = frame.height = frame.width = ""; });
  // the picture was drawn before the graph beside it took its share of the width; below it the legend takes none
  const below = { orientation: "h", x: 0, xanchor: "left", y: -0.01, yanchor: "top", maxheight: 0.4 };
  Plotly.Plots.resize(scene).then(() => Plotly.relayout(scene, { legend: { ...scene.layout.legend, ...below } })).then(() => show("everything"))
    .then(() => { keepStill(); document.body.dataset.ready = "yes"; });
})();
