/* What is collected, in order, with names and tolerances; and its file for --entities or --dimensions. */
"use strict";

// the share of a tolerance's half width that `plan` permits as error of measurement
const SHARE = 0.25;
const MEASURED = { edge: "edge", rim: "diameter", arc: "radius" };
// what ISO 286 is for: sizes of cylinders, and of pairs of parallel planes
const WITH_CLASS = ["edge", "rim", "distance"];
const measured = (kind) => MEASURED[kind] || kind;

class Choice {
  constructor(items, classes) {
    this.items = [...items]; // and after them the pairs
    this.classes = classes;
    this.names = new Map(); // index -> name, in the order collected
    this.past = [];
    this.tolerances = new Map(); // index -> text of its own tolerance
    this.materials = new Map(); // index -> M or L of a position
    this.common = ""; // the tolerance of all others
    this.share = SHARE;
  }

  change(edit) {
    const before = new Map(this.names);
    edit(this.names);
    const same = before.size === this.names.size && [...before].every(([k, name]) => this.names.get(k) === name);
    if (!same) this.past.push(before);
  }

  defaultName(k) { return shortName(this.items[k]); }

  /* Return the number of a value between two items, which need not be collected. */
  pair(of, option) { return this.number(pairItem(this.items, of, option)); }

  /* Return the number of the position of a hole or slot against its datums, as positions.js chains them. */
  position(chain) { return this.number(positionItem(this.items, chain)); }

  /* Return the number of the diameter or width that a material condition refers to. */
  sizeOf(k) {
    const { first } = this.items[k].chain;
    if (first.length === 1) return first[0];
    const width = betweenTwo(...first.map((n) => this.items[n])).find(({ kind, axis }) => kind === "distance" && !axis);
    return this.pair(first, width);
  }

  number(item) {
    const known = this.items.findIndex(({ id }) => id === item.id);
    return known < 0 ? this.items.push(item) - 1 : known;
  }

  isPosition(k) { return this.items[k].kind === "position"; }

  parts(k) { return this.items[k].of || [k]; }

  /* Whether an item is collected, or one of a pair that is. */
  uses(k) { return this.names.has(k) || [...this.names.keys()].some((one) => this.parts(one).includes(k)); }

  /* Return the numbers of what is an entity by itself. */
  entities() { return [...this.names.keys()].filter((k) => !this.items[k].of); }

  add(indices) {
    this.change((names) => indices.forEach((k) => names.has(k) || names.set(k, this.defaultName(k))));
  }

  remove(indices) { this.change((names) => indices.forEach((k) => names.delete(k))); }

  toggle(k) { if (this.names.has(k)) this.remove([k]); else this.add([k]); }

  rename(k, name) { this.change((names) => names.set(k, name.trim())); }

  undo() { if (this.past.length) this.names = this.past.pop(); }

  /* Return what is wrong with a name, or nothing. */
  fault(k) {
    const name = this.names.get(k);
    if (!name) return "a name must not be empty";
    return [...this.names].some(([j, other]) => j !== k && other === name) ? "two have this name" : "";
  }

  /* Return the name in a file: the default one where the given one is refused, and never one twice. */
  key(k) {
    if (!this.fault(k)) return this.names.get(k);
    let key = this.defaultName(k);
    while ([...this.names].some(([j, name]) => j !== k && name === key)) key += "_";
    return key;
  }

  ids() { return this.entities().map((k) => this.items[k].id).join(","); }

  /* Return the TOML of --entities: ids, or with `byEnds` the end points of edges, which a changed file still has. */
  toml(part, byEnds) {
    const lines = [`# Entities of ${printable(part)}: name = id; lengths in mm.`];
    for (const k of this.entities()) lines.push(`${tomlKey(this.key(k))} = ${this.value(k, byEnds)}`);
    return `${lines.join("\n")}\n`;
  }

  unit(k) { return this.items[k].unit || "mm"; }

  withUnit(k, text) { return this.unit(k) === "mm" ? `${text} mm` : `${text}${this.unit(k)}`; }

  /* Return the tolerance of an item as [lower, upper], null where none is asked, undefined where the text is none. */
  tolerance(k) {
    const name = this.toleranceClass(k);
    if (name) return this.hasClass(k) ? this.classes.deviations(name, this.items[k].size) : undefined;
    if (!this.isPosition(k)) return toleranceOf(this.tolerances.get(k) || this.shared(k));
    const zone = this.zone(k);
    return zone && [0, zone];
  }

  /* Return the tolerance class of an item, such as H7; nothing where its tolerance is none. */
  toleranceClass(k) { return this.isPosition(k) ? "" : this.classes.read(this.tolerances.get(k) || this.shared(k)); }

  hasClass(k) { return WITH_CLASS.includes(this.items[k].kind); }

  /* Return the zone of a position; null where none is typed, undefined where the text is none. */
  zone(k) { return zoneOf(this.tolerances.get(k) || ""); }

  /* The zone of a slot lies between two lines. */
  zoneSign(k) { return this.items[k].chain.first.length === 1 ? "⌀" : ""; }

  /* Return the tolerance of what has none of its own; that of lengths is none of angles, and no zone. */
  shared(k) { return this.unit(k) === "mm" && !this.isPosition(k) ? this.common : ""; }

  /* Return the error that a plan may make of an item, in its unit; null where the plan's accuracy decides. */
  permitted(k) {
    const limits = this.tolerance(k);
    return limits ? this.share * (limits[1] - limits[0]) / (this.isPosition(k) ? 1 : 2) : null;
  }

  /* Return why a plan would refuse the tolerance of an item, or nothing. */
  toleranceFault(k) {
    const limits = this.tolerance(k), { size: nominal } = this.items[k];
    if (!limits) {
      // "0,3" is 0.3 in many countries; in "-0.1,0.1" the comma is none of a number
      const typed = (this.tolerances.get(k) || this.shared(k)).trim(), dotted = typed.replace(/(\d),(?=\d)/g, "$1.");
      if (dotted !== typed && !typed.includes(".")) return `numbers need a decimal point, so write ${dotted}`;
    }
    if (this.isPosition(k) && !limits) return "a position needs its zone, a number like 0.2";
    if (this.materials.get(k)) {
      const size = this.sizeOf(k), { rows: [what] } = this.items[size];
      if (!this.names.has(size)) return `its material condition needs ${what} to be picked`;
      if (!this.tolerance(size)) return `its material condition needs a tolerance of ${what}`;
    }
    const name = this.toleranceClass(k);
    if (name && !this.hasClass(k)) return `only a diameter, distance or length has a tolerance class like ${name}`;
    if (name && !limits) return `ISO 286 has no ${name} for ${number(nominal)} mm`;
    if (limits === undefined) return "a tolerance must be a number like 0.05, two like -0.02/+0.05, or a class like H7";
    if (!(this.share > 0 && this.share <= 1)) return "the share must be above 0 % and at most 100 %";
    if (!limits) return "";
    if (!(limits[0] < limits[1])) return "the two deviations must differ";
    const error = this.permitted(k);
    if (error >= nominal && !this.isPosition(k)) return `the permitted error must be below ${this.withUnit(k, number(nominal))}`;
    const rough = this.parts(k).map((one) => this.items[one]).find(({ chords }) => chords.off > error);
    return rough
      ? `${rough.kind} ${rough.id} is known by ${rough.chords.n} chords only, ${number(rough.chords.off)} mm off its circle` : "";
  }

  /* Return what is measured of an item, and how wrong it may be. */
  told(k) {
    const { kind, axis, size: value, rows: [what] } = this.items[k], error = this.permitted(k);
    if (this.isPosition(k)) {
      const material = this.materials.get(k) ? ` (${this.materials.get(k)})` : "";
      return this.toleranceFault(k) ? what : `${what}, zone ${this.zoneSign(k)}${number(this.zone(k))} mm${material}: error up to ${number(error)} mm`;
    }
    const nominal = valueText({ kind, axis, nominal: value, unit: this.unit(k) });
    if (this.toleranceFault(k)) return nominal;
    if (error === null) return `${nominal}, error by the plan's accuracy`;
    const name = this.toleranceClass(k), limits = toleranceText(this.tolerance(k));
    return `${nominal} ${name ? `${name} (${limits})` : limits}: error up to ${this.withUnit(k, number(error))} (${number(100 * this.share)} %)`;
  }

  /* Return the TOML of --dimensions. */
  dimensionsToml(part, byEnds) {
    const lines = [`# Dimensions of ${printable(part)}; lengths and deviations in mm, angles in degrees.`, "[dimensions]"];
    for (const k of this.names.keys()) {
      if (this.isPosition(k)) {
        lines.push(`${tomlKey(this.key(k))} = { ${this.positionToml(k, byEnds)} }`);
        continue;
      }
      const { kind, axis } = this.items[k], limits = this.tolerance(k);
      const asked = [`${measured(kind)} = ${this.value(k, byEnds)}`];
      if (axis) asked.push(`direction = [${AXES[axis].join(", ")}]`);
      const name = this.toleranceClass(k);
      if (limits) asked.push(`tolerance = ${name ? `"${name}"` : `[${limits.join(", ")}]`}`);
      if (limits && this.share !== SHARE) asked.push(`share = ${this.share}`);
      lines.push(`${tomlKey(this.key(k))} = { ${asked.join(", ")} }`);
    }
    return `${lines.join("\n")}\n`;
  }

  positionToml(k, byEnds) {
    const { chain } = this.items[k], value = (n) => this.value(n, byEnds);
    const list = (numbers) => (numbers.length === 1 ? value(numbers[0]) : `[${numbers.map(value).join(", ")}]`);
    const asked = [`position = ${list(chain.first)}`, `zone = ${this.zone(k)}`];
    asked.push(`datums = [${chain.datums.map(list).join(", ")}]`);
    if (chain.pattern.length) asked.push(`pattern = [${chain.pattern.map(value).join(", ")}]`);
    if (this.materials.get(k)) {
      asked.push(`material = "${this.materials.get(k)}"`, `size = ${JSON.stringify(this.key(this.sizeOf(k)))}`);
    }
    if (this.share !== SHARE) asked.push(`share = ${this.share}`);
    return asked.join(", ");
  }

  /* Return a position as a plan takes it. */
  positionAsked(k) {
    const { chain } = this.items[k], entity = (n) => entityOf(this.items[n]);
    const group = (numbers) => (numbers.length === 1 ? entity(numbers[0]) : numbers.map(entity));
    const asked = { position: group(chain.first), zone: this.zone(k) ?? null, datums: chain.datums.map(group) };
    if (chain.pattern.length) asked.pattern = chain.pattern.map(entity);
    if (this.materials.get(k)) [asked.material, asked.size] = [this.materials.get(k), this.key(this.sizeOf(k))];
    return asked;
  }

  /* Return all that is collected and set, as plain values; `restore` takes it. */
  record() {
    const rows = [...this.names].map(([k, name]) => {
      const { id, kind, of, axis } = this.items[k], limits = this.tolerance(k);
      const parts = this.parts(k).map((one) => entityOf(this.items[one])), [entity] = parts;
      const asked = this.isPosition(k) ? this.positionAsked(k) : { [measured(kind)]: of ? parts : entity };
      if (axis) asked.direction = AXES[axis];
      if (limits && !this.isPosition(k)) asked.tolerance = this.toleranceClass(k) || limits;
      if (limits && this.share !== SHARE) asked.share = this.share;
      const own = this.tolerances.get(k) || "", fault = this.toleranceFault(k);
      const row = { id, name, own, key: this.key(k), asked, fault };
      if (!of) return { ...row, entity };
      const pair = { of: of.map((one) => this.items[one].id), kind, axis };
      if (this.isPosition(k)) [pair.counts, pair.material] = [chainCounts(this.items[k].chain), this.materials.get(k) || ""];
      return { ...row, pair };
    });
    return { rows, common: this.common, share: this.share };
  }

  restore({ rows, common, share }) {
    const at = new Map(this.items.map(({ id }, k) => [id, k]));
    for (const { id, pair } of rows.filter((row) => row.pair)) {
      const of = pair.of.map((one) => at.get(one));
      if (pair.kind === "position") {
        at.set(id, this.position(chainOf(of, pair.counts)));
        this.materials.set(at.get(id), pair.material);
        continue;
      }
      const options = betweenTwo(...of.map((k) => this.items[k]));
      at.set(id, this.pair(of, options.find(({ kind, axis }) => kind === pair.kind && axis === pair.axis)));
    }
    this.change((names) => {
      names.clear();
      rows.forEach(({ id, name }) => names.set(at.get(id), name));
    });
    this.tolerances = new Map(rows.map(({ id, own }) => [at.get(id), own]));
    [this.common, this.share] = [common, share];
  }

  /* Return an id as TOML, or with `byEnds` the end points of an edge, which a changed file still has. */
  value(k, byEnds) {
    const { id, kind, ends, of } = this.items[k];
    if (of) return `[${of.map((one) => this.value(one, byEnds)).join(", ")}]`;
    return kind !== "edge" ? `"${id}"` : byEnds ? JSON.stringify(ends) : id;
  }
}

const entityOf = ({ id, kind }) => (kind === "edge" ? Number(id) : id);
const number = (value) => String(Number(value.toPrecision(4)));
const printable = (text) => text.replace(/[^\x20-\x7e\xa0-\uffff]/g, " ");

/* Read ±0.05, 0.05, -0.02/+0.05 or 0 0.1; null of nothing, undefined of anything else. */
function toleranceOf(text) {
  const words = text.replace(/\u2212/g, "-").split(/[\s/;]+/).filter(Boolean);
  if (!words.length) return null;
  const form = /^±?[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?$/i;
  if (words.length > 2 || !words.every((word) => form.test(word))) return undefined;
  if (words.length === 1) {
    const half = Number(words[0].replace("±", ""));
    return half > 0 ? [-half, half] : undefined;
  }
  const limits = words.map(Number);
  if (limits.some(Number.isNaN)) return undefined;
  // drawings write the upper deviation first
  return limits[0] > limits[1] ? [limits[1], limits[0]] : limits;
}

function toleranceText([lower, upper]) {
  if (lower === -upper) return `±${number(upper)}`;
  const signed = (value) => `${value > 0 ? "+" : ""}${number(value)}`;
  return `${signed(upper)}/${signed(lower)}`;
}

function tomlKey(name) {
  if (/^[A-Za-z0-9_-]+$/.test(name)) return name;
  // JSON leaves DEL as it is, and TOML forbids it
  return JSON.stringify(name).replace(/\x7f/g, "\\u007f");
}
