// Puts the page together: one state, one connection, and who shows what of it.

import { showBeliefs } from "./beliefs.js";
import { BScope } from "./bscope.js";
import { switchTheme } from "./colours.js";
import { Connection, get } from "./connection.js";
import { Controls } from "./controls.js";
import { listenToKeys } from "./keys.js";
import { showMatrix } from "./matrix.js";
import { ParameterPanel } from "./parameters.js";
import { Past } from "./past.js";
import { Plan } from "./plan.js";
import { RcsChart } from "./rcs.js";
import { TrackList } from "./tracks.js";

const TABLES_MS = 250;
const RETRY_MS = 3000;
const byId = (id) => document.getElementById(id);

const state = {
  status: null, scan: null, matrix: null, track: null,
  want: null, // number of the scan that is looked at, null: the newest
  selected: null, past: new Past(), persistence: 25,
  layers: { gates: true, covariances: true, labels: true, formations: true },
  select: (id) => select(id),
};

const parameters = new ParameterPanel();
const plan = new Plan(byId("plan"), state);
const bscope = new BScope(byId("bscope"), state);
const list = new TrackList(byId("tracks").tBodies[0], byId("track-count"), (id) => select(id));
const chart = new RcsChart(byId("rcs"));
const connection = new Connection(request, draw, linked);
const controls = new Controls(state, () => connection.ask(true), say);
let generation = null;
let noticed = 0;

function request() {
  const at = state.want ?? (state.status ? state.status.newest + 1 : 1);
  return {
    want: state.want, track: state.selected, past: state.persistence,
    have: state.past.knownBefore(at, state.persistence),
  };
}

function draw(answer) {
  state.status = answer.status;
  if (generation !== answer.status.generation) {
    if (generation !== null) { state.past.clear(); plan.scope.forget(); bscope.scope.forget(); }
    generation = answer.status.generation;
    state.want = null;
  }
  if (answer.scan) {
    state.past.add(answer.past);
    state.past.addShown(answer.scan);
    Object.assign(state, { scan: answer.scan, matrix: answer.matrix, track: answer.track ?? null });
    plan.show(answer.past);
    bscope.show(answer.past);
    showTables();
  }
  const notices = answer.status.notices;
  const newest = notices[notices.length - 1];
  if (newest && newest[0] !== noticed) {
    noticed = newest[0];
    say(`after scan ${newest[1]}: ${newest[2]}`);
    parameters.load();
  }
  if (answer.status.error) say(answer.status.error);
  askForMissing();
  controls.show();
  document.body.dataset.scan = state.scan?.number ?? 0; // for who watches from outside
}

// At most a few times a second while scans run through, the newest last; at once for who looks at one.
let shownAt = 0;
let later = null;
function showTables() {
  clearTimeout(later);
  const wait = state.status.playing && state.want === null ? shownAt + TABLES_MS - performance.now() : 0;
  if (wait > 0) {
    later = setTimeout(showTables, wait);
    return;
  }
  shownAt = performance.now();
  list.show(state.scan, state.selected);
  byId("show-formations").parentElement.hidden = !state.scan.formations;
  showSelected();
}

function showSelected() {
  showBeliefs(byId("belief-title"), byId("bars"), state.scan, state.selected);
  chart.show(state.track);
  showMatrix(byId("matrix"), byId("matrix-hint"), state.matrix, byId("matrix-kind").value, state.selected, select);
}

function redraw() {
  plan.scope.redraw();
  bscope.scope.redraw();
  if (state.scan) { list.show(state.scan, state.selected); showSelected(); }
}

function select(id) {
  state.selected = id;
  state.track = null;
  if (state.scan) list.show(state.scan, id);
  // The answer brings what is known of the track at the scan that is shown.
  connection.ask(true);
}

function say(text) { byId("notice").textContent = text; }

function linked(word) {
  byId("link").textContent = word;
  byId("link").classList.toggle("bad", word !== "connected");
  if (word !== "connected") return;
  // It may be another server than before, with other parameters.
  parameters.list = [];
  chart.setFuzzySets(null);
  askedAt = -Infinity;
  askForMissing();
}

// Parameters and fuzzy sets come from nodes that may start later than this page.
let askedAt = -Infinity;
function askForMissing() {
  if ((parameters.list.length && chart.sets) || performance.now() - askedAt < RETRY_MS) return;
  askedAt = performance.now();
  parameters.load();
  get("/api/fuzzy_sets").then((sets) => {
    if (!sets) return;
    chart.setFuzzySets(sets);
    redraw();
  }, (error) => say(error.message));
}

function layer(name) {
  const box = byId(`show-${name}`);
  const apply = () => { state.layers[name] = box.checked; redraw(); };
  box.addEventListener("change", apply);
  return () => { box.checked = !box.checked; apply(); };
}

const theme = () => { switchTheme(); redraw(); };
byId("theme").addEventListener("click", theme);
byId("help").addEventListener("click", () => byId("help-text").showModal());
byId("fit").addEventListener("click", () => { plan.scope.fit(); bscope.scope.fit(); });
byId("matrix-kind").addEventListener("change", redraw);
byId("persistence").addEventListener("input", () => {
  state.persistence = +byId("persistence").value;
  byId("persistence-value").textContent = `${state.persistence} scans`;
  connection.ask(true);
});
byId("persistence-value").textContent = `${state.persistence} scans`;

listenToKeys({
  " ": () => controls.toggle(), ArrowLeft: () => controls.back(), ArrowRight: () => controls.step(),
  Home: () => controls.look(1), End: () => controls.look(Infinity), R: () => controls.restart(),
  j: () => select(list.neighbour(state.selected, 1)), k: () => select(list.neighbour(state.selected, -1)),
  Escape: () => select(null), t: theme, "?": () => byId("help-text").showModal(),
  g: layer("gates"), c: layer("covariances"), l: layer("labels"), f: layer("formations"),
  0: () => byId("fit").click(), "+": () => plan.scope.zoom(1.25), "-": () => plan.scope.zoom(0.8),
});
