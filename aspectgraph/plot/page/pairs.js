/* What is measured between two edges, rims or arcs: the kinds that are defined for them, and their values in the model.

The rules and values are those of errors/measurands/kinds.py. */
"use strict";

// up to this angle a dimension takes directions as parallel
const PARALLEL_DEG = 0.01;
const SAME = 1e-9;
const AXES = { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1] };
const WORDS = {
  edge: "length", rim: "diameter", arc: "radius",
  distance: "distance", angle: "angle", centre_distance: "centre distance", centre_to_edge: "centre to edge",
};

const dot = (p, q) => p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
const minus = (p, q) => p.map((v, i) => v - q[i]);
const times = (factor, p) => p.map((v) => factor * v);
const size = (p) => Math.hypot(...p);
const cross = (p, q) => [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
const degreesBetween = (p, q) => (Math.atan2(size(cross(p, q)), Math.abs(dot(p, q))) * 180) / Math.PI;

/* Return the direction of an edge or the axis of a circle, the point that is measured to, and how large it is. */
function placed({ ends, circle }) {
  if (circle) return { way: circle.axis, at: circle.centre, reach: circle.radius };
  const along = minus(ends[1], ends[0]);
  return { way: times(1 / size(along), along), at: ends[0].map((v, i) => (v + ends[1][i]) / 2), reach: size(along) };
}

/* Return what lies apart across a direction: straight, and along axes of the part that are across it and give another value. */
function across(kind, way, apart, least) {
  const straight = size(minus(apart, times(dot(apart, way), way)));
  if (!(straight > least)) return [];
  const found = [{ kind, axis: "", nominal: straight, unit: "mm" }];
  for (const [axis, unit] of Object.entries(AXES)) {
    const nominal = Math.abs(dot(apart, unit));
    if (Math.abs(dot(way, unit)) < SAME && nominal > least && Math.abs(nominal - straight) > 1e-6) {
      found.push({ kind, axis, nominal, unit: "mm" });
    }
  }
  return found;
}

/* Return what can be measured between two items: { kind, axis, nominal, unit } each, the most usual one first. */
function betweenTwo(one, other) {
  const circles = [one, other].filter((item) => item.circle);
  const [a, b] = circles.length === 1 && !one.circle ? [placed(other), placed(one)] : [placed(one), placed(other)];
  const apart = minus(b.at, a.at), degrees = degreesBetween(a.way, b.way);
  if (circles.length === 2) {
    return degrees <= PARALLEL_DEG ? across("centre_distance", a.way, apart, SAME * (a.reach + b.reach)) : [];
  }
  if (circles.length === 1) {
    const normal = cross(a.way, b.way), nominal = Math.abs(dot(apart, normal)) / size(normal);
    const defined = 90 - degrees <= PARALLEL_DEG && nominal > SAME * (a.reach + b.reach);
    return defined ? [{ kind: "centre_to_edge", axis: "", nominal, unit: "mm" }] : [];
  }
  if (degrees > PARALLEL_DEG) return [{ kind: "angle", axis: "", nominal: degrees, unit: "°" }];
  return across("distance", a.way, apart, SAME * Math.max(1, size(apart)));
}

const valueText = ({ kind, axis, nominal, unit }) =>
  `${WORDS[kind]}${axis ? ` along ${axis}` : ""} ${Number(nominal.toPrecision(7))}${unit === "°" ? unit : ` ${unit}`}`;
const shortName = ({ kind, id }) => (kind === "edge" ? `e${id}` : id);

/* Return a value between two items as an item of its own; `of` are their numbers. */
function pairItem(items, of, { kind, axis, nominal, unit }) {
  // the rim or arc comes first
  const order = kind === "centre_to_edge" && !items[of[0]].circle ? [of[1], of[0]] : of;
  const names = order.map((k) => shortName(items[k]));
  const what = `${WORDS[kind]} of ${names.join(" and ")}${axis ? ` along ${axis}` : ""}`;
  return { id: [kind, ...names, axis].filter(Boolean).join("_"), kind, of: order, axis, size: nominal, unit, rows: [what], smooth: false };
}
