// Frames as hapticd/record/frames.py makes them: header and columns, little-endian.
// @ts-check

export const MAGIC = 0x31465348;
export const HEADER_BYTES = 64;
export const FLAG = { running: 1, missedPeriod: 4, missedExchange: 8, excitation: 16, fault: 32, dropped: 256 };

/**
 * @typedef {object} Frame
 * @property {number} rows
 * @property {number} firstRow number of the first row among all rows since the servo loop began
 * @property {number} firstTick
 * @property {number} epoch number of the settings in force
 * @property {number} decimation raw counts in a coarse tick
 * @property {number} timeS of the first row, from the start of the servo loop
 * @property {number} periodS
 * @property {number} unixS when the newest row was taken from the ring
 * @property {number} originCounts
 * @property {Int32Array} tickOffset
 * @property {Float32Array} timeOffset
 * @property {Int32Array} counts from the origin
 * @property {Int32Array} ticks
 * @property {Float32Array} current
 * @property {Float32Array} measured
 * @property {Float32Array} force
 * @property {Float32Array} late
 * @property {Int32Array} flags
 */

/**
 * One frame.
 * @param {ArrayBuffer} buffer
 * @param {number} [at] where it begins, a multiple of four
 * @returns {Frame}
 */
export function decode(buffer, at = 0) {
  const head = new DataView(buffer, at, HEADER_BYTES);
  if (head.getUint32(0, true) !== MAGIC) throw new Error("not a frame");
  const rows = head.getUint32(4, true);
  const column = (/** @type {number} */ index) => at + HEADER_BYTES + 4 * rows * index;
  const int32 = (/** @type {number} */ index) => new Int32Array(buffer, column(index), rows);
  const float32 = (/** @type {number} */ index) => new Float32Array(buffer, column(index), rows);
  return {
    rows,
    firstRow: Number(head.getBigInt64(8, true)),
    firstTick: Number(head.getBigInt64(16, true)),
    epoch: head.getUint32(24, true),
    decimation: head.getUint32(28, true),
    timeS: head.getFloat64(32, true),
    periodS: head.getFloat64(40, true),
    unixS: head.getFloat64(48, true),
    originCounts: Number(head.getBigInt64(56, true)),
    tickOffset: int32(0),
    timeOffset: float32(1),
    counts: int32(2),
    ticks: int32(3),
    current: float32(4),
    measured: float32(5),
    force: float32(6),
    late: float32(7),
    flags: int32(8),
  };
}

/**
 * A stream of the server: a description, then frames.
 * @param {ArrayBuffer} buffer
 * @returns {{description: any, frames: Frame[]}}
 */
export function decodeStream(buffer) {
  const view = new DataView(buffer);
  const size = view.getUint32(0, true);
  const description = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  const frames = [];
  for (let at = 4 + size; at < buffer.byteLength; ) {
    const bytes = view.getUint32(at, true);
    frames.push(decode(buffer.slice(at + 4, at + 4 + bytes)));
    at += 4 + bytes;
  }
  return { description, frames };
}

/** With its length before it. @param {Uint8Array<ArrayBuffer>} bytes */
export function prefixed(bytes) {
  const size = new DataView(new ArrayBuffer(4));
  size.setUint32(0, bytes.length, true);
  return [size.buffer, bytes];
}
