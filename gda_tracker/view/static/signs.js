// The signs of both displays: detections, gates, covariances, tracks, labels.

import { classOf, colours, trackColour, withAlpha } from "./colours.js";

const DOT = 2.1;

export function dots(scope, points, colour, radius = DOT) {
  const c = scope.context;
  c.fillStyle = colour;
  c.beginPath();
  for (const [x, y] of points) {
    const [px, py] = scope.px(x, y);
    c.moveTo(px + radius, py);
    c.arc(px, py, radius, 0, 2 * Math.PI);
  }
  c.fill();
}

// Older ones fainter.
export const faded = (age, count) => withAlpha(colours().detection, 0.06 + 0.5 * (1 - age / (count + 1)) ** 1.6);

export function rings(scope, points) {
  const c = scope.context;
  c.strokeStyle = colours().detection;
  c.lineWidth = 1;
  for (const [x, y] of points) {
    c.beginPath();
    c.arc(...scope.px(x, y), 4.5, 0, 2 * Math.PI);
    c.stroke();
  }
}

export function outline(scope, points, colour, { dash = [], width = 1.2 } = {}) {
  if (!points.length) return;
  const c = scope.context;
  c.setLineDash(dash);
  c.strokeStyle = colour;
  c.lineWidth = width;
  scope.path(points);
  c.stroke();
  c.setLineDash([]);
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
