// The signs of both displays: detections, gates, covariances, tracks, labels.

import { classOf, colours, trackColour, withAlpha } from "./colours.js";

const DOT = 2.1;

// Squares: thousands of circles would take a software renderer too long.
export function dots(scope, points, colour, radius = DOT) {
  const c = scope.context;
  c.fillStyle = colour;
  for (const [x, y] of points) {
    const [px, py] = scope.px(x, y);
    if (scope.inside(px, py)) c.fillRect(px - radius, py - radius, 2 * radius, 2 * radius);
  }
}

// Older ones fainter.
export const faded = (age, count) => withAlpha(colours().detection, 0.06 + 0.5 * (1 - age / (count + 1)) ** 1.6);

export function rings(scope, points) {
  const c = scope.context;
  c.strokeStyle = colours().detection;
  c.lineWidth = 1;
  for (const [x, y] of points) {
    c.beginPath();
    c.arc(...scope.px(x, y), 7.5, 0, 2 * Math.PI);
    c.stroke();
  }
}

export function outline(scope, points, colour, style) {
  outlines(scope, [points], colour, style);
}

// Many lines of one style at once.
export function outlines(scope, lines, colour, { dash = [], width = 1.2 } = {}) {
  const c = scope.context;
  c.setLineDash(dash);
  c.strokeStyle = colour;
  c.lineWidth = width;
  c.beginPath();
  for (const points of lines) scope.path(points);
  c.stroke();
  c.setLineDash([]);
}

// Gates: those of the others faint, that of the selected track plain.
export function drawGates(scope, ids, selected, curve) {
  const others = [];
  ids.forEach((id, i) => {
    if (id !== selected) others.push(curve(i));
  });
  outlines(scope, others, withAlpha(colours().ink, 0.45), { dash: [4, 4], width: 1 });
  const chosen = ids.indexOf(selected);
  if (chosen >= 0) outline(scope, curve(chosen), colours().select, { dash: [4, 4], width: 1.4 });
}

export function diamond(scope, [px, py], colour, confirmed, selected) {
  const c = scope.context;
  const r = 5.5;
  c.beginPath();
  c.moveTo(px, py - r); c.lineTo(px + r, py); c.lineTo(px, py + r); c.lineTo(px - r, py);
  c.closePath();
  c.lineWidth = 1.6;
  c.strokeStyle = colour;
  c.fillStyle = confirmed ? colour : colours().panel;
  c.fill();
  c.stroke();
  if (!selected) return;
  c.strokeStyle = colours().select;
  c.lineWidth = 2.2;
  c.beginPath();
  c.arc(px, py, 11, 0, 2 * Math.PI);
  c.stroke();
}

export function label(scope, [px, py], text, selected) {
  const c = scope.context;
  c.font = `${selected ? "600 " : ""}11px system-ui, "DejaVu Sans", sans-serif`;
  c.textAlign = "left";
  c.textBaseline = "middle";
  c.lineWidth = 3;
  c.strokeStyle = withAlpha(colours().panel, 0.85);
  c.strokeText(text, px + 10, py - 10);
  c.fillStyle = selected ? colours().select : colours().ink;
  c.fillText(text, px + 10, py - 10);
}

// What is said of track i: number, and class where one is certain.
export function nameOf(tracks, i) {
  const index = classOf(tracks.class_probability[i] ?? []);
  return index < 0 ? `${tracks.id[i]}` : `${tracks.id[i]} ${tracks.class_names[index]}`;
}

// All tracks, the selected one last so that it lies on top: place(i) gives [x, y].
export function drawTracks(scope, tracks, selected, place, withLabels) {
  const order = tracks.id.map((_, i) => i).sort((a, b) => (tracks.id[a] === selected) - (tracks.id[b] === selected));
  for (const i of order) {
    const at = scope.px(...place(i));
    const chosen = tracks.id[i] === selected;
    const colour = trackColour(tracks.class_probability[i]);
    diamond(scope, at, colour, tracks.confirmed[i] === 1, chosen);
    scope.marks.push([...at, tracks.id[i]]);
    if (withLabels && (tracks.id.length <= 60 || chosen)) label(scope, at, nameOf(tracks, i), chosen);
  }
}
