/* The position of a hole or slot against datums: what each datum fixes in its plane, and what may be clicked next.

A chain holds numbers of items: `first` the rim, or the two edges of a slot or tab; `datums` a list of numbers each: one,
the two edges of a slot, or the rims of a pattern; `pattern` the other rims of the hole's own pattern. The rules are those
of errors/measurands/position.py. */
"use strict";

// up to this angle datums lie in planes parallel to that of the rim, and edges are not across each other
const PARALLEL_RAD = 1e-3;

const emptyChain = () => ({ first: [], datums: [], pattern: [] });
const chained = ({ first, datums, pattern }) => [...first, ...datums.flat(), ...pattern];
const wayOf = ({ ends }) => unitOf(minus(ends[1], ends[0]));
const unitOf = (p) => times(1 / size(p), p);
const middleOf = ({ ends }) => ends[0].map((v, i) => (v + ends[1][i]) / 2);

/* Return whether two items are the edges of a slot or tab: parallel, and not on one line. */
function isSlot(one, other) {
  if (one.circle || other.circle || degreesBetween(wayOf(one), wayOf(other)) > PARALLEL_DEG) return false;
  return size(apartAcross(one, other)) > SAME * size(minus(one.ends[1], one.ends[0]));
}

function apartAcross(one, other) {
  return flat(wayOf(one), minus(middleOf(other), middleOf(one)));
}

/* Return the frame of a hole or slot and its datums: whether all is fixed that must be, and what is free yet.

`fault` says why something cannot be in it; a frame that is complete may have another datum if something is free. */
function datumFrame(items, { first, datums, pattern }) {
  const own = first.map((k) => items[k]), frame = { turn: null, anchors: [], origin: null, isComplete: false, fault: "" };
  if (!own.length || (!own[0].circle && own.length < 2)) return frame;
  const normal = own[0].circle ? own[0].circle.axis : unitOf(cross(wayOf(own[0]), apartAcross(...own)));
  for (const numbers of datums) {
    const group = numbers.map((k) => items[k]);
    frame.fault = group.map((item) => leanFault(normal, item)).find(Boolean) || fixBy(frame, normal, group);
    if (frame.fault) return frame;
  }
  const rims = pattern.map((k) => items[k]);
  frame.fault = rims.map((item) => leanFault(normal, item)).find(Boolean) || "";
  if (frame.fault) return frame;
  if (rims.length) fixByPattern(frame, normal, [own[0], ...rims]);
  frame.isComplete = own.length === 2 ? isAcrossFixed(frame, own) : frame.anchors.length === 2;
  return frame;
}

/* A slot has a place across it only; its datums must fix that, and the turn. */
function isAcrossFixed({ turn, anchors }, slot) {
  const over = unitOf(apartAcross(...slot));
  return turn !== null && (anchors.length === 2 || anchors.some((one) => size(cross(one, over)) <= PARALLEL_RAD));
}

function leanFault(normal, item) {
  const lean = item.circle ? size(cross(item.circle.axis, normal)) : Math.abs(dot(wayOf(item), normal));
  return lean > PARALLEL_RAD ? "it is inclined to the plane of the rim" : "";
}

function fixBy(frame, normal, group) {
  if (group.length === 1) return group[0].circle ? fixByCircle(frame, normal, group[0].circle) : fixByLine(frame, normal, wayOf(group[0]));
  if (group.every(({ circle }) => circle)) {
    const wasFixed = frame.turn !== null && frame.anchors.length === 2;
    fixByPattern(frame, normal, group);
    return wasFixed ? "the datums before it leave nothing free" : "";
  }
  if (group.length > 2 || !isSlot(...group)) return "a slot has two parallel edges, and a pattern has rims";
  const [u, v] = group.map(wayOf);
  return fixByLine(frame, normal, unitOf(dot(u, v) < 0 ? minus(u, v) : u.map((x, i) => x + v[i])));
}

function fixByCircle(frame, normal, { centre, radius }) {
  if (!frame.anchors.length) {
    frame.anchors.push(...inPlane(normal));
    frame.origin = { centre, radius };
  } else if (frame.anchors.length === 1) frame.anchors.push(cross(normal, frame.anchors[0]));
  else if (!frame.turn && frame.origin) {
    const apart = flat(normal, minus(centre, frame.origin.centre));
    if (!(size(apart) > SAME * (radius + frame.origin.radius))) return "it has the axis of the first datum";
    frame.turn = unitOf(apart);
  } else return "the datums before it leave nothing free";
  return "";
}

function fixByLine(frame, normal, way) {
  const direction = unitOf(flat(normal, way));
  const over = cross(normal, direction), before = frame.anchors.length, hadTurn = frame.turn;
  frame.turn = frame.turn || direction;
  if (before < 2 && frame.anchors.every((other) => size(cross(other, over)) > PARALLEL_RAD)) frame.anchors.push(over);
  return hadTurn && frame.anchors.length === before ? "the datums before it leave nothing free of it" : "";
}

/* The rims of a pattern fix all that is free yet, by least squares. */
function fixByPattern(frame, normal, rims) {
  if (!frame.anchors.length) frame.anchors.push(...inPlane(normal));
  else if (frame.anchors.length === 1) frame.anchors.push(cross(normal, frame.anchors[0]));
  frame.turn = frame.turn || flat(normal, minus(rims[1].circle.centre, rims[0].circle.centre));
}

const flat = (normal, p) => minus(p, times(dot(p, normal), normal));

function inPlane(normal) {
  const least = Object.values(AXES).reduce((a, b) => (Math.abs(dot(a, normal)) <= Math.abs(dot(b, normal)) ? a : b));
  const x = unitOf(cross(normal, least));
  return [x, cross(normal, x)];
}

/* Return how many items each part of a chain has, and the chain of such counts. */
const chainCounts = ({ first, datums, pattern }) => ({ first: first.length, datums: datums.map((group) => group.length), pattern: pattern.length });

function chainOf(of, counts) {
  const rest = [...of], first = rest.splice(0, counts.first);
  return { first, datums: counts.datums.map((n) => rest.splice(0, n)), pattern: rest };
}

/* Return what a chain is with one more item: at its next place, or joined to what was clicked last. */
function chainWith({ first, datums, pattern }, items, k, isJoined) {
  if (!first.length || (!items[first[0]].circle && first.length < 2)) return { first: [...first, k], datums, pattern };
  if (!isJoined) return { first, datums: [...datums, [k]], pattern };
  if (!datums.length) return { first, datums, pattern: [...pattern, k] };
  return { first, datums: [...datums.slice(0, -1), [...datums.at(-1), k]], pattern };
}

/* Return what a chain is without an item and all that came after it. */
function chainUntil({ first, datums, pattern }, k) {
  if (first.includes(k)) return { first: first.slice(0, first.indexOf(k)), datums: [], pattern: [] };
  if (pattern.includes(k)) return { first, datums: [], pattern: pattern.slice(0, pattern.indexOf(k)) };
  const at = datums.findIndex((group) => group.includes(k));
  const rest = datums[at].slice(0, datums[at].indexOf(k));
  return { first, datums: [...datums.slice(0, at), ...(rest.length ? [rest] : [])], pattern };
}

/* Return the numbers of the items that may come next. */
function nextInChain(items, chain, isJoined) {
  const used = chained(chain), [own, other] = chain.first.map((k) => items[k]);
  const free = items.map((_, k) => k).filter((k) => !used.includes(k));
  if (!own) return free.filter((k) => items[k].kind !== "arc");
  if (!own.circle && !other) return free.filter((k) => isSlot(own, items[k]));
  if (isJoined && !canJoin(items, chain)) return [];
  return free.filter((k) => fitsGroup(items, chain, k, isJoined) && !datumFrame(items, chainWith(chain, items, k, isJoined)).fault);
}

/* Whether what was clicked last may have another part: the other side of a slot, or another rim of a pattern. */
function canJoin(items, { first, datums }) {
  const last = datums.length ? datums.at(-1) : first;
  return items[last[0]].circle ? true : datums.length > 0 && last.length === 1;
}

function fitsGroup(items, { first, datums }, k, isJoined) {
  if (!isJoined) return true;
  const last = (datums.length ? datums.at(-1) : first).map((n) => items[n]);
  if (!last[0].circle) return isSlot(last[0], items[k]);
  const { circle } = items[k];
  return items[k].kind === "rim" && last.every((one) => size(flat(circle.axis, minus(circle.centre, one.circle.centre))) > SAME);
}

/* Return a position as an item of its own. */
function positionItem(items, chain) {
  const named = (numbers) => numbers.map((k) => shortName(items[k])).join("-");
  const hole = named([...chain.first, ...chain.pattern]), datums = chain.datums.map(named);
  const what = datums.length ? `position of ${hole} to ${datums.join(", ")}` : `position of ${hole} among each other`;
  const id = ["position", hole, ...datums].join("_");
  return { id, kind: "position", of: chained(chain), chain, axis: "", size: 0, unit: "mm", rows: [what], smooth: false };
}

/* Read a zone: 0.2 or ⌀0.2; null of nothing, undefined of anything else. */
function zoneOf(text) {
  const word = text.trim().replace(/^[⌀Ø∅]\s*/, "");
  if (!word) return null;
  return /^(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?$/i.test(word) && Number(word) > 0 ? Number(word) : undefined;
}
