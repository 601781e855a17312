// A small expression over named numbers: + − * / ^, brackets, a few functions. Parsed into closures; nothing is evaluated as code.
// @ts-check

/** @typedef {() => number} Value */

const TOKEN = /\s*(?:(\d+\.?\d*(?:e[-+]?\d+)?|\.\d+(?:e[-+]?\d+)?)|([a-z_][\w.]*)|([-+*/^(),]))/iy;
/** @type {Record<string, {most: number, of: (...values: number[]) => number}>} */
const FUNCTIONS = {
  abs: { most: 1, of: Math.abs },
  sqrt: { most: 1, of: Math.sqrt },
  exp: { most: 1, of: Math.exp },
  log: { most: 1, of: Math.log },
  sin: { most: 1, of: Math.sin },
  cos: { most: 1, of: Math.cos },
  sign: { most: 1, of: Math.sign },
  min: { most: 8, of: Math.min },
  max: { most: 8, of: Math.max },
};
/** @type {Record<string, [number, (a: number, b: number) => number]>} precedence, and what it does */
const OPERATORS = {
  "+": [1, (a, b) => a + b],
  "-": [1, (a, b) => a - b],
  "*": [2, (a, b) => a * b],
  "/": [2, (a, b) => a / b],
  "^": [4, (a, b) => a ** b],
};
const SIGN = 3;
const DEEPEST = 64;

/** @param {string} text */
function tokens(text) {
  const found = [];
  TOKEN.lastIndex = 0;
  for (let at = 0; text.slice(at).trim(); at = TOKEN.lastIndex) {
    const match = TOKEN.exec(text);
    const rest = text.slice(at).trimStart();
    if (!match) throw new Error(`${rest[0]} at character ${text.length - rest.length + 1} means nothing here`);
    found.push(match[0].trim());
  }
  return found;
}

/**
 * @param {string} text
 * @param {(name: string) => Value} variable what a name stands for; it throws where it stands for nothing
 * @returns {Value}
 */
export function compile(text, variable) {
  const left = tokens(text).reverse();
  const next = () => left[left.length - 1] ?? "the end";
  const take = (/** @type {string} */ wanted) => {
    if (next() !== wanted) throw new Error(`${wanted} is missing before ${next()}`);
    left.pop();
  };

  /** @param {number} deep @returns {Value} */
  const operand = (deep) => {
    if (deep > DEEPEST) throw new Error(`more than ${DEEPEST} in each other`);
    const token = left.pop() ?? "the end";
    if (token === "-" || token === "+") {
      const value = sum(SIGN, deep + 1);
      return token === "-" ? () => -value() : value;
    }
    if (token === "(") {
      const value = sum(0, deep + 1);
      take(")");
      return value;
    }
    if (/^[\d.]/.test(token)) {
      const value = Number(token);
      return () => value;
    }
    if (!/^\w/.test(token) || token === "the end") throw new Error(`a value is missing before ${token}`);
    if (next() !== "(") return token === "pi" ? () => Math.PI : variable(token);
    const rule = Object.hasOwn(FUNCTIONS, token) ? FUNCTIONS[token] : null;
    if (!rule) throw new Error(`${token} is no function; there are ${Object.keys(FUNCTIONS).join(", ")}`);
    left.pop();
    const values = [sum(0, deep + 1)];
    while (next() === "," && values.length < rule.most) {
      left.pop();
      values.push(sum(0, deep + 1));
    }
    take(")");
    if (rule.most === 1) return () => rule.of(values[0]());
    return () => rule.of(...values.map((value) => value()));
  };

  /** Everything that binds as strongly as this, or more. @param {number} least @param {number} deep @returns {Value} */
  const sum = (least, deep) => {
    let value = operand(deep);
    for (;;) {
      const [binds, of] = OPERATORS[next()] ?? [-1, Math.max];
      if (binds < Math.max(least, 0)) return value;
      left.pop();
      const before = value;
      const after = sum(binds === 4 ? 4 : binds + 1, deep + 1); // a ^ b ^ c is a ^ (b ^ c)
      value = () => of(before(), after());
    }
  };

  const value = sum(0, 0);
  if (left.length) throw new Error(`${next()} is left over`);
  return value;
}
