// The list of tracks.

import { classColour, classOf } from "./colours.js";

const COLUMNS = 6;

export class TrackList {
  constructor(body, count, select) {
    this.body = body;
    this.count = count;
    this.rows = new Map();
    this.select = select;
  }

  show(scan, selected) {
    const { tracks, sensor } = scan;
    const order = tracks.id.map((_, i) => i)
      .sort((a, b) => tracks.confirmed[b] - tracks.confirmed[a] || tracks.id[a] - tracks.id[b]);
    this.order = order.map((i) => tracks.id[i]);
    const confirmed = tracks.confirmed.filter((s) => s === 1).length;
    this.count.textContent = `${confirmed} confirmed, ${tracks.id.length - confirmed} tentative`;
    const living = new Set(tracks.id);
    for (const [id, row] of this.rows) {
      if (!living.has(id)) { row.remove(); this.rows.delete(id); }
    }
    order.forEach((i, place) => {
      const row = this.row(tracks.id[i]);
      if (this.body.children[place] !== row) this.body.insertBefore(row, this.body.children[place] ?? null);
      this.fill(row, tracks, i, sensor, tracks.id[i] === selected);
    });
  }

  row(id) {
    let row = this.rows.get(id);
    if (row) return row;
    row = document.createElement("tr");
    row.dataset.track = id;
    row.tabIndex = 0;
    for (let i = 0; i < COLUMNS; i++) row.append(document.createElement("td"));
    row.cells[2].className = "class";
    for (let i = 3; i < COLUMNS; i++) row.cells[i].className = "n";
    row.addEventListener("click", () => this.select(id));
    row.addEventListener("keydown", (event) => { if (event.key === "Enter") this.select(id); });
    this.rows.set(id, row);
    return row;
  }

  fill(row, tracks, i, sensor, selected) {
    const probability = tracks.class_probability[i] ?? [];
    const index = classOf(probability);
    const range = Math.hypot(tracks.x[i] - sensor.x, tracks.y[i] - sensor.y);
    const texts = [
      tracks.id[i],
      tracks.coasted[i] ? `coasting ${tracks.coasted[i]}` : tracks.confirmed[i] ? "confirmed" : "tentative",
      index < 0 ? "–" : tracks.class_names[index] + (probability[index] < 0.995 ? ` ${Math.round(100 * probability[index])} %` : ""),
      range.toFixed(range < 1000 ? 1 : 0),
      Math.hypot(tracks.vx[i], tracks.vy[i]).toFixed(1),
      tracks.age_s[i]?.toFixed(1) ?? "",
    ];
    texts.forEach((text, k) => {
      if (row.cells[k].textContent !== String(text)) row.cells[k].textContent = text;
    });
    row.cells[1].className = tracks.confirmed[i] ? "" : "tentative";
    row.cells[2].style.setProperty("--class", index < 0 ? "transparent" : classColour(index));
    row.setAttribute("aria-selected", selected);
  }

  // The id that stands `by` rows below the selected one.
  neighbour(selected, by) {
    if (!this.order?.length) return null;
    const at = this.order.indexOf(selected);
    if (at < 0) return this.order[by > 0 ? 0 : this.order.length - 1];
    return this.order[(at + by + this.order.length) % this.order.length];
  }
}
