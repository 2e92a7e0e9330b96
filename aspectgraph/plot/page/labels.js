/* Labels of lines: as many as the picture has room for, so the nearer one looks the more there are. */
"use strict";

const LABEL_PX = 12;

/* Return where each line is seen: the number of its pixels, and the one of them nearest to its middle. */
function seenLines(codes, width, height, middles) {
  const seen = new Map();
  for (let at = 0; at < codes.length; at++) {
    const k = codes[at] - 1;
    if (k < 0 || k >= middles.length) continue;
    const x = at % width, y = height - 1 - ((at / width) | 0);
    const far = (x - middles[k][0]) ** 2 + (y - middles[k][1]) ** 2;
    const known = seen.get(k);
    if (!known) seen.set(k, { pixels: 1, x, y, far });
    else {
      known.pixels += 1;
      if (far < known.far) Object.assign(known, { x, y, far });
    }
  }
  return seen;
}

/* Choose labels that cover no other: first what is wanted, then the lines that are seen longest.

A line that is not wanted has a label only where it is longer than the label. */
function placeLabels(context, texts, seen, wanted, width, height) {
  context.font = `600 ${LABEL_PX}px system-ui, sans-serif`;
  // the tools above, the scale and the axes below stay free
  const boxes = [];
  const kept = [{ x: 0, y: 0, w: width, h: 46 }, { x: 0, y: height - 44, w: 180, h: 44 }, { x: width - 100, y: height - 96, w: 100, h: 96 }];
  const order = [...seen.keys()].sort((i, j) => wanted(j) - wanted(i) || seen.get(j).pixels - seen.get(i).pixels || i - j);
  for (const k of order) {
    const { pixels, x, y } = seen.get(k), w = context.measureText(texts[k]).width + 8, h = LABEL_PX + 5;
    if (!wanted(k) && pixels / 3 < w) continue;
    const tries = [[0, 0], [0, -h], [0, h], [w * 0.8, 0], [-w * 0.8, 0], [w * 0.8, -h], [-w * 0.8, h]];
    for (const [dx, dy] of tries) {
      const box = { k, x: x + dx - w / 2, y: y + dy - h / 2, w, h };
      const inside = box.x >= 0 && box.y >= 0 && box.x + w <= width && box.y + h <= height;
      const apart = (o) => box.x + w + 3 <= o.x || o.x + o.w + 3 <= box.x || box.y + h + 2 <= o.y || o.y + o.h + 2 <= box.y;
      if (inside && boxes.every(apart) && kept.every(apart)) {
        boxes.push(box);
        break;
      }
    }
  }
  return boxes;
}

function drawLabels(context, boxes, texts, colourOf) {
  context.font = `600 ${LABEL_PX}px system-ui, sans-serif`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  for (const { k, x, y, w, h } of boxes) {
    context.fillStyle = "rgba(255,255,255,0.88)";
    context.beginPath();
    context.roundRect(x, y, w, h, 4);
    context.fill();
    context.fillStyle = colourOf(k);
    context.fillText(texts[k], x + w / 2, y + h / 2 + 0.5);
  }
}

/* Draw a bar of a round length in mm, and the directions of the part's axes. */
function drawScale(context, scene, width, height) {
  const { scale } = scene.view, most = 140 / scale, tens = 10 ** Math.floor(Math.log10(most));
  const length = [5, 2, 1].map((n) => n * tens).find((n) => n <= most), x = 18, y = height - 18;
  context.strokeStyle = context.fillStyle = "#4d5661";
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(x, y - 5);
  context.lineTo(x, y);
  context.lineTo(x + length * scale, y);
  context.lineTo(x + length * scale, y - 5);
  context.stroke();
  context.font = "12px system-ui, sans-serif";
  context.textAlign = "left";
  context.textBaseline = "bottom";
  context.fillText(`${Number(length.toPrecision(1))} mm`, x + 4, y - 3);
  const [right, up] = scene.axes, at = [width - 52, height - 48];
  ["x", "y", "z"].forEach((name, i) => {
    const [dx, dy] = [30 * right[i], -30 * up[i]];
    context.strokeStyle = context.fillStyle = ["#b3261e", "#1b7a3d", "#1f5fbf"][i];
    context.beginPath();
    context.moveTo(...at);
    context.lineTo(at[0] + dx, at[1] + dy);
    context.stroke();
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillText(name, at[0] + 1.35 * dx, at[1] + 1.35 * dy);
  });
}
