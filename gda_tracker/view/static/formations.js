// Formations: an ellipse that holds the members, what is known of their number, lines to parents.

import { colours } from "./colours.js";
import { ellipse } from "./geometry.js";
import { outline, outlines } from "./signs.js";

const MARGIN_PX = 16; // diamonds lie within, too
const LINE_PX = 13;
const WIDE_PX = 40;

export function drawFormations(scope, formations) {
  const c = scope.context;
  const colour = colours().select;
  const margin = MARGIN_PX / scope.sx;
  formations.id.forEach((_, i) => {
    const [x, y] = [formations.x[i], formations.y[i]];
    // Longer by about the margin, however long it is.
    const grow = (v) => (Math.sqrt(Math.max(v, 0)) + margin) ** 2;
    const [long, short, vx, vy] = axes(formations.xx[i], formations.xy[i], formations.yy[i]);
    const [a, b] = [grow(long), grow(short)];
    const edge = ellipse(x, y, a * vx * vx + b * vy * vy, (a - b) * vx * vy, a * vy * vy + b * vx * vx, 1);
    outline(scope, edge, colour, { dash: [2, 4], width: 1.6 });
    outlines(scope, formations.parents[i].map((parent) => [parent, [x, y]]), colour, { dash: [1, 5], width: 1.2 });
    const top = Math.min(...edge.map((point) => scope.px(...point)[1]));
    c.font = "600 11px system-ui, 'DejaVu Sans', sans-serif";
    c.textAlign = "center";
    c.textBaseline = "bottom";
    c.lineWidth = 3;
    // Far off there is room for the number alone.
    const across = Math.max(...edge.map((point) => Math.abs(scope.px(...point)[0] - scope.px(x, y)[0])));
    const lines = across < WIDE_PX ? formations.text[i].slice(0, 1) : formations.text[i];
    lines.forEach((text, k) => {
      const [px, py] = [scope.px(x, y)[0], top - 3 - LINE_PX * (lines.length - 1 - k)];
      c.strokeStyle = colours().panel;
      c.strokeText(text, px, py);
      c.fillStyle = colour;
      c.fillText(text, px, py);
    });
  });
}

// Eigenvalues of a symmetric matrix, the larger first, and the direction of its eigenvector.
function axes(a, b, c) {
  const middle = (a + c) / 2;
  const off = Math.hypot((a - c) / 2, b);
  const angle = 0.5 * Math.atan2(2 * b, a - c);
  return [middle + off, middle - off, Math.cos(angle), Math.sin(angle)];
}
