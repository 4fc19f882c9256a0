// Equations as MathML, which browsers draw and read aloud by themselves.

const NAMESPACE = "http://www.w3.org/1998/Math/MathML";

function element(tag, ...children) {
  const made = document.createElementNS(NAMESPACE, tag);
  made.append(...children.map(node));
  return made;
}

/** A string becomes a number, a name or an operator; nodes stay as they are. */
function node(content) {
  if (typeof content !== "string") return content;
  const tag = /^[\d.]+$/.test(content) ? "mn" : /^[\p{L}′]+$/u.test(content) ? "mi" : "mo";
  const made = document.createElementNS(NAMESPACE, tag);
  made.textContent = content;
  // Brackets as high as letters: nothing here is higher than a line.
  if (tag === "mo" && "()|{}".includes(content))
    for (const [name, value] of [
      ["stretchy", "false"],
      ["lspace", "0"],
      ["rspace", "0"],
    ])
      made.setAttribute(name, value);
  return made;
}

export const row = (...parts) => element("mrow", ...parts);
export const sub = (base, below) => element("msub", base, below);
export const sup = (base, above) => element("msup", base, above);
export const both = (base, below, above) => element("msubsup", base, below, above);
export const fraction = (over, under) => element("mfrac", over, under);
export const root = (...parts) => element("msqrt", ...parts);
export const sum = (below) => element("munder", "∑", below);

export function words(text) {
  const made = element("mtext");
  made.textContent = text.replace(/^ +| +$/g, (spaces) => "\u00a0".repeat(spaces.length)); // MathML drops plain ones
  return made;
}

/** Lines of a definition by cases: [value, condition]. */
export function cases(...lines) {
  const table = element(
    "mtable",
    ...lines.map((cells) => element("mtr", ...cells.map((cell) => element("mtd", cell)))),
  );
  const brace = document.createElementNS(NAMESPACE, "mo");
  brace.textContent = "{";
  return row(brace, table);
}

/** One displayed equation. */
export function equation(...parts) {
  const made = element("math", ...parts);
  made.setAttribute("display", "block");
  return made;
}
