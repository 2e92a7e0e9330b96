/* Tolerance classes of ISO 286, such as H7 of a hole, as limit deviations.

The rules are those of aspectgraph/dimensions/tolerances.py, and the figures come from there with the page. */
"use strict";

const BELOW = ["a", "b", "c", "cd", "d", "e", "ef", "f", "fg", "g"];

class ToleranceClasses {
  constructor(tables) { Object.assign(this, tables); }

  /* Return a class as the standard writes it; nothing of a text that is none. */
  read(text) {
    const [, letters, grade] = /^([A-Za-z]{1,2}) ?(0?[0-9]|1[0-8])$/.exec(text.trim()) || [];
    if (!letters) return "";
    const given = /^[A-Z]/.test(letters) ? letters.toUpperCase() : letters, kind = given.toLowerCase();
    const isOneCase = given === kind || given === given.toUpperCase();
    const isKnown = kind in this.distances || ["h", "j", "js"].includes(kind);
    return isOneCase && isKnown ? given + grade : "";
  }

  /* Return [lower, upper] in mm of a class that `read` returned; undefined where the standard has none. */
  deviations(name, nominal) {
    const [, letters, grade] = /^([A-Za-z]+)(\d+)$/.exec(name), size = Number(nominal.toFixed(3));
    const of = { name, size, kind: letters.toLowerCase(), isHole: letters !== letters.toLowerCase() };
    const place = this.grades.indexOf(grade), width = this.width(size, place);
    let limits;
    if (of.kind === "js") limits = [-width / 2, width / 2];
    else {
      const near = this.distance(of, place);
      limits = of.isHole === [...BELOW, "h"].includes(of.kind) ? [near, near + width] : [near - width, near];
    }
    return size > 0 && limits.every(Number.isFinite) ? limits.map((um) => Number((um / 1000).toFixed(9)) + 0) : undefined;
  }

  /* Return the width of a grade in µm; NaN where it has none. */
  width(size, place) { return this.widths[this.limits.findIndex((limit) => size <= limit)]?.[place] ?? NaN; }

  /* Return the limit deviation nearer to the nominal size in µm; NaN where there is none. */
  distance({ name, kind, isHole, size }, place) {
    if (kind === "h") return 0;
    if (kind === "j") return this.j[name]?.[this.limits.find((limit) => size <= limit)] ?? NaN;
    const value = this.distances[kind][this.steps.find((limit) => size <= limit)] ?? NaN;
    if (["a", "b"].includes(kind) && size <= 1) return NaN;
    if (BELOW.includes(kind)) return isHole ? value : -value;
    // the grade as a number; 01 is -1
    const number = place - 1;
    if (isHole) return this.upperOfHole({ name, kind, size, value }, place, number);
    return kind === "k" && !(number >= 4 && number <= 7) ? 0 * value : value;
  }

  /* Return the upper limit deviation of a hole K to ZC from the deviation of its shaft. */
  upperOfHole({ name, kind, size, value }, place, number) {
    if (kind === "k" && number > 8 && size > 3) return NaN;
    if (kind === "n" && number > 8 && size <= 1) return NaN;
    if (!(size > 3 && size <= 500)) return -value;
    if (number > (["k", "m", "n"].includes(kind) ? 8 : 7)) return kind === "n" ? 0 * value : -value;
    if (number < 3) return NaN;
    if (name === "M6" && size > 250 && size <= 315) return -9;
    return this.width(size, place) - this.width(size, place - 1) - value;
  }
}
