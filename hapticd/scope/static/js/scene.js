// A drawing as data, and what is made of it: an SVG document, or a PNG. So that both are the same picture.
// @ts-check

import { svg } from "./dom.js";

/**
 * @typedef {{kind: "line", points: (number | null)[][], stroke: string, width?: number, dash?: number[], alpha?: number}} Line null: broken off
 * @typedef {{kind: "rect", x: number, y: number, width: number, height: number, fill: string, alpha?: number}} Rect
 * @typedef {{kind: "text", x: number, y: number, text: string, fill: string, size?: number, bold?: boolean, anchor?: "start" | "middle" | "end"}} Text
 * @typedef {{width: number, height: number, items: (Line | Rect | Text)[]}} Scene
 */

const FONT = "system-ui, 'DejaVu Sans', sans-serif";
const PER_PIXEL = 2;
const SIZE = 11;

/** @param {Line} line @returns {string} */
function path({ points }) {
  let down = false;
  const parts = [];
  for (const [x, y] of points) {
    if (x === null || y === null) {
      down = false;
      continue;
    }
    parts.push(`${down ? "L" : "M"}${x.toFixed(2)} ${y.toFixed(2)}`);
    down = true;
  }
  return parts.join("");
}

/** @param {Scene} scene */
export function toSvg({ width, height, items }) {
  const root = svg("svg", { width, height, viewBox: `0 0 ${width} ${height}`, "font-family": FONT });
  for (const item of items) {
    if (item.kind === "rect") root.append(svg("rect", { x: item.x, y: item.y, width: item.width, height: item.height, fill: item.fill, "fill-opacity": item.alpha ?? 1 }));
    else if (item.kind === "text") root.append(svg("text", { x: item.x, y: item.y, fill: item.fill, "font-size": item.size ?? SIZE, "font-weight": item.bold ? 600 : 400, "text-anchor": item.anchor ?? "start" }, item.text));
    else root.append(svg("path", { d: path(item), fill: "none", stroke: item.stroke, "stroke-width": item.width ?? 1, "stroke-dasharray": (item.dash ?? []).join(" "), "stroke-opacity": item.alpha ?? 1, "stroke-linejoin": "round" }));
  }
  return `<?xml version="1.0" encoding="UTF-8"?>\n${new XMLSerializer().serializeToString(root)}\n`;
}

/** @param {Scene} scene @returns {Promise<Blob>} */
export async function toPng({ width, height, items }) {
  const canvas = document.createElement("canvas");
  canvas.width = width * PER_PIXEL;
  canvas.height = height * PER_PIXEL;
  const ctx = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  ctx.scale(PER_PIXEL, PER_PIXEL);
  for (const item of items) {
    ctx.globalAlpha = ("alpha" in item ? item.alpha : 1) ?? 1;
    if (item.kind === "rect") {
      ctx.fillStyle = item.fill;
      ctx.fillRect(item.x, item.y, item.width, item.height);
    } else if (item.kind === "text") {
      ctx.fillStyle = item.fill;
      ctx.font = `${item.bold ? "600 " : ""}${item.size ?? SIZE}px ${FONT}`;
      ctx.textAlign = item.anchor === "middle" ? "center" : (item.anchor ?? "start");
      ctx.fillText(item.text, item.x, item.y);
    } else {
      ctx.strokeStyle = item.stroke;
      ctx.lineWidth = item.width ?? 1;
      ctx.setLineDash(item.dash ?? []);
      ctx.lineJoin = "round";
      ctx.stroke(new Path2D(path(item)));
    }
  }
  return new Promise((resolve, reject) => canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("the picture is too large"))), "image/png"));
}

const measuring = /** @type {CanvasRenderingContext2D} */ (document.createElement("canvas").getContext("2d"));

/** Width of a text, px. @param {string} text @param {number} [size] */
export function widthOf(text, size = SIZE) {
  measuring.font = `${size}px ${FONT}`;
  return measuring.measureText(text).width;
}
