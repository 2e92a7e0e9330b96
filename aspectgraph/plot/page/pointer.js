/* What mouse, pen and fingers do in the picture. */
"use strict";

const CLICK_PX = 4;

function watchPointer({ scene, state, at, inBox, point, moved, overlay, choice, chosen, ofFace, take, restart }) {
  const canvas = scene.canvas, down = new Map();
  let travelled = 0, pinched = false, pivot = null;
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [Math.round(event.clientX - box.left), Math.round(event.clientY - box.top)];
  };
  const boxed = (event) => event.shiftKey || document.getElementById("box").checked;

  canvas.addEventListener("pointerdown", (event) => {
    const [x, y] = place(event);
    canvas.setPointerCapture(event.pointerId);
    down.set(event.pointerId, { x, y });
    if (down.size === 1) {
      [travelled, pinched, pivot] = [0, false, scene.pivot()];
      state.box = boxed(event) && event.button === 0 ? { x0: x, y0: y, x1: x, y1: y } : null;
    } else [state.box, pinched] = [null, true];
  });

  canvas.addEventListener("pointermove", (event) => {
    const [x, y] = place(event), last = down.get(event.pointerId);
    if (!last) {
      const { line, face } = at(x, y);
      point(line, face, x, y);
      return;
    }
    const [dx, dy] = [x - last.x, y - last.y];
    travelled += Math.abs(dx) + Math.abs(dy);
    if (down.size === 2) {
      const other = [...down].find(([id]) => id !== event.pointerId)[1];
      const span = (p, q) => Math.max(Math.hypot(p.x - q.x, p.y - q.y), 1);
      scene.zoom(span({ x, y }, other) / span(last, other), (x + other.x) / 2, (y + other.y) / 2);
      slide(dx / 2, dy / 2);
    } else if (state.box) Object.assign(state.box, { x1: x, y1: y });
    else if (event.buttons & 6 || event.ctrlKey) slide(dx, dy);
    else if (travelled > CLICK_PX) turn(dx, dy);
    Object.assign(last, { x, y });
    if (state.box) overlay();
    else if (travelled > CLICK_PX) {
      point(-1, -1);
      moved();
    }
  });

  const up = (event) => {
    const known = down.delete(event.pointerId), [x, y] = place(event), box = state.box;
    if (!known || down.size || pinched || event.type === "pointercancel") return;
    state.box = null;
    if (travelled > CLICK_PX) {
      if (box) {
        const found = inBox(box);
        if (event.altKey) choice.remove(found);
        else choice.add(found);
        chosen();
      }
    } else if (event.button === 0) {
      const { line } = at(x, y);
      if (line >= 0) take(line);
    }
  };
  canvas.addEventListener("pointerup", up);
  canvas.addEventListener("pointercancel", up);
  canvas.addEventListener("pointerleave", () => point(-1, -1));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());

  canvas.addEventListener("dblclick", (event) => {
    const { face } = at(...place(event));
    if (face < 0 || ["two", "position"].some((id) => document.getElementById(id).checked)) return;
    choice.add(ofFace(face));
    chosen();
  });

  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    scene.zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0016)), ...place(event));
    moved();
  }, { passive: false });

  window.addEventListener("keydown", (event) => {
    if (event.target.tagName === "INPUT" || event.target.tagName === "TEXTAREA") return;
    if (event.key === "Escape" && state.box) {
      state.box = null;
      overlay();
    } else if (event.key === "Escape") {
      restart();
    } else if (event.key === "z" && (event.ctrlKey || event.metaKey)) {
      choice.undo();
      chosen();
    }
  });

  function slide(dx, dy) {
    scene.view.x -= dx / scene.view.scale;
    scene.view.y += dy / scene.view.scale;
  }

  function turn(dx, dy) {
    const half = Math.PI / 2, view = scene.view;
    scene.keep(pivot, () => {
      view.yaw -= dx * 0.009;
      view.pitch = Math.min(half, Math.max(-half, view.pitch + dy * 0.009));
    });
  }}
