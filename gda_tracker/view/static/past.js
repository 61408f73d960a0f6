// Where detections and tracks were on the scans before the one that is shown.

const KEPT = 400;

export class Past {
  constructor() { this.scans = new Map(); }

  clear() { this.scans.clear(); }

  add(scans) {
    for (const scan of scans) this.scans.set(scan.number, scan);
    if (this.scans.size > KEPT) {
      const numbers = [...this.scans.keys()].sort((a, b) => a - b);
      for (const number of numbers.slice(0, this.scans.size - KEPT)) this.scans.delete(number);
    }
  }

  // A scan that was shown becomes one of the past.
  addShown(scan) {
    const { number, detections, tracks } = scan;
    this.add([{
      number, x: detections.x, y: detections.y, range: detections.range,
      azimuth: detections.azimuth, id: tracks.id, tx: tracks.x, ty: tracks.y,
    }]);
  }

  // The newest scan up to which everything is here, for a look at `number`; null: nothing is.
  knownBefore(number, count) {
    let known = null;
    for (let n = number - count; n < number; n++) {
      if (n < 1) continue;
      if (!this.scans.has(n)) return known;
      known = n;
    }
    return known;
  }

  // [age, scan] of the last `count` before a scan, the oldest first.
  before(number, count) {
    const found = [];
    for (let age = count; age >= 1; age--) {
      const scan = this.scans.get(number - age);
      if (scan) found.push([age, scan]);
    }
    return found;
  }

  // Where each track has been: id -> [[x, y], ...], the oldest first.
  trails(number, count) {
    const trails = new Map();
    for (const [, scan] of this.before(number, count)) {
      scan.id.forEach((id, i) => {
        if (!trails.has(id)) trails.set(id, []);
        trails.get(id).push([scan.tx[i], scan.ty[i]]);
      });
    }
    return trails;
  }
}
