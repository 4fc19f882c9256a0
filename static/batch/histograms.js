// Histograms that filter: a click on a bar keeps the results in it; a second bar extends the range.

const BINS = 16;

/** The range of some numbers, widened to round ends. */
function rangeOf(values) {
  const low = Math.min(...values);
  const high = Math.max(...values);
  if (low === high) return [low - 0.5, high + 0.5];
  const step = 10 ** Math.floor(Math.log10((high - low) / 2));
  return [Math.floor(low / step) * step, Math.ceil(high / step) * step];
}

export function makeHistograms(place, columns, rows, onChange) {
  const made = [];
  for (const column of columns) {
    const values = rows.map((row) => row[column.name]).filter((value) => typeof value === "number");
    if (values.length < 2) continue;
    const [low, high] = rangeOf(values);
    const width = (high - low) / BINS;
    const binOf = (value) => Math.min(BINS - 1, Math.max(0, Math.floor((value - low) / width)));
    const box = document.createElement("section");
    box.className = "histogram";
    box.setAttribute("aria-label", `${column.title}: histogram and filter`);
    const title = document.createElement("h2");
    const said = document.createElement("span");
    title.append(column.title, said);
    const bins = document.createElement("div");
    bins.className = "bins";
    bins.setAttribute("role", "group");
    bins.setAttribute("aria-label", `Ranges of ${column.title}`);
    const ends = document.createElement("div");
    ends.className = "ends";
    for (const end of [low, high]) {
      const span = document.createElement("span");
      span.textContent = column.format(end);
      ends.append(span);
    }
    const bars = [];
    const one = { column, binOf, range: null, bars };
    for (let n = 0; n < BINS; n++) {
      const button = document.createElement("button");
      button.type = "button";
      const bar = document.createElement("i");
      button.append(bar);
      button.addEventListener("click", () => {
        if (one.range && one.range[0] === n && one.range[1] === n) one.range = null;
        else if (one.range && one.range[0] === one.range[1])
          one.range = [Math.min(n, one.range[0]), Math.max(n, one.range[0])];
        else one.range = [n, n];
        onChange();
      });
      bars.push({ button, bar, from: low + n * width, to: low + (n + 1) * width });
      bins.append(button);
    }
    one.draw = (shown) => {
      const counts = new Array(BINS).fill(0);
      for (const row of shown) if (typeof row[column.name] === "number") counts[binOf(row[column.name])] += 1;
      const most = Math.max(1, ...counts);
      bars.forEach(({ button, bar, from, to }, n) => {
        bar.style.height = counts[n] ? `${Math.max(4, (100 * counts[n]) / most)}%` : "0";
        const words = `${column.format(from)} to ${column.format(to)}: ${counts[n]}`;
        button.title = words;
        button.setAttribute("aria-label", `${column.title} ${words}`);
        button.setAttribute("aria-pressed", String(Boolean(one.range && n >= one.range[0] && n <= one.range[1])));
      });
      said.textContent = one.range
        ? `${column.format(bars[one.range[0]].from)} to ${column.format(bars[one.range[1]].to)}`
        : "";
    };
    box.append(title, bins, ends);
    place.append(box);
    made.push(one);
  }
  return {
    /** Whether a row is within all chosen ranges, but that of one column. */
    keeps: (row, except = null) =>
      made.every(({ column, binOf, range }) => {
        if (!range || column.name === except) return true;
        const value = row[column.name];
        return typeof value === "number" && binOf(value) >= range[0] && binOf(value) <= range[1];
      }),
    draw: (shownWithout) => made.forEach((one) => one.draw(shownWithout(one.column.name))),
    clear: () => made.forEach((one) => (one.range = null)),
  };
}
