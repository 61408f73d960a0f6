// Ellipses, angles and round numbers.

const CORNERS = 32;
export const CHI_SQUARE_95 = 5.991; // of two dimensions

// Points of {v : v' [[a, b], [b, c]]^-1 v = k} around a centre.
export function ellipse(x, y, a, b, c, k) {
  const l11 = Math.sqrt(Math.max(a, 0));
  if (!(l11 > 0)) return [];
  const l21 = b / l11;
  const l22 = Math.sqrt(Math.max(c - l21 * l21, 0));
  const r = Math.sqrt(k);
  const points = [];
  for (let i = 0; i <= CORNERS; i++) {
    const t = (2 * Math.PI * i) / CORNERS;
    const u = Math.cos(t) * r;
    const v = Math.sin(t) * r;
    points.push([x + l11 * u, y + l21 * u + l22 * v]);
  }
  return points;
}

export const gateOf = (gates, i) =>
  ellipse(gates.range[i], gates.azimuth[i], gates.rr[i], gates.ra[i], gates.aa[i], gates.threshold);

export const wrap = (angle) => angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));

export const polarToPlan = (sensor, range, azimuth) =>
  [sensor.x + range * Math.cos(azimuth), sensor.y + range * Math.sin(azimuth)];

// Range, and azimuth from the boresight, counter-clockwise.
export function planToPolar(sensor, x, y) {
  const dx = x - sensor.x;
  const dy = y - sensor.y;
  return [Math.hypot(dx, dy), wrap(Math.atan2(dy, dx) - sensor.yaw)];
}

// 1, 2 or 5 times a power of ten, so that about `count` of them cover `span`.
export function roundStep(span, count) {
  const raw = Math.max(span, 1e-9) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  return power * [1, 2, 5, 10].find((f) => f * power >= raw * 0.999);
}

export function length(metres) {
  const round = (value) => +value.toPrecision(6);
  return Math.abs(metres) >= 1000 ? `${round(metres / 1000)} km` : `${round(metres)} m`;
}
