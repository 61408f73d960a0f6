// The B-scope: range upwards, azimuth from the boresight sideways; left of the boresight is left.

import { colours, trackColour, withAlpha } from "./colours.js";
import { gateOf, length, planToPolar, roundStep, wrap } from "./geometry.js";
import { dots, drawGates, drawTracks, faded, outline, rings } from "./signs.js";
import { Scope } from "./scope.js";

const DEGREES = 180 / Math.PI;

export class BScope {
  constructor(canvas, state) {
    this.state = state;
    this.scope = new Scope(canvas, { draw: () => this.draw(), pick: state.select, equal: false });
  }

  // Counter-clockwise is to the left.
  place(range, azimuth) {
    return [-wrap(azimuth - this.state.scan.sensor.yaw) * DEGREES, range];
  }

  track(i) {
    const { scan } = this.state;
    const [range, azimuth] = planToPolar(scan.sensor, scan.tracks.x[i], scan.tracks.y[i]);
    return [-azimuth * DEGREES, range];
  }

  show(before) {
    const { scan } = this.state;
    for (const old of before) old.range.forEach((r, i) => this.scope.see(...this.place(r, old.azimuth[i])));
    scan.detections.range.forEach((r, i) => this.scope.see(...this.place(r, scan.detections.azimuth[i])));
    scan.tracks.id.forEach((_, i) => this.scope.see(...this.track(i)));
    if (this.scope.bounds) this.scope.see(this.scope.bounds[0], 0); // range from zero
    this.scope.redraw();
  }

  draw() {
    const { scan, past, persistence, selected, layers } = this.state;
    if (!scan) return;
    const { scope } = this;
    const { tracks, gates, detections } = scan;
    this.grid();
    for (const [age, old] of past.before(scan.number, persistence)) {
      dots(scope, old.range.map((r, i) => this.place(r, old.azimuth[i])), faded(age, persistence), 1.7);
    }
    const trails = past.trails(scan.number, persistence);
    tracks.id.forEach((id, i) => {
      const points = [...(trails.get(id) ?? []), [tracks.x[i], tracks.y[i]]].map(([x, y]) => {
        const [range, azimuth] = planToPolar(scan.sensor, x, y);
        return [-azimuth * DEGREES, range];
      });
      // Behind the sensor a trail jumps from one side to the other.
      let from = 0;
      const colour = withAlpha(trackColour(tracks.class_probability[i]), id === selected ? 1 : 0.55);
      for (let k = 1; k <= points.length; k++) {
        if (k < points.length && Math.abs(points[k][0] - points[k - 1][0]) < 180) continue;
        outline(scope, points.slice(from, k), colour, { width: id === selected ? 2.2 : 1.3 });
        from = k;
      }
    });
    if (layers.gates && gates) {
      drawGates(scope, gates.id, selected, (i) => {
        const [centre] = this.place(gates.range[i], gates.azimuth[i]);
        return gateOf(gates, i).map(([r, a]) => [centre - (a - gates.azimuth[i]) * DEGREES, r]);
      });
    }
    const seen = detections.range.map((r, i) => this.place(r, detections.azimuth[i]));
    dots(scope, seen, colours().detection, 2.6);
    const taken = new Set(tracks.detection);
    rings(scope, seen.filter((_, i) => taken.has(detections.row[i])));
    drawTracks(scope, tracks, selected, (i) => this.track(i), layers.labels);
    scope.canvas.ariaLabel = `B-scope: ${tracks.id.length} tracks, ${detections.range.length} detections`;
  }

  grid() {
    const { scope } = this;
    const c = scope.context;
    const [left, bottom] = scope.at(0, scope.height);
    const [right, top] = scope.at(scope.width, 0);
    c.fillStyle = colours().faint;
    c.font = "10px system-ui, 'DejaVu Sans', sans-serif";
    const steps = [1, 2, 5, 10, 15, 30, 45, 60, 90];
    const angle = steps.find((s) => s >= (right - left) / 7) ?? roundStep(right - left, 4);
    const fine = right - left < 5 ? roundStep(right - left, 5) : angle;
    c.textAlign = "center";
    c.textBaseline = "bottom";
    for (let x = Math.ceil(left / fine) * fine; x <= right; x += fine) {
      outline(scope, [[x, bottom], [x, top]], colours().grid, { width: Math.abs(x) < 1e-9 ? 1.6 : 1 });
      const [px] = scope.px(x, 0);
      if (px > 16 && px < scope.width - 16) c.fillText(`${+(-x).toFixed(2)}°`, px, scope.height - 2);
    }
    const step = roundStep(top - bottom, 6);
    c.textAlign = "left";
    for (let y = Math.max(Math.ceil(bottom / step), 0) * step; y <= top; y += step) {
      outline(scope, [[left, y], [right, y]], colours().grid, { width: 1 });
      const [, py] = scope.px(0, y);
      if (py > 14 && py < scope.height - 14) c.fillText(length(y), 3, py - 1);
    }
  }
}
