// Radar cross section of the selected track over time, in front of the fuzzy sets of the classes.

import { classColour, colours, withAlpha } from "./colours.js";

const LIBRARY = "/library/plotly.min.js"; // 5 MB: only when the first track is selected
const SHORTEST_PERIOD_MS = 400;
const STRONGEST = 0.5;
const PAD = 0.03;
const SHARE = 0.84; // of the width, beside the fuzzy sets

let loading = null;

function library() {
  loading ??= new Promise((done, failed) => {
    const script = document.createElement("script");
    script.src = LIBRARY;
    script.onload = done;
    script.onerror = failed;
    document.head.append(script);
  });
  return loading;
}

export class RcsChart {
  constructor(element) {
    this.element = element;
    this.sets = null;
  }

  setFuzzySets(sets) { this.sets = sets; }

  // Draws at most a few times a second, the newest last.
  show(track) {
    this.track = track;
    if (this.waiting) return;
    this.waiting = true;
    const wait = Math.max(0, (this.drawn ?? 0) + SHORTEST_PERIOD_MS - performance.now());
    setTimeout(async () => {
      if (this.track) await library();
      this.waiting = false;
      this.draw(this.track);
      this.drawn = performance.now();
    }, wait);
  }

  draw(track) {
    if (!track) {
      if (window.Plotly) Plotly.purge(this.element);
      this.element.replaceChildren();
      return;
    }
    const c = colours();
    const traces = this.sets ? this.curves() : [];
    const seen = track.rcs_dbsm.map((value, i) => [track.seconds[i], value, track.scan[i]]).filter((row) => row[1] !== null);
    traces.push({
      x: seen.map((row) => row[0]), y: seen.map((row) => row[1]), customdata: seen.map((row) => row[2]),
      mode: "lines+markers", name: "RCS",
      line: { color: withAlpha(c.ink, 0.35), width: 1 }, marker: { color: c.ink, size: 4.5 },
      hovertemplate: "scan %{customdata}: %{y:.1f} dBsm<extra></extra>",
    });
    const text = seen.length ? "" : "no radar cross section has been measured";
    const axis = { gridcolor: c.grid, zeroline: false, linecolor: c.line };
    const level = this.sets?.level_dbsm;
    const [first, last] = [track.seconds[0], track.seconds[track.seconds.length - 1]];
    const pad = PAD * Math.max(last - first, 1);
    Plotly.react(this.element, traces, {
      margin: { l: 42, r: 6, t: 4, b: 30 }, paper_bgcolor: c.panel, plot_bgcolor: c.panel,
      font: { color: c.ink, size: 10, family: "system-ui, DejaVu Sans, sans-serif" },
      xaxis: { ...axis, domain: [0, this.sets ? SHARE : 1], title: { text: "s", standoff: 2 }, range: [first - pad, Math.max(last, first + 1) + pad] },
      xaxis2: { domain: [0.86, 1], showgrid: false, zeroline: false, showticklabels: false, range: [0, 1.05], fixedrange: true },
      yaxis: { ...axis, title: { text: "RCS dBsm", standoff: 2 }, range: level ? [level[0], level[level.length - 1]] : undefined },
      showlegend: false, uirevision: track.id,
      images: this.sets ? [this.shade()] : [],
      annotations: text ? [{ text, showarrow: false, xref: "paper", yref: "paper", x: 0.42, y: 0.5 }] : [],
    }, { displayModeBar: false, responsive: true });
  }

  // How the mass of each radar cross section is shared, as a picture that is stretched over time.
  shade() {
    const { level_dbsm: level, grade } = this.sets;
    const canvas = document.createElement("canvas");
    canvas.width = 1;
    canvas.height = level.length;
    const c = canvas.getContext("2d");
    level.forEach((_, row) => {
      for (const [k, grades] of grade.entries()) {
        c.fillStyle = withAlpha(classColour(k), STRONGEST * grades[row]);
        c.fillRect(0, level.length - 1 - row, 1, 1);
      }
    });
    return {
      source: canvas.toDataURL(), layer: "below", sizing: "stretch", xref: "paper", x: 0, sizex: SHARE,
      yref: "y", y: level[level.length - 1], sizey: level[level.length - 1] - level[0],
    };
  }

  // The fuzzy sets themselves, at the right.
  curves() {
    const { class_names: names, level_dbsm: level, grade } = this.sets;
    return names.map((name, k) => {
      const colour = classColour(k);
      return {
        x: grade[k], y: level, xaxis: "x2", mode: "lines", name, fill: "tozerox",
        line: { color: colour, width: 1.6, dash: ["dot", "solid", "dash", "dashdot"][k] },
        fillcolor: withAlpha(colour, 0.18), hovertemplate: `${name} %{x:.2f} at %{y:.1f} dBsm<extra></extra>`,
      };
    });
  }
}
