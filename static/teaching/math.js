// Equations as MathML, which browsers draw and read aloud by themselves.

const NAMESPACE = "http://www.w3.org/1998/Math/MathML";

/** @param {string} tag @param {...(Node | string)} children */
function element(tag, ...children) {
  const made = document.createElementNS(NAMESPACE, tag);
  made.append(...children);
  return made;
}

const TERM = /([\d.]+[½°]?|[\p{L}′]+|\S)(?:([_^])([\d.]+|[\p{L}′]+))?/gu;

/** The numbers, names and operators of a string, with `_` below and `^` above, as "A_w = 2"; nodes stay as they are. */
function terms(/** @type {Part} */ content) {
  if (typeof content !== "string") return [content];
  return [...content.matchAll(TERM)].map(([, base, mark, script]) =>
    mark ? element(mark === "_" ? "msub" : "msup", symbol(base), symbol(script)) : symbol(base),
  );
}

function symbol(/** @type {string} */ text) {
  const tag = /^\d/.test(text) ? "mn" : /^[\p{L}′]+$/u.test(text) ? "mi" : "mo";
  const made = element(tag, text);
  // Brackets as high as letters: nothing here is higher than a line.
  if (tag === "mo" && "()|{}".includes(text)) {
    made.setAttribute("stretchy", "false");
    made.setAttribute("lspace", "0");
    made.setAttribute("rspace", "0");
  }
  return made;
}

/** @param {...any} parts */
export const row = (...parts) => element("mrow", ...parts.flatMap(terms));

function single(/** @type {Part} */ content) {
  const found = terms(content);
  return found.length === 1 ? found[0] : row(...found);
}

/** @param {Part} base @param {Part} below */
export const sub = (base, below) => element("msub", single(base), single(below));
/** @param {Part} base @param {Part} above */
export const sup = (base, above) => element("msup", single(base), single(above));
/** @param {Part} over @param {Part} under */
export const fraction = (over, under) => element("mfrac", single(over), single(under));
/** @param {...any} parts */
export const root = (...parts) => element("msqrt", ...parts.flatMap(terms));
export const sum = (/** @type {Part} */ below) => element("munder", symbol("∑"), single(below));

export function words(/** @type {string} */ text) {
  // MathML drops plain spaces at the ends.
  return element(
    "mtext",
    text.replace(/^ +| +$/g, (spaces) => "\u00a0".repeat(spaces.length)),
  );
}

/** Lines of a definition by cases: [value, condition]. @param {...Part[]} lines */
export function cases(...lines) {
  const table = element(
    "mtable",
    ...lines.map((cells) => element("mtr", ...cells.map((cell) => element("mtd", single(cell))))),
  );
  return row(element("mo", "{"), table);
}

/** One displayed equation. @param {...any} parts */
export function equation(...parts) {
  const made = element("math", ...parts.flatMap(terms));
  made.setAttribute("display", "block");
  return made;
}
