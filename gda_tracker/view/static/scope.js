// A canvas with axes of its own: what is seen, dragging, zooming, picking.

const MARGIN = 0.06;
const PICK_PX = 18;

export class Scope {
  // draw(scope): called when something has changed; pick(id or null): somebody has clicked.
  // equal: both axes have the same scale.
  constructor(canvas, { draw, pick, equal }) {
    this.canvas = canvas;
    this.equal = equal;
    this.drawing = draw;
    this.pick = pick;
    this.bounds = null; // [x0, y0, x1, y1] of everything seen so far
    this.centre = null; // null: everything
    this.marks = []; // [x px, y px, id] that can be picked
    this.context = canvas.getContext("2d");
    new ResizeObserver(() => this.redraw()).observe(canvas);
    this.listen();
  }

  see(x, y) {
    if (!Number.isFinite(x) || !Number.isFinite(y)) return;
    const b = (this.bounds ??= [x, y, x, y]);
    b[0] = Math.min(b[0], x); b[1] = Math.min(b[1], y);
    b[2] = Math.max(b[2], x); b[3] = Math.max(b[3], y);
  }

  forget() { this.bounds = null; this.centre = null; }

  fit() { this.centre = null; this.redraw(); }

  redraw() {
    const ratio = devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    if (this.canvas.width !== Math.round(width * ratio) || this.canvas.height !== Math.round(height * ratio)) {
      this.canvas.width = Math.round(width * ratio);
      this.canvas.height = Math.round(height * ratio);
    }
    this.width = width;
    this.height = height;
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.context.clearRect(0, 0, width, height);
    this.marks = [];
    if (!this.centre) this.fitScales();
    this.drawing(this);
  }

  fitScales() {
    const [x0, y0, x1, y1] = this.bounds ?? [-1, -1, 1, 1];
    const spanX = Math.max(x1 - x0, 1e-6) * (1 + 2 * MARGIN);
    const spanY = Math.max(y1 - y0, 1e-6) * (1 + 2 * MARGIN);
    this.sx = this.width / spanX;
    this.sy = this.height / spanY;
    if (this.equal) this.sx = this.sy = Math.min(this.sx, this.sy);
    this.middle = [(x0 + x1) / 2, (y0 + y1) / 2];
  }

  get view() { return this.centre ?? this.middle; }

  px(x, y) {
    return [this.width / 2 + (x - this.view[0]) * this.sx, this.height / 2 - (y - this.view[1]) * this.sy];
  }

  at(px, py) {
    return [this.view[0] + (px - this.width / 2) / this.sx, this.view[1] - (py - this.height / 2) / this.sy];
  }

  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const before = this.at(px, py);
    this.centre = [...this.view];
    this.sx *= factor;
    this.sy *= factor;
    const after = this.at(px, py);
    this.centre[0] += before[0] - after[0];
    this.centre[1] += before[1] - after[1];
    this.redraw();
  }

  listen() {
    const { canvas } = this;
    let from = null;
    let moved = false;
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY * 0.0015), event.offsetX, event.offsetY);
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      from = [event.offsetX, event.offsetY];
      moved = false;
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!from) return;
      const [dx, dy] = [event.offsetX - from[0], event.offsetY - from[1]];
      if (!moved && Math.hypot(dx, dy) < 4) return;
      moved = true;
      this.centre = [this.view[0] - dx / this.sx, this.view[1] + dy / this.sy];
      from = [event.offsetX, event.offsetY];
      this.redraw();
    });
    canvas.addEventListener("pointerup", (event) => {
      if (from && !moved) this.pick(this.nearest(event.offsetX, event.offsetY));
      from = null;
    });
    canvas.addEventListener("keydown", (event) => {
      const factor = { "+": 1.25, "=": 1.25, "-": 0.8 }[event.key];
      if (factor) this.zoom(factor);
    });
  }

  nearest(px, py) {
    let best = null;
    let distance = PICK_PX;
    for (const [x, y, id] of this.marks) {
      const d = Math.hypot(x - px, y - py);
      if (d < distance) { best = id; distance = d; }
    }
    return best;
  }

  inside(px, py) { return px > -9 && py > -9 && px < this.width + 9 && py < this.height + 9; }

  // Add a line to the path, unless all of it is out of view.
  path(points) {
    const c = this.context;
    const at = points.map(([x, y]) => this.px(x, y));
    if (at.length < 3 || at.some(([px, py]) => this.inside(px, py))) {
      at.forEach(([px, py], i) => (i ? c.lineTo(px, py) : c.moveTo(px, py)));
    }
  }
}
