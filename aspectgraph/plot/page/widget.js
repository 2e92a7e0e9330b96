/* The picker in a notebook, for anywidget: the page in a frame of its own, which tells what is picked.

The model holds the page, its height in px, and `picked`, what the page said last; any number of frames show it. */

function render({ model, el }) {
  const frame = document.createElement("iframe");
  let heard = null;
  // a frame without the notebook's origin: the page reaches nothing of it
  frame.sandbox = "allow-scripts allow-downloads";
  frame.allow = "clipboard-write";
  frame.title = "edges, rims and arcs of the part";
  frame.style.cssText = "display: block; box-sizing: border-box; width: 100%; border: 1px solid #d9dee4; background: #fff;";
  frame.style.height = `${model.get("height_px")}px`;

  const tell = () => frame.contentWindow?.postMessage({ restore: model.get("picked") }, "*");
  const hear = ({ source, data }) => {
    if (source !== frame.contentWindow) return;
    if (data.opened) tell();
    if (data.picked) {
      heard = JSON.stringify(data.picked);
      model.set("picked", data.picked);
      model.save_changes();
    }
  };
  const changed = () => { if (JSON.stringify(model.get("picked")) !== heard) tell(); };

  window.addEventListener("message", hear);
  model.on("change:picked", changed);
  frame.srcdoc = model.get("page");
  el.append(frame);
  return () => {
    window.removeEventListener("message", hear);
    model.off("change:picked", changed);
  };
}

export default { render };
