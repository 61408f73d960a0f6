// What is believed of the selected track: bars of its classes, and of its belief masses.

import { classColour, colours } from "./colours.js";

const MOST_MASSES = 6;

function bar(name, value, colour, kind = "") {
  const row = document.createElement("div");
  row.className = `bar ${kind}`;
  const text = document.createElement("span");
  text.textContent = name;
  const frame = document.createElement("i");
  const fill = document.createElement("b");
  fill.style.width = `${100 * value}%`;
  fill.style.background = colour;
  frame.append(fill);
  const number = document.createElement("span");
  number.textContent = value.toFixed(3);
  row.append(text, frame, number);
  return row;
}

export function showBeliefs(title, bars, scan, selected) {
  const { tracks } = scan;
  const i = tracks.id.indexOf(selected);
  if (i < 0) {
    title.textContent = selected === null ? "No track selected" : `Track ${selected} is not in this scan`;
    bars.replaceChildren();
    return;
  }
  const state = tracks.confirmed[i] ? "confirmed" : "tentative";
  const conflict = tracks.conflict[i] ? `, conflict ${tracks.conflict[i].toFixed(2)}` : "";
  title.textContent = `Track ${selected} (${state}, ${tracks.hits[i]} detections${conflict})`;
  const rows = tracks.class_names.map((name, k) => bar(name, tracks.class_probability[i][k] ?? 0, classColour(k)));
  const masses = (tracks.masses[i] ?? [])
    .map((mass, k) => [mass, tracks.focal[k]])
    .filter(([mass]) => mass >= 0.0005)
    .sort((a, b) => b[0] - a[0])
    .slice(0, MOST_MASSES);
  const term = scan.settings?.attribute_term;
  if (masses.length && term !== "bayes" && term !== "none") {
    rows.push(...masses.map(([mass, name]) => bar(`m(${name})`, mass, colours().faint, "mass")));
  }
  if (!rows.length) rows.push(document.createTextNode("no class has been told apart yet"));
  bars.replaceChildren(...rows);
}
