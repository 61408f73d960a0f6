// Play, pause, step, back, the slider and the speed.

import { post } from "./connection.js";

const byId = (id) => document.getElementById(id);

export class Controls {
  constructor(state, ask, say) {
    this.state = state;
    this.ask = ask;
    this.say = say;
    byId("play").addEventListener("click", () => this.toggle());
    byId("step").addEventListener("click", () => this.step());
    byId("back").addEventListener("click", () => this.back());
    byId("restart").addEventListener("click", () => this.restart());
    byId("slider").addEventListener("input", (event) => this.look(+event.target.value));
    byId("rate").addEventListener("change", (event) => this.command("rate", +event.target.value));
  }

  get steers() { return this.state.status?.mode === "replay" && this.state.status.allow_changes; }

  // Whether this page stands still: it looks at a scan of its own, or what is played stands.
  get paused() {
    const { status, want } = this.state;
    return want !== null || (status?.mode === "replay" && !status.playing);
  }

  async command(command, value) {
    if (!this.steers) return;
    const answer = await post("/api/control", { command, value });
    if (answer.error) this.say(answer.error);
  }

  async toggle() {
    const { state } = this;
    if (this.paused) {
      state.want = null;
      this.ask();
      await this.command("play");
    } else {
      state.want = state.scan?.number ?? null;
      this.ask();
      await this.command("pause");
    }
    this.show();
  }

  async step() {
    const { state } = this;
    const at = state.want ?? state.scan?.number ?? 0;
    if (at < state.status.newest) this.look(at + 1);
    else {
      // At the newest: the next one has to be made, or to come.
      state.want = null;
      this.ask();
      await this.command("step");
    }
  }

  async back() {
    const at = this.state.want ?? this.state.scan?.number ?? 1;
    this.look(at - 1);
    if (this.state.status.playing) await this.command("pause");
  }

  look(number) {
    const { first, newest } = this.state.status;
    this.state.want = Math.max(first, Math.min(newest, number));
    this.ask();
    this.show();
  }

  showRate(rate) {
    const select = byId("rate");
    if (![...select.options].some((option) => +option.value === rate)) select.add(new Option(`×${rate}`, rate));
    select.value = String(rate);
  }

  async restart() {
    this.state.want = null;
    await this.command("restart");
  }

  show() {
    const { status, scan, want } = this.state;
    if (!status) return;
    const slider = byId("slider");
    slider.min = Math.max(status.first, 1);
    slider.max = Math.max(status.newest, 1);
    slider.value = want ?? status.newest;
    byId("play").textContent = this.paused ? "Play" : "Pause";
    byId("play").disabled = status.mode === "replay" && !this.steers && want === null && !status.playing;
    byId("step").disabled = !this.steers && (want === null || want >= status.newest);
    byId("step").disabled ||= Boolean(status.finished) && (want ?? status.newest) >= status.newest;
    byId("back").disabled = !scan || (want ?? scan.number) <= status.first;
    byId("restart").hidden = byId("rate-label").hidden = status.mode !== "replay";
    byId("restart").disabled = byId("rate").disabled = !this.steers;
    if (status.rate !== undefined && document.activeElement !== byId("rate")) this.showRate(status.rate);
    const total = status.total ? ` of ${status.total}` : "";
    byId("where").textContent = scan ? `scan ${scan.number}${total}, ${scan.seconds.toFixed(1)} s` : "no scan yet";
    byId("mode").textContent = status.mode === "replay"
      ? (status.finished ? "replay, finished" : status.playing ? "replay" : "replay, paused") : "live";
    byId("source").textContent = status.source;
  }
}
