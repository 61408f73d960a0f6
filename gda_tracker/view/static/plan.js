// The plan position display: the tracking plane from above, x to the right, y up.

import { colours, trackColour, withAlpha } from "./colours.js";
import { CHI_SQUARE_95, ellipse, gateOf, length, polarToPlan, roundStep } from "./geometry.js";
import { drawFormations } from "./formations.js";
import { dots, drawGates, drawTracks, faded, outline, outlines, rings } from "./signs.js";
import { Scope } from "./scope.js";

const SPOKES = 12;
const AHEAD = 5; // of the velocity line, in scans' time or seconds, whichever is longer

export class Plan {
  constructor(canvas, state) {
    this.state = state;
    this.scope = new Scope(canvas, { draw: () => this.draw(), pick: state.select, equal: true });
  }

  // The scans before it that are new here come along: what has been seen stays in view.
  show(before) {
    const { scan } = this.state;
    for (const old of before) old.x.forEach((x, i) => this.scope.see(x, old.y[i]));
    for (const old of before) old.tx.forEach((x, i) => this.scope.see(x, old.ty[i]));
    scan.detections.x.forEach((x, i) => this.scope.see(x, scan.detections.y[i]));
    scan.tracks.x.forEach((x, i) => this.scope.see(x, scan.tracks.y[i]));
    this.scope.see(scan.sensor.x, scan.sensor.y);
    this.scope.redraw();
  }

  draw() {
    const { scan, past, persistence, selected, layers } = this.state;
    if (!scan) return;
    const { scope } = this;
    const { tracks, gates, detections, sensor } = scan;
    this.grid(sensor);
    for (const [age, old] of past.before(scan.number, persistence)) {
      dots(scope, old.x.map((x, i) => [x, old.y[i]]), faded(age, persistence), 1.7);
    }
    const trails = past.trails(scan.number, persistence);
    tracks.id.forEach((id, i) => {
      const trail = trails.get(id);
      if (!trail) return;
      const colour = withAlpha(trackColour(tracks.class_probability[i]), id === selected ? 1 : 0.55);
      outline(scope, [...trail, [tracks.x[i], tracks.y[i]]], colour, { width: id === selected ? 2.2 : 1.3 });
    });
    if (layers.gates && gates) {
      drawGates(scope, gates.id, selected, (i) => gateOf(gates, i).map(([r, a]) => polarToPlan(sensor, r, a)));
    }
    // By segments, for a path of which no corner is in view is not drawn.
    const segments = detections.curves.flatMap((curve) => curve.slice(1).map((point, i) => [curve[i], point]));
    outlines(scope, segments, withAlpha(colours().detection, 0.7), { width: 1 });
    dots(scope, detections.x.map((x, i) => [x, detections.y[i]]), colours().detection, 2.6);
    const taken = new Set(tracks.detection);
    rings(scope, detections.row.flatMap((row, i) => (taken.has(row) ? [[detections.x[i], detections.y[i]]] : [])));
    tracks.id.forEach((id, i) => {
      const colour = id === selected ? colours().select : trackColour(tracks.class_probability[i]);
      if (layers.covariances) {
        const points = ellipse(tracks.x[i], tracks.y[i], tracks.xx[i], tracks.xy[i], tracks.yy[i], CHI_SQUARE_95);
        outline(scope, points, colour, { width: 1.4 });
      }
      if (tracks.extent.length) {
        outline(scope, ellipse(tracks.x[i], tracks.y[i], ...tracks.extent[i], 1), colour, { width: 2.2 });
      }
      const ahead = [tracks.x[i] + AHEAD * tracks.vx[i], tracks.y[i] + AHEAD * tracks.vy[i]];
      outline(scope, [[tracks.x[i], tracks.y[i]], ahead], colour, { width: 1.6 });
    });
    if (layers.formations && scan.formations) drawFormations(scope, scan.formations);
    drawTracks(scope, tracks, selected, (i) => [tracks.x[i], tracks.y[i]], layers.labels);
    scope.canvas.ariaLabel = `Plan position: ${tracks.id.length} tracks, ${detections.x.length} detections`;
  }

  // Range rings and spokes of azimuth around the sensor.
  grid(sensor) {
    const { scope } = this;
    const c = scope.context;
    const [cx, cy] = scope.px(sensor.x, sensor.y);
    const corners = [[0, 0], [scope.width, 0], [0, scope.height], [scope.width, scope.height]];
    const farthest = Math.max(...corners.map(([x, y]) => Math.hypot(x - cx, y - cy))) / scope.sx;
    const step = roundStep(Math.min(scope.width, scope.height) / scope.sx, 4);
    c.strokeStyle = colours().grid;
    c.fillStyle = colours().faint;
    c.lineWidth = 1;
    c.font = "10px system-ui, 'DejaVu Sans', sans-serif";
    c.textAlign = "center";
    c.textBaseline = "middle";
    for (let ring = step; ring <= farthest && ring / step < 200; ring += step) {
      c.beginPath();
      c.arc(cx, cy, ring * scope.sx, 0, 2 * Math.PI);
      c.stroke();
      for (const [x, y] of [[cx, cy - ring * scope.sx], [cx + ring * scope.sx, cy]]) {
        if (x > 15 && x < scope.width - 15 && y > 8 && y < scope.height - 8) c.fillText(length(ring), x, y - 7);
      }
    }
    for (let i = 0; i < SPOKES; i++) {
      const [x, y] = polarToPlan(sensor, farthest, sensor.yaw + (2 * Math.PI * i) / SPOKES);
      outline(scope, [[sensor.x, sensor.y], [x, y]], colours().grid, { width: i ? 0.6 : 1.6 });
    }
    c.fillStyle = colours().ink;
    c.beginPath();
    c.moveTo(cx, cy - 6); c.lineTo(cx + 5, cy + 4); c.lineTo(cx - 5, cy + 4);
    c.fill();
  }
}
