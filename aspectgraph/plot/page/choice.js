/* What is collected, in order, with its names; and the file of it that --entities reads. */
"use strict";

class Choice {
  constructor(items) {
    this.items = items;
    this.names = new Map(); // index -> name, in the order collected
    this.past = [];
  }

  change(edit) {
    const before = new Map(this.names);
    edit(this.names);
    const same = before.size === this.names.size && [...before].every(([k, name]) => this.names.get(k) === name);
    if (!same) this.past.push(before);
  }

  defaultName(k) { const { id, kind } = this.items[k]; return kind === "edge" ? `e${id}` : id; }

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

  ids() { return [...this.names.keys()].map((k) => this.items[k].id).join(","); }

  /* Return the TOML of --entities: ids, or with `byEnds` the end points of edges, which a changed file still has. */
  toml(part, byEnds) {
    const lines = [`# Entities of ${part.replace(/[^\x20-\x7e\xa0-\uffff]/g, " ")}: name = id; lengths in mm.`];
    for (const [k, name] of this.names) {
      const { id, kind, ends } = this.items[k];
      const value = kind !== "edge" ? `"${id}"` : byEnds ? JSON.stringify(ends) : id;
      lines.push(`${tomlKey(this.fault(k) ? this.defaultName(k) : name)} = ${value}`);
    }
    return `${lines.join("\n")}\n`;
  }
}

function tomlKey(name) {
  if (/^[A-Za-z0-9_-]+$/.test(name)) return name;
  // JSON leaves DEL as it is, and TOML forbids it
  return JSON.stringify(name).replace(/\x7f/g, "\\u007f");
}
