// The parameters: look, change, read the answer.

import { get, post } from "./connection.js";

const byId = (id) => document.getElementById(id);

export class ParameterPanel {
  constructor() {
    this.list = [];
    this.allowed = false;
    byId("parameter-search").addEventListener("input", () => this.draw());
    byId("advanced").addEventListener("change", () => this.draw());
  }

  async load() {
    try {
      const found = await get("/api/parameters");
      this.list = found.parameters;
      this.allowed = found.allow_changes;
      byId("parameters-hint").textContent = this.allowed ? "act at the next scan" : "read only";
      this.draw();
    } catch (error) {
      this.say(false, error.message);
    }
  }

  draw() {
    const words = byId("parameter-search").value.toLowerCase().split(/\s+/);
    const advanced = byId("advanced").checked;
    const shown = this.list.filter((p) => (advanced || !p.advanced)
      && words.every((word) => `${p.node} ${p.name} ${p.description}`.toLowerCase().includes(word)));
    const rows = [];
    let node = null;
    for (const p of shown) {
      if (p.node !== node) {
        node = p.node;
        const title = document.createElement("div");
        title.className = "node";
        title.textContent = node;
        rows.push(title);
      }
      rows.push(this.row(p));
    }
    byId("parameters").replaceChildren(...rows);
  }

  row(p) {
    const form = document.createElement("form");
    form.className = "parameter";
    const id = `p-${p.node}-${p.name}`;
    const label = document.createElement("label");
    label.textContent = p.name;
    label.htmlFor = id;
    const shown = typeof p.value === "string" ? p.value : JSON.stringify(p.value);
    if (JSON.stringify(p.value) !== JSON.stringify(p.default)) label.className = "changed";
    let field;
    if (p.choices.length) {
      field = document.createElement("select");
      for (const choice of p.choices) field.add(new Option(choice, choice));
    } else {
      field = document.createElement("input");
      field.type = "text";
      field.autocomplete = "off";
    }
    field.id = id;
    field.name = p.name;
    field.value = shown;
    const button = document.createElement("button");
    button.textContent = "Set";
    const fixed = !p.live || !this.allowed;
    field.disabled = button.disabled = fixed;
    if (!p.live) button.title = "fixed at start-up";
    const text = document.createElement("small");
    text.textContent = `${p.description}. Allowed is ${p.allowed}` + (p.live ? "" : "; fixed at start-up");
    text.title = text.textContent;
    form.append(label, field, button, text);
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.change(p, field.value, shown);
    });
    if (p.choices.length) field.addEventListener("change", () => this.change(p, field.value, shown));
    return form;
  }

  async change(p, value, before) {
    const answer = await post("/api/parameters", { node: p.node, values: { [p.name]: value } });
    if (answer.error) this.say(false, answer.error);
    else if (!answer.accepted) this.say(false, `refused: ${answer.reason}`);
    else {
      const from = answer.acts_from_scan === null ? "acts on the next scan that opens" : `acts from scan ${answer.acts_from_scan} on`;
      this.say(true, `accepted: ${p.name} ${before} → ${value}, ${from}`);
    }
    await this.load();
  }

  say(good, text) {
    const answer = byId("answer");
    answer.textContent = text;
    answer.className = good ? "good" : "bad";
  }
}
