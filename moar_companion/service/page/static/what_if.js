// What-if: a site that is changed by hand, and the optimal path at once.
import { h, replaceWhen, setAttribute, setText } from "./dom.js";
import { legendLine, legendMap, MAP_LAYERS, PlaneView, segments } from "./plane.js";
import { get, Newest, post } from "./server.js";
import { fromAddress, siteFileText, toAddress } from "./site_file.js";
import { folded, setRows, table } from "./status.js";
import { WeightTriangle } from "./triangle.js";
import { capital, duration, goalWords, number } from "./words.js";

const NAMES = ["safety", "time", "energy"];
const BASELINES = { shortest: "A*, shortest", voronoi: "Voronoi", envelope: "envelope" };
/** Parts of the answer: the path at once; when nothing has changed for a while, what takes longer. */
const STAGES = [["maps"], ["maps", "baselines"], ["maps", "baselines", "front"]];
const SETTLED_MS = 150;
const round = (value) => Math.round(value * 100) / 100;

/** The middle of a polygon's corners. */
function middle(vertices) {
  return [0, 1].map((axis) => vertices.reduce((sum, vertex) => sum + vertex[axis], 0) / vertices.length);
}

export class WhatIfView {
  constructor(connection, onAddress) {
    this.connection = connection;
    this.onAddress = onAddress;
    this.front = [];
    this.shownPath = null;
    this.asking = new Newest((request) => post("api/what-if", request), (found, request, newest) => this.receive(found, newest), (error) => this.fail(error));
    this.build();
  }

  build() {
    const host = h("div");
    this.plane = new PlaneView(host, "The plane, with start, target, obstacles and landing points to drag");
    this.title = h("h1", { id: "what-if-title" }, "What if");
    this.figures = h("dl", { class: "figures" });
    this.problem = h("p", { class: "last-text", role: "status" });
    this.legend = h("div", { class: "legend" });
    this.mission = h("select", { onchange: () => this.change({ mission: this.mission.value, target: null }) }, ...["inspection", "exit", "evacuation"].map((name) => h("option", { value: name }, capital(name))));
    this.target = h("select", { onchange: () => this.change({ target: this.chosenTarget() }) });
    this.adaptation = h("select", { onchange: () => this.change({ adaptation: this.adaptation.value }) }, h("option", { value: "paper" }, "Eq. 9 of the paper"), h("option", { value: "calibrated" }, "calibrated"));
    this.risks = {};
    const risks = ["wind", "communication", "localization", "battery"].map((name) => {
      this.risks[name] = new Slider(capital(name), 0, 1, 0.01, (value) => this.change({ risk: { ...this.state.risk, [name]: value } }));
      return this.risks[name].element;
    });
    this.distances = {
      d_min_m: new Slider("d_min", 0.1, 5, 0.05, (value) => this.change({ d_min_m: value, d_max_m: Math.max(this.state.d_max_m, round(value + 0.1)) })),
      d_max_m: new Slider("d_max", 0.2, 10, 0.05, (value) => this.change({ d_max_m: value, d_min_m: Math.min(this.state.d_min_m, round(value - 0.1)) })),
      margin_m: new Slider("Flight margin", 0, 4, 0.05, (value) => this.change({ margin_m: value })),
    };
    this.triangle = new WeightTriangle("Triangle of the weights: drag the base weights, or choose a path", {
      changed: (weights) => this.change({ weights }),
      chosen: (index) => this.choosePath(index),
    });
    this.weightWords = h("div");
    this.frontWords = h("p", { role: "status" });
    this.shares = h("div", { class: "stack" });
    this.cost = h("div");
    this.compare = h("div");
    this.changeWords = h("p", { class: "muted" });
    const step = (by) => this.choosePath(this.shownPath === null ? (by > 0 ? 0 : this.front.length - 1) : (this.shownPath + by + this.front.length) % this.front.length);
    const button = (words, act, attributes = {}) => h("button", { type: "button", onclick: act, ...attributes }, words);
    const card = (title, ...content) => h("section", { class: "card" }, h("h2", {}, title), ...content);
    this.copied = h("p", { role: "status", class: "muted" });
    this.reset = button("Reset", () => this.restore());
    this.element = h(
      "div",
      { class: "view" },
      h(
        "div",
        { class: "main" },
        h("section", { class: "lead", "aria-labelledby": "what-if-title" }, this.title, this.figures, this.problem),
        host,
        folded("Map and legend", h("div", { class: "legend" }, segments("Map under the plane", MAP_LAYERS, this.plane.layer, (layer) => {
          this.plane.setLayer(layer);
          this.updateLegend();
        }), h("label", { class: "check" }, h("input", { type: "checkbox", onchange: (event) => {
          this.plane.wide = event.target.checked;
          this.plane.draw();
        } }), "Far landing points"), this.legend)),
        h("div", { class: "results" }, card("Cost of the path", this.shares, this.cost, this.changeWords), card("Beside the paper's baselines", this.compare)),
        h("div", { class: "buttons start" }, button("Copy address", () => this.share()), button("Download site file", () => this.download(), { id: "download" }), this.reset, this.copied),
      ),
      h(
        "div",
        { class: "side", role: "region", "aria-label": "Changes and results", tabindex: "0" },
        card("Problem", h("div", { class: "fields" }, h("label", {}, "Mission", this.mission), h("label", {}, "Goal", this.target), h("label", {}, "Rule of the weights", this.adaptation))),
        card("Risks", ...risks),
        card("Weights, and the best path for each", h("div", { class: "weights large" }, this.triangle.svg, this.weightWords), this.frontWords, h("div", { class: "buttons start" }, button("Path before", () => step(-1)), button("Path after", () => step(1)), button("Own path", () => this.choosePath(null)))),
        card("Distances", ...Object.values(this.distances).map((slider) => slider.element)),
      ),
    );
  }

  async open(address) {
    this.closed = false;
    this.connection("What-if", false);
    if (!this.defaults) {
      this.defaults = await get("api/what-if");
      this.state = this.initial();
    }
    const shared = address ? await fromAddress(address) : null;
    if (shared) this.state = { ...this.initial(), ...shared };
    this.refresh();
  }

  close() {
    this.closed = true;
    clearTimeout(this.settling);
  }

  initial() {
    const { site, d_min_m, d_max_m, margin_m, adaptation } = this.defaults;
    const mission = Object.keys(site.targets ?? {}).length ? "inspection" : "exit";
    return {
      site: structuredClone(site),
      mission,
      target: null,
      risk: { wind: 0, communication: 0, localization: 0, battery: 0 },
      weights: null,
      adaptation,
      d_min_m,
      d_max_m,
      margin_m: round(margin_m),
    };
  }

  restore() {
    this.state = this.initial();
    this.refresh();
  }

  /** A change by hand. */
  change(part) {
    Object.assign(this.state, part);
    if (part.mission) this.state.weights = null;
    this.refresh();
  }

  /** Asks for the path at once, and for the rest when nothing changes any more. */
  refresh() {
    this.shownPath = null;
    this.updateControls();
    this.ask(0);
  }

  ask(stage) {
    clearTimeout(this.settling);
    this.stage = stage;
    this.asking.ask({ ...this.state, parts: STAGES[stage] });
  }

  receive(found, newest) {
    if (this.closed) return;
    this.found = found;
    this.front = found.front ?? [];
    setText(this.problem, found.plan.status === "found" ? "" : `No path: ${found.plan.reason}`);
    setAttribute(this.problem, "class", "last-text problem");
    this.plane.setSite(found.maps.site, found.maps.maps);
    this.draw();
    this.updateResults();
    this.updateLegend();
    if (!newest || this.stage + 1 === STAGES.length) return;
    this.settling = setTimeout(() => this.ask(this.stage + 1), SETTLED_MS);
    if (this.stage === 0) toAddress(this.state).then((address) => this.closed || this.onAddress(address));
  }

  fail(error) {
    if (this.closed) return;
    // Another tab of this computer was answered instead.
    if (error.status === 429) {
      this.settling = setTimeout(() => this.ask(this.stage), SETTLED_MS);
      return;
    }
    setText(this.problem, `Not planned: ${error.message}`);
    setAttribute(this.problem, "class", "last-text problem");
  }

  draw() {
    const { plan, baselines } = this.found;
    const paths = [{ points: plan.path.map(([x, z]) => [x, z]), kind: "path" }];
    if (baselines) paths.unshift({ points: baselines.shortest.path, kind: "other" }, { points: baselines.voronoi.path, kind: "ghost" });
    if (this.shownPath !== null && this.front[this.shownPath]) paths.push({ points: this.front[this.shownPath].path, kind: "shown" });
    this.plane.setHandles(this.makeHandles());
    this.plane.show({ paths, goal: { mission: plan.mission, goal: plan.target ?? this.firstTarget() } });
  }

  firstTarget() {
    return this.state.mission === "inspection" ? Object.keys(this.state.site.targets)[0] : null;
  }

  makeHandles() {
    const { site } = this.state;
    const view = this.found.maps.site;
    const handles = [];
    const add = (id, label, at, move) => handles.push({ id, label, at, moved: (place) => {
      move(place);
      this.refresh();
    } });
    add("start", "start", [site.start.x_m, site.start.z_m], ([x, z]) => Object.assign(site.start, { x_m: x, z_m: z }));
    site.obstacles.forEach((entry, index) => {
      if (entry.conductor) {
        const shape = entry.conductor;
        add(`obstacle-${index}`, `conductor ${shape.name}`, [shape.x_m, shape.z_m], ([x, z]) => Object.assign(shape, { x_m: x, z_m: z }));
        return;
      }
      const shape = entry.polygon;
      add(`obstacle-${index}`, shape.name, middle(shape.vertices_m), (place) => {
        const from = middle(shape.vertices_m);
        const by = [0, 1].map((axis) => place[axis] - from[axis]);
        shape.vertices_m = shape.vertices_m.map(([x, z]) => [round(x + by[0]), round(z + by[1])]);
      });
    });
    for (const target of view.targets) {
      add(`target-${target.name}`, `target ${target.name}`, [target.x_m, target.z_m], ([x, z]) => {
        const { dwell_s, yaw_deg } = site.targets[target.name];
        site.targets[target.name] = { x_m: x, z_m: z, ...(dwell_s === undefined ? {} : { dwell_s }), ...(yaw_deg === undefined ? {} : { yaw_deg }) };
      });
    }
    for (const [mission, points] of Object.entries(site.landing ?? {})) {
      points.forEach((point, index) => add(`${mission}-${index}`, `landing point ${index} of the ${mission}`, [point.x_m, point.z_m], ([x, z]) => Object.assign(point, { x_m: x, z_m: z })));
    }
    return handles;
  }

  chosenTarget() {
    const value = this.target.value;
    if (value === "") return null;
    return this.state.mission === "inspection" ? value : Number(value);
  }

  updateControls() {
    const { state, defaults } = this;
    this.mission.value = state.mission;
    this.adaptation.value = state.adaptation;
    const points = state.site.landing?.[state.mission] ?? [];
    const choices = state.mission === "inspection" ? Object.keys(state.site.targets ?? {}).map((name) => [name, name]) : [["", "any landing point"], ...points.map((_, index) => [String(index), `landing point ${index}`])];
    replaceWhen(this.target, choices, () => choices.map(([value, words]) => h("option", { value }, words)));
    this.target.value = state.target === null ? (choices[0]?.[0] ?? "") : String(state.target);
    const [calm, storm] = defaults.wind_mps;
    for (const [name, slider] of Object.entries(this.risks)) {
      const value = state.risk[name];
      const wind = value <= 0 ? `≤ ${calm} m/s` : `${(calm + value * (storm - calm)).toFixed(1)} m/s`;
      slider.show(value, name === "wind" ? `${value.toFixed(2)} · ${wind}` : value.toFixed(2));
    }
    for (const [name, slider] of Object.entries(this.distances)) slider.show(state[name], number(state[name], 2, " m"));
  }

  updateResults() {
    const { plan, baselines } = this.found;
    this.triangle.show(plan.base_weights, plan.weights);
    this.triangle.showFront(this.front, this.shownPath);
    replaceWhen(this.weightWords, [plan.base_weights, plan.weights], () => [
      table(["", "base", "with risks"], NAMES.map((name) => [name, plan.base_weights[name].toFixed(2), plan.weights[name].toFixed(2)])),
    ]);
    setText(this.frontWords, this.frontText());
    const metrics = plan.metrics;
    setText(this.title, metrics ? `${capital(plan.mission)} to ${goalWords(plan.mission, plan.target ?? this.firstTarget())}: ${duration(metrics.duration_s)}` : "No path");
    setRows(this.figures, [
      ["length", number(metrics?.length_m, 1, " m")],
      ["least clearance", number(metrics?.min_clearance_m, 1, " m")],
      ["cost J", number(plan.cost?.total, 2)],
      ["planned in", `${number((plan.compute.map_ms ?? 0) + (plan.compute.search_ms ?? 0), 1)} ms`],
    ]);
    replaceWhen(this.shares, [plan.shares], () =>
      NAMES.map((name) => {
        const part = h("span", { class: `${name}-share` });
        part.style.flex = `${plan.shares?.[name] ?? 0} 1 0`;
        return part;
      }),
    );
    const term = (name, unit = "") => (plan.cost ? `${plan.weights[name].toFixed(2)} × ${plan.cost[name].toFixed(2)}${unit}` : "");
    const share = (name) => (plan.shares ? `${Math.round(100 * plan.shares[name])} %` : "");
    replaceWhen(this.cost, [plan.cost, plan.weights], () => [
      table(["term", "weight × sum", "share"], NAMES.map((name) => [h("span", { class: "key" }, h("i", { class: `${name}-share` }), name), term(name, name === "time" ? " s" : ""), share(name)])),
    ]);
    setText(this.changeWords, plan.change ? `Against the path without risks: ${plan.change}` : "");
    const row = (name, found, known = true) => [name, ...(known ? [number(found?.length_m, 1), number(found?.duration_s, 1), number(found?.mean_clearance_m, 2), number(found?.min_clearance_m, 2)] : ["…", "…", "…", "…"])];
    const rows = [row("this path", metrics), ...Object.entries(BASELINES).map(([kind, words]) => row(words, baselines?.[kind].metrics, baselines))];
    if (this.shownPath !== null) rows.splice(1, 0, row("chosen path", this.front[this.shownPath].metrics));
    replaceWhen(this.compare, rows, () => [table(["", "length, m", "time, s", "clearance, m", "least, m"], rows)]);
  }

  frontText() {
    if (!this.front.length) return this.found.plan.status === "found" ? "Looking for all best paths…" : "";
    if (this.shownPath === null) return `${this.front.length} different paths are optimal, each in its own colour.`;
    const { sums } = this.front[this.shownPath];
    return `Path ${this.shownPath + 1} of ${this.front.length}: safety ${sums.safety.toFixed(2)}, time ${sums.time.toFixed(1)} s, energy ${sums.energy.toFixed(2)}.`;
  }

  choosePath(index) {
    if (!this.front.length) return;
    this.shownPath = index;
    this.draw();
    this.updateResults();
    this.updateLegend();
  }

  updateLegend() {
    const lines = [legendLine("path", "optimal path"), legendLine("other", "A*, shortest"), legendLine("ghost", "Voronoi")];
    if (this.shownPath !== null) lines.push(legendLine("shown", "chosen path"));
    this.legend.replaceChildren(...lines, ...legendMap(this.plane.layer, this.plane.maps));
  }

  async share() {
    const address = await toAddress(this.state);
    this.onAddress(address);
    try {
      await navigator.clipboard.writeText(location.href);
      setText(this.copied, "The address is copied.");
    } catch {
      setText(this.copied, "The address bar has the state.");
    }
  }

  download() {
    const link = h("a", { download: "site.yaml", href: URL.createObjectURL(new Blob([siteFileText(this.state.site)], { type: "application/yaml" })) });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    setText(this.copied, "site.yaml is downloaded: check it with moar-companion check --files.");
  }
}

/** A labelled slider with its value as text. */
class Slider {
  constructor(label, least, most, step, changed) {
    this.output = h("output");
    this.input = h("input", { type: "range", min: least, max: most, step, oninput: () => changed(Number(this.input.value)) });
    this.element = h("label", { class: "slider" }, h("span", {}, label), this.input, this.output);
  }

  show(value, words) {
    if (Number(this.input.value) !== value) this.input.value = String(value);
    setText(this.output, words);
    setAttribute(this.input, "aria-valuetext", words);
  }
}
