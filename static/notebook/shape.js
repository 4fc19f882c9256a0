// The shape in a notebook's cell: a click on the cloth asks Python for the grasp pose there.

const NS = "http://www.w3.org/2000/svg";

/** @param {string} name @param {Record<string, string | number>} values */
function drawn(name, values) {
  const element = document.createElementNS(NS, name);
  for (const [key, value] of Object.entries(values)) element.setAttribute(key, String(value));
  return element;
}

/** @param {{ model: any, el: HTMLElement }} cell */
function render({ model, el }) {
  const [rows, cols] = model.get("size");
  const picture = /** @type {SVGSVGElement} */ (
    drawn("svg", { viewBox: model.get("box"), role: "img", tabindex: 0 })
  );
  picture.setAttribute("aria-label", "The flattened garment; click the cloth to pick a point");
  picture.style.cssText = "max-width: 100%; max-height: 70vh; cursor: crosshair; background: #fff";
  const image = drawn("image", { href: model.get("image"), width: cols, height: rows });
  const marks = drawn("g", {});
  const layer = /** @type {SVGGElement} */ (drawn("g", { transform: model.get("turn") }));
  layer.append(image, marks);
  picture.append(layer);
  const words = document.createElement("output");
  words.style.cssText = "display: block; font-family: monospace; min-height: 1.4em";
  el.append(picture, words);

  picture.addEventListener("click", (event) => {
    const toPicture = layer.getScreenCTM()?.inverse();
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(toPicture);
    model.set("asked", [Math.floor(y), Math.floor(x), model.get("asked")[2] + 1]);
    model.save_changes();
  });

  const show = () => {
    const size = Math.max(rows, cols) / 70;
    const found = [...model.get("points"), ...model.get("picks")];
    marks.replaceChildren(
      ...found.map(({ name, row, col, by_hand }) => {
        const mark = drawn("circle", { cx: col + 0.5, cy: row + 0.5, r: size });
        mark.style.cssText = `fill: ${by_hand ? "#d95f02" : "#fff"}; stroke: #000; stroke-width: ${size / 4}`;
        const title = drawn("title", {});
        title.textContent = name;
        mark.append(title);
        return mark;
      }),
    );
    words.textContent = model.get("told");
  };
  for (const name of ["picks", "points", "told"]) model.on(`change:${name}`, show);
  show();
}

export default { render };
