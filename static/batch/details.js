// The chosen result, with all columns of the table.

const STAGES = [
  ["opening", "#5b8def"],
  ["integrating", "#d98a29"],
  ["garment", "#3fa7a0"],
  ["writing", "#6fae5a"],
  ["measuring", "#a874c9"],
];

function stagesOf(row) {
  const bar = document.createElement("div");
  bar.className = "stages";
  bar.setAttribute("role", "img");
  const words = [];
  for (const [name, color] of STAGES) {
    const seconds = row[`seconds_${name}`];
    if (typeof seconds !== "number" || !row.seconds) continue;
    const part = document.createElement("i");
    part.style.width = `${(100 * seconds) / row.seconds}%`;
    part.style.background = color;
    bar.append(part);
    words.push(`${name} ${seconds.toFixed(1)} s`);
  }
  bar.setAttribute("aria-label", `Time by stage: ${words.join(", ")}`);
  bar.title = words.join(", ");
  return bar;
}

export function showDetails(place, row, columns) {
  if (!row) {
    place.replaceChildren("Choose a result.");
    return;
  }
  const title = document.createElement("h2");
  title.textContent = row.name;
  /** @type {HTMLElement[]} */
  const parts = [title];
  if (row.thumbnail) {
    const image = document.createElement("img");
    image.src = row.thumbnail;
    image.alt = `The flattened shape of ${row.name}`;
    parts.push(image);
  }
  if (typeof row.seconds === "number") parts.push(stagesOf(row));
  const list = document.createElement("dl");
  for (const column of columns) {
    const value = column.show(row);
    if (value === "" || column.name === "name") continue;
    const dt = document.createElement("dt");
    dt.textContent = column.title;
    dt.title = column.meaning ?? "";
    const dd = document.createElement("dd");
    dd.textContent = value;
    if (column.name === "outcome") dd.className = row.outcome === "done" ? "done" : "bad";
    if (column.name === "review") dd.className = row.review ?? "";
    list.append(dt, dd);
  }
  parts.push(list);
  place.replaceChildren(...parts);
}
