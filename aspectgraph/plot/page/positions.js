/* The position of a hole against datums: what each datum fixes in the plane of its rim, and what may be the next one.

The rules are those of errors/measurands/position.py. */
"use strict";

// up to this angle datums lie in planes parallel to that of the rim, and edges are not across each other
const PARALLEL_RAD = 1e-3;

/* Return the frame of a rim and its datums in their order: whether all is fixed that must be, and what is free yet.

`fault` says why a datum cannot be one; a frame that is `complete` may have another datum if its turn is free. */
function datumFrame(rim, datums) {
  const normal = rim.circle.axis, frame = { turn: null, anchors: [], origin: null, isComplete: false, fault: "" };
  for (const datum of datums) {
    frame.fault = datum.circle ? fixByCircle(frame, normal, datum.circle) : fixByEdge(frame, normal, datum.ends);
    if (frame.fault) return frame;
  }
  frame.isComplete = frame.anchors.length === 2;
  return frame;
}

function fixByCircle(frame, normal, { centre, axis, radius }) {
  if (size(cross(axis, normal)) > PARALLEL_RAD) return "it is inclined to the plane of the rim";
  if (!frame.anchors.length) {
    const [x, y] = inPlane(normal);
    frame.anchors.push(x, y);
    frame.origin = { centre, radius };
  } else if (frame.anchors.length === 1) frame.anchors.push(cross(normal, frame.anchors[0]));
  else if (!frame.turn && frame.origin) {
    const apart = flat(normal, minus(centre, frame.origin.centre));
    if (!(size(apart) > SAME * (radius + frame.origin.radius))) return "it has the axis of the first datum";
    frame.turn = times(1 / size(apart), apart);
  } else return "the datums before it leave nothing free";
  return "";
}

function fixByEdge(frame, normal, ends) {
  const along = minus(ends[1], ends[0]), way = times(1 / size(along), along);
  if (Math.abs(dot(way, normal)) > PARALLEL_RAD) return "it is inclined to the plane of the rim";
  const inRim = flat(normal, way), direction = times(1 / size(inRim), inRim);
  const across = cross(normal, direction), before = frame.anchors.length, hadTurn = frame.turn;
  frame.turn = frame.turn || direction;
  if (before < 2 && frame.anchors.every((other) => size(cross(other, across)) > PARALLEL_RAD)) frame.anchors.push(across);
  return hadTurn && frame.anchors.length === before ? "the datums before it leave nothing free of it" : "";
}

const flat = (normal, p) => minus(p, times(dot(p, normal), normal));

function inPlane(normal) {
  const least = Object.values(AXES).reduce((a, b) => (Math.abs(dot(a, normal)) <= Math.abs(dot(b, normal)) ? a : b));
  const x = cross(normal, least), unit = times(1 / size(x), x);
  return [unit, cross(normal, unit)];
}

/* Return the numbers of the items that may be the next datum of a rim. */
function nextDatums(items, [rim, ...datums]) {
  const named = datums.map((k) => items[k]);
  return items.map((_, k) => k).filter((k) =>
    k !== rim && !datums.includes(k) && !datumFrame(items[rim], [...named, items[k]]).fault);
}

/* Return a position as an item of its own; `of` are the numbers of its rim and datums. */
function positionItem(items, of) {
  const [rim, ...datums] = of.map((k) => shortName(items[k]));
  const what = `position of ${rim} to ${datums.join(", ")}`;
  return { id: ["position", rim, ...datums].join("_"), kind: "position", of, axis: "", size: 0, unit: "mm", rows: [what], smooth: false };
}

/* Read a zone: 0.2 or ⌀0.2; null of nothing, undefined of anything else. */
function zoneOf(text) {
  const word = text.trim().replace(/^[⌀Ø∅]\s*/, "");
  if (!word) return null;
  return /^(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?$/i.test(word) && Number(word) > 0 ? Number(word) : undefined;
}
