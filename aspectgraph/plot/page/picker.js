/* The page: turning the part, pointing at edges, collecting them, and the lists beside. */
"use strict";

const data = JSON.parse(document.getElementById("part-data").textContent);
const { items } = data;
const $ = (id) => document.getElementById(id);
const COLOURS = { edge: [31, 97, 141], rim: [175, 96, 26], arc: [108, 52, 131] };
const CHOSEN = [192, 21, 47], POINTED = [0, 0, 0];
const ANSWER_PX = 8, IDLE_MS = 70, LEAST_PX = 50;

const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
const part = {
  radius: data.radius,
  vertices: new Float32Array(bytes(data.vertices)),
  triangles: new Uint32Array(bytes(data.triangles)),
  faceOf: new Uint32Array(bytes(data.face_of)),
  normals: new Float32Array(bytes(data.normals)),
  outlines: data.outlines,
};
const lines = items.map((item) => item.line);
const middles = lines.map((line) =>
  line.length === 2 ? line[0].map((v, i) => (v + line[1][i]) / 2) : line[line.length >> 1]);
const scene = new Scene($("scene"), part, lines);
const choice = new Choice(items, new ToleranceClasses(data.classes));
const texts = items.map(shortName);
const state = { pointed: -1, face: -1, codes: null, seen: new Map(), boxes: [], box: null, timer: 0, frame: 0, hosted: false, first: -1, partners: new Map(), chain: emptyChain(), isJoined: false, zone: "", material: "" };

/* What the filter lets through. */
function isShown(k) {
  const { kind, size, turn, id } = items[k];
  const inPart = k === state.first || chained(state.chain).includes(k);
  if ((state.first >= 0 || $("position").checked) && !inPart && !state.partners.has(k)) return false;
  const low = parseFloat($("least").value), high = parseFloat($("most").value), wanted = $("find").value.trim();
  if (!$(`kind-${kind}`).checked || (turn > 0 ? !$("convex").checked : !$("reentrant").checked)) return false;
  if (size < low || size > high) return false;
  return !wanted || wanted.split(/[\s,]+/).some((word) => word === id || (/^e\d/.test(word) && word.slice(1) === id));
}

const isPointed = (k) => state.pointed >= 0 && choice.parts(state.pointed).includes(k);
const isMarked = (k) => k === state.first || chained(state.chain).includes(k) || choice.uses(k);
const colourOf = (k) => (isPointed(k) ? POINTED : isMarked(k) ? CHOSEN : COLOURS[items[k].kind]);

function styles() {
  return items.map((_, k) => {
    return [...colourOf(k), isMarked(k) || isPointed(k) ? 5 : isShown(k) ? 2.4 : 0];
  });
}

function overlay() {
  const [width, height] = scene.size, canvas = $("labels"), ratio = window.devicePixelRatio || 1;
  [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  drawScale(context, scene, width, height);
  drawLabels(context, state.boxes, texts, (k) => `rgb(${colourOf(k)})`);
  if (state.box) {
    const { x0, y0, x1, y1 } = state.box;
    context.setLineDash(x1 < x0 ? [5, 4] : []);
    context.strokeStyle = "#1f5fbf";
    context.fillStyle = "rgba(31,95,191,0.10)";
    context.fillRect(x0, y0, x1 - x0, y1 - y0);
    context.strokeRect(x0, y0, x1 - x0, y1 - y0);
  }
}

function paint() {
  if (!scene.isReady) return;
  scene.paint(scene.named, styles());
  scene.draw($("through").checked);
  overlay();
}

/* Find out what is seen where, and label it: when the view rests. */
function settle() {
  if (!scene.isReady) return;
  clearTimeout(state.timer);
  state.timer = 0;
  const [width, height] = scene.size;
  scene.paint(scene.named, styles());
  state.codes = scene.ids($("through").checked);
  state.seen = seenLines(state.codes, width, height, scene.project(middles));
  const wanted = (k) => (isPointed(k) ? 2 : isMarked(k) ? 1 : 0);
  state.boxes = placeLabels($("labels").getContext("2d"), texts, state.seen, wanted, width, height);
  paint();
}

/* Redraw soon, and once more with labels when nothing has moved for a moment. */
function moved() {
  state.codes = null;
  state.boxes = [];
  if (!state.frame) state.frame = requestAnimationFrame(() => { state.frame = 0; paint(); });
  clearTimeout(state.timer);
  state.timer = setTimeout(settle, IDLE_MS);
}

/* Return the index of the line nearest to a pixel and the face at it, -1 for none. */
function at(px, py) {
  if (state.timer) settle();
  if (!state.codes) return { line: -1, face: -1 };
  const [width, height] = scene.size;
  let line = -1, best = ANSWER_PX ** 2 + 1;
  const code = (x, y) => (x < 0 || y < 0 || x >= width || y >= height ? 0 : state.codes[(height - 1 - y) * width + x]);
  for (let dy = -ANSWER_PX; dy <= ANSWER_PX; dy++) {
    for (let dx = -ANSWER_PX; dx <= ANSWER_PX; dx++) {
      const k = code(px + dx, py + dy) - 1, far = dx * dx + dy * dy;
      if (k >= 0 && k < items.length && far < best) [line, best] = [k, far];
    }
  }
  const here = code(px, py) - 1;
  return { line, face: line < 0 && here >= items.length ? here - items.length : -1 };
}

/* Return the lines in a box: dragged to the right, those wholly in it; to the left, those it touches. */
function inBox({ x0, y0, x1, y1 }) {
  if (state.timer) settle();
  if (!state.codes) return [];
  const [left, right] = [Math.min(x0, x1), Math.max(x0, x1)], [top, bottom] = [Math.min(y0, y1), Math.max(y0, y1)];
  const inside = ([x, y]) => x >= left && x <= right && y >= top && y <= bottom;
  const [width, height] = scene.size, touched = new Set();
  for (let y = Math.max(0, Math.ceil(top)); y <= Math.min(height - 1, bottom); y++) {
    for (let x = Math.max(0, Math.ceil(left)); x <= Math.min(width - 1, right); x++) {
      const k = state.codes[(height - 1 - y) * width + x] - 1;
      if (k >= 0 && k < items.length) touched.add(k);
    }
  }
  const reached = items.map((_, k) => k).filter((k) => isShown(k) && (touched.has(k) || $("through").checked));
  return reached.filter((k) => (x1 < x0 ? touched.has(k) : scene.project(lines[k]).every(inside)));
}

function point(k, face, x, y) {
  const tip = $("tip");
  const between = (state.partners.get(k) || []).map(valueText);
  const rows = k >= 0 ? [...choice.items[k].rows, ...between] : face >= 0 ? data.faces[face] : [];
  tip.hidden = !rows.length || x === undefined;
  tip.textContent = rows.join("\n");
  if (!tip.hidden) {
    const [width, height] = scene.size;
    tip.style.left = `${Math.max(4, Math.min(x + 16, width - tip.offsetWidth - 4))}px`;
    tip.style.top = `${Math.max(4, Math.min(y + 16, height - tip.offsetHeight - 4))}px`;
  }
  if (k === state.pointed) return;
  state.pointed = k;
  document.querySelectorAll("#all .pointed").forEach((row) => row.classList.remove("pointed"));
  for (const one of k >= 0 ? choice.parts(k) : []) $(`item-${one}`).classList.add("pointed");
  // what is pointed at in the picture is brought into the list's view
  if (k >= 0 && x !== undefined) reveal($(`item-${k}`));
  paint();
}

function reveal(row) {
  const list = $("all"), above = row.offsetTop;
  if (above < list.scrollTop || above + row.offsetHeight > list.scrollTop + list.clientHeight) {
    list.scrollTop = above - list.clientHeight / 2;
  }
}

/* Take what is clicked: into the list or out of it, as one of two to measure between, or as a hole or its datum. */
function take(k) {
  if ($("position").checked) placeNext(k);
  else if (!$("two").checked) {
    choice.toggle(k);
    chosen();
  } else if (state.first < 0) begin(k);
  else if (state.first === k) begin(-1);
  else offer(k);
}

/* Begin a pair with an item, and show what makes one with it; -1 ends it. */
function begin(k) {
  state.first = k;
  const options = k < 0 ? [] : items.map((item, j) => [j, j === k ? [] : betweenTwo(items[k], item)]);
  state.partners = new Map(options.filter(([, found]) => found.length));
  $("between").hidden = !$("two").checked;
  $("between").replaceChildren(k < 0 ? "Click the first of two: edges, rims or arcs."
    : `${items[k].rows[0]} and … Click the second. Esc starts again.`);
  items.forEach((item, j) => {
    $(`item-${j}`).lastChild.textContent = state.partners.has(j) ? valueText(state.partners.get(j)[0]) : item.told;
  });
  chosen();
  filtered();
}

/* Collect what is measured between the first and another one; of several values the reader says which. */
function offer(k) {
  const options = state.partners.get(k) || [], of = [state.first, k];
  if (options.length === 1) return collectPair(of, options[0]);
  const names = of.map((one) => items[one].rows[0]).join(" and ");
  const buttons = options.map((option) => {
    const button = document.createElement("button");
    button.textContent = valueText(option);
    button.addEventListener("click", () => collectPair(of, option));
    return button;
  });
  $("between").replaceChildren(options.length ? `${names}: ` : `Nothing is measured between ${names}.`, ...buttons);
  return chosen();
}

/* Take what is clicked as the next of a position; what is clicked again goes out with all after it. */
function placeNext(k) {
  if (chained(state.chain).includes(k)) placeFrom(chainUntil(state.chain, k));
  else if (state.partners.has(k)) {
    const chain = chainWith(state.chain, items, k, state.isJoined);
    // a slot has two sides, a pattern any number of rims
    state.isJoined = state.isJoined && items[k].circle !== null;
    placeFrom(chain);
  }
}

/* Show what a position has so far, and which entities may be next: what has the position, then what fixes anything. */
function placeFrom(chain) {
  const { first, datums, pattern } = chain, isFirst = !first.length || (!items[first[0]].circle && first.length < 2);
  state.isJoined = state.isJoined && !isFirst && nextInChain(items, chain, true).length > 0;
  const next = nextInChain(items, chain, state.isJoined);
  [state.chain, state.first, state.partners] = [chain, first[0] ?? -1, new Map(next.map((k) => [k, []]))];
  const named = (numbers) => numbers.map((k) => shortName(items[k])).join("-");
  const parts = isFirst
    ? [first.length ? `Click the other edge of the slot or tab of ${named(first)}.` : "Click the hole whose position is asked, or an edge of a slot or tab."]
    : [`Position of ${named([...first, ...pattern])}${datums.length ? ` to ${datums.map(named).join(", ")}` : ""}. `];
  if (!isFirst) parts.push(...placeControls(chain, next));
  $("between").hidden = !$("position").checked;
  $("between").replaceChildren(...parts);
  chosen();
  filtered();
}

/* Return what can be done with a position that has its hole or slot. */
function placeControls(chain, next) {
  const parts = [], { isComplete } = datumFrame(items, chain);
  if (state.isJoined) parts.push("Click it, or untick: ");
  else if (!chain.datums.length && !chain.pattern.length) parts.push("Click its datums in their order: edges or rims. ");
  else if (next.length) parts.push(isComplete ? "Click the next datum, or " : "Click the next datum: one is needed. ");
  else if (!isComplete) parts.push("One datum more is needed, and the part has none. ");
  if (state.isJoined || nextInChain(items, chain, true).length) parts.push(joinField(chain));
  if (isComplete) parts.push(zoneField(), materialField(), collectButton());
  return parts;
}

/* The tick by which the next click joins what was clicked last. */
function joinField({ first, datums }) {
  const label = document.createElement("label"), input = document.createElement("input");
  const last = datums.length ? datums.at(-1) : first;
  [input.id, input.type, input.checked] = ["join", "checkbox", state.isJoined];
  input.addEventListener("change", () => { state.isJoined = input.checked; placeFrom(state.chain); });
  const text = items[last[0]].circle ? `with another rim of the pattern of ${shortName(items[last[0]])}`
    : `with the other edge of the slot or tab of ${shortName(items[last[0]])}`;
  label.append(input, ` ${text} `);
  return label;
}

function zoneField() {
  const label = document.createElement("label"), input = document.createElement("input");
  [input.id, input.type, input.size, input.value] = ["zone", "text", 5, state.zone];
  input.placeholder = state.chain.first.length === 1 ? "⌀0.2" : "0.2";
  input.addEventListener("input", () => { state.zone = input.value; });
  label.append("zone ", input, " mm ");
  return label;
}

function materialField() {
  const select = document.createElement("select");
  [select.id, select.title] = ["material", "material condition: the zone grows with the size"];
  for (const [value, text] of [["", "no condition"], ["M", "(M)"], ["L", "(L)"]]) select.add(new Option(text, value));
  select.value = state.material;
  select.addEventListener("change", () => { state.material = select.value; });
  return select;
}

function collectButton() {
  const button = document.createElement("button");
  [button.id, button.textContent] = ["collect-position", "Collect"];
  button.addEventListener("click", () => {
    const k = choice.position(state.chain);
    choice.tolerances.set(k, state.zone.trim());
    choice.materials.set(k, state.material);
    // the bonus comes from the size, which is measured with it
    choice.add(state.material ? [choice.sizeOf(k), k] : [k]);
    $("kind-of-file").value = "dimensions";
    state.material = "";
    placeFrom(emptyChain());
  });
  return button;
}

/* Begin a pair or a position anew. */
function restart() {
  if ($("two").checked) begin(-1);
  if ($("position").checked) placeFrom(emptyChain());
}

function collectPair(of, option) {
  choice.add([choice.pair(of, option)]);
  $("kind-of-file").value = "dimensions";
  begin(-1);
}

function chosen() {
  listChosen();
  items.forEach((_, k) => { $(`item-${k}`).querySelector("input").checked = choice.names.has(k); });
  settle();
}

function listAll() {
  const rows = items.map((item, k) => {
    const row = document.createElement("label"), tick = document.createElement("input");
    row.id = `item-${k}`;
    tick.type = "checkbox";
    tick.addEventListener("change", () => take(k));
    const cells = [texts[k], item.kind, item.told].map((text) => {
      const cell = document.createElement("span");
      cell.textContent = text;
      return cell;
    });
    row.append(tick, ...cells);
    row.addEventListener("pointerenter", () => point(k, -1));
    row.addEventListener("pointerleave", () => point(-1, -1));
    return row;
  });
  $("all").replaceChildren(...rows);
}

/* Put the list in the order asked for: as in the file, or by size. */
function sorted() {
  const order = items.map((_, k) => k);
  if ($("order").value === "size") order.sort((j, k) => items[k].size - items[j].size || j - k);
  $("all").append(...order.map((k) => $(`item-${k}`)));
}

const forDimensions = () => $("kind-of-file").value === "dimensions";

function field(value, label, bad, rename) {
  const input = document.createElement("input");
  input.value = value;
  input.setAttribute("aria-label", label);
  input.title = bad;
  input.className = bad ? "bad" : "";
  input.addEventListener("change", () => { rename(input.value); listChosen(); });
  return input;
}

function chosenRow(k, name) {
  const row = document.createElement("div"), out = document.createElement("button"), told = document.createElement("span");
  const { rows: [what], told: inShort } = choice.items[k];
  row.append(field(name, `name of ${what}`, choice.fault(k), (text) => choice.rename(k, text)));
  told.textContent = `${what}, ${inShort || choice.told(k)}`;
  if (forDimensions()) {
    const own = choice.tolerances.get(k) || "";
    const tolerance = field(own, `${choice.isPosition(k) ? "zone" : "tolerance"} of ${what}`, choice.toleranceFault(k), (text) => {
      choice.tolerances.set(k, text.trim());
    });
    tolerance.placeholder = choice.isPosition(k) ? "zone" : choice.shared(k) || "none";
    row.append(tolerance);
    told.textContent = choice.told(k);
  }
  told.title = told.textContent;
  out.textContent = "×";
  out.title = "take out";
  out.addEventListener("click", () => { choice.remove([k]); chosen(); });
  row.append(told, out);
  row.addEventListener("pointerenter", () => point(k, -1));
  row.addEventListener("pointerleave", () => point(-1, -1));
  return row;
}

function listChosen() {
  choice.common = $("tolerance").value.trim();
  choice.share = Number((Number($("share").value) / 100).toPrecision(12));
  const chosenOnes = [...choice.names], dimensions = forDimensions();
  $("chosen").replaceChildren(...chosenOnes.map(([k, name]) => chosenRow(k, name)));
  $("chosen").className = dimensions ? "toleranced" : "";
  for (const one of document.querySelectorAll("[data-file]")) one.hidden = one.dataset.file !== $("kind-of-file").value;
  const n = choice.names.size, names = chosenOnes.map(([k]) => choice.fault(k)).filter(Boolean);
  const refused = dimensions ? chosenOnes.filter(([k]) => choice.toleranceFault(k)) : [];
  $("count").textContent = n ? `${n} picked` : "Nothing picked yet";
  $("fault").textContent = refused.length
    ? `${choice.items[refused[0][0]].rows[0]}: ${choice.toleranceFault(refused[0][0])}`
    : names.length ? `${names[0]}; the file keeps the id instead` : notes(chosenOnes, dimensions);
  $("toml").value = refused.length ? "" : toml();
  const written = dimensions ? n : choice.entities().length;
  for (const id of ["copy", "save"]) $(id).disabled = !written || refused.length > 0;
  $("copy-ids").disabled = !choice.entities().length;
  $("clear").disabled = !n;
  $("undo").disabled = !choice.past.length;
  if (state.hosted) window.parent.postMessage({ picked: { ...choice.record(), file: $("kind-of-file").value } }, "*");
}

/* In a frame of a notebook: say that the page is there, take what was picked before, and from then on say what is. */
function serve() {
  window.addEventListener("message", ({ source, data }) => {
    const restore = source === window.parent && data?.restore;
    if (!restore) return;
    if (restore.rows) {
      choice.restore(restore);
      [$("kind-of-file").value, $("tolerance").value] = [restore.file, choice.common];
      $("share").value = Number((100 * choice.share).toPrecision(12));
    }
    state.hosted = true;
    document.body.className = "hosted";
    chosen();
  });
  window.parent.postMessage({ opened: true }, "*");
}

/* Say which lengths a plan cannot measure. */
function notes(chosenOnes, dimensions) {
  const pairs = chosenOnes.filter(([k]) => choice.items[k].of).length;
  if (pairs && !dimensions) return "Positions, and what is measured between two, are only in the file of dimensions";
  const smooth = dimensions ? chosenOnes.filter(([k]) => items[k]?.smooth) : [];
  return smooth.length ? `${items[smooth[0][0]].rows[0]} ends in a tangent arc, so a plan does not measure its length` : "";
}

const toml = () => (forDimensions() ? choice.dimensionsToml(data.part, $("by-ends").checked)
  : choice.toml(data.part, $("by-ends").checked));

function filtered() {
  const shown = items.filter((_, k) => isShown(k)).length;
  items.forEach((_, k) => { $(`item-${k}`).hidden = !isShown(k); });
  $("shown").textContent = `${shown} of ${items.length} shown`;
  settle();
}

async function copy(text, button) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    // without leave for the clipboard: the old way, through a field
    const field = document.createElement("textarea");
    field.value = text;
    document.body.append(field);
    field.select();
    document.execCommand("copy");
    field.remove();
  }
  const before = button.textContent;
  button.textContent = "Copied";
  setTimeout(() => { button.textContent = before; }, 1200);
}

function save() {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([toml()], { type: "application/toml" }));
  link.download = `${data.stem}_${$("kind-of-file").value}.toml`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/* End what was begun, and untick the other way of picking. */
function only(ticked) {
  $(ticked === "two" ? "position" : "two").checked = false;
  state.chain = emptyChain();
  begin(-1);
  if ($("position").checked) placeFrom(emptyChain());
}

const everything = () => items.map((_, k) => k).filter(isShown);
const actions = {
  copy: () => copy(toml(), $("copy")),
  "copy-ids": () => copy(choice.ids(), $("copy-ids")),
  save,
  clear: () => { choice.remove([...choice.names.keys()]); chosen(); },
  undo: () => { choice.undo(); chosen(); },
  "collect-shown": () => { choice.add(everything()); chosen(); },
  fit: () => { scene.fit(); moved(); },
  two: () => only("two"),
  position: () => only("position"),
};
for (const [id, act] of Object.entries(actions)) $(id).addEventListener("click", act);
for (const id of ["least", "most", "find", "kind-edge", "kind-rim", "kind-arc", "convex", "reentrant"]) {
  $(id).addEventListener("input", filtered);
}
$("through").addEventListener("input", settle);
$("order").addEventListener("input", sorted);
for (const id of ["by-ends", "kind-of-file", "tolerance", "share"]) $(id).addEventListener("input", listChosen);
document.querySelectorAll("[data-view]").forEach((button) => button.addEventListener("click", () => {
  [scene.view.yaw, scene.view.pitch] = button.dataset.view.split(" ").map((degrees) => (degrees * Math.PI) / 180);
  scene.fit();
  moved();
}));

listAll();
listChosen();
if (scene.gl) {
  const ofFace = (face) => everything().filter((k) => items[k].faces.includes(face));
  watchPointer({ scene, state, at, inBox, point, moved, overlay, choice, chosen, ofFace, take, restart });
  scene.onLoss(() => { state.codes = null; }, moved);
  // a frame has no size yet when its page is there
  let narrow = true, open = window.parent !== window ? serve : null;
  new ResizeObserver(() => {
    if (narrow) scene.fit();
    narrow = Math.min(...scene.size) < LEAST_PX;
    moved();
    // what is clicked from now on is found
    open?.();
    open = null;
  }).observe($("scene"));
  scene.fit();
} else {
  $("no-3d").hidden = false;
  if (window.parent !== window) serve();
}
filtered();
