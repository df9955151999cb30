// Recorded flights: a list, and a time line of one with its events.
import { h, s, setAttribute, setText } from "./dom.js";
import { othersRequest } from "./live.js";
import { merged } from "./merge.js";
import { authorization, confirmed, get, Newest, post } from "./server.js";
import { StatusView } from "./status.js";
import { bytes, dateAndClock, isKnown, plain, reasonWords } from "./words.js";

const KEY_FRAMES = 50;
const CHUNK_S = 60;
const RISKS = ["wind", "communication", "localization", "battery"];
const SETTLED_MS = 300;
/** The slider's step is 0.1 s: an event that was chosen is at the play head. */
const ROUNDING_S = 0.05;
const TIME_STEPS_S = [1, 2, 5, 10, 30, 60, 120, 300, 600, 1200, 3600];
/** Most marks of time under the chart: as many as a phone has room for. */
const MOST_TIMES = 7;
/** Kinds of events that the frames show with their reasons; requests for plans that change no path. */
const SHOWN_BY_FRAMES = new Set(["condition", "plan", "replan"]);

/** All frames of a recording; each state is made of the last whole one and the changes since. */
class Frames {
  constructor() {
    this.frames = [];
    this.keys = new Map();
    this.curves = Object.fromEntries(RISKS.map((name) => [name, []]));
    this.flown = [];
    this.events = [];
    this.spans = [];
    this.open = new Map();
  }

  add(frame) {
    const state = frame.all ?? merged(this.last ?? {}, frame.changed);
    const index = this.frames.length;
    if (index % KEY_FRAMES === 0 || frame.all) this.keys.set(index, state);
    this.frames.push(frame);
    const before = this.last;
    this.last = state;
    if (!state.mission) return;
    for (const name of RISKS) this.curves[name].push([frame.time_s, state.risk?.[name]?.value ?? null]);
    if (state.aircraft?.position_m && state.aircraft.landed !== "on_ground") this.flown.push([frame.time_s, state.aircraft.position_m]);
    this.note(frame.time_s, before?.mission ? before : null, state);
  }

  /** Events that a state shows: changes of path, conditions that begin and end. */
  note(time, before, state) {
    if (state.plan && state.plan.paths !== before?.plan?.paths) {
      const change = state.plan.change ? `; ${state.plan.change}` : "";
      this.events.push({ time_s: time, kind: "path", text: `${reasonWords(state.plan.reason)}${change}` });
    }
    const now = new Map((state.supervision?.conditions ?? []).map((item) => [item.name, item]));
    for (const [name, span] of this.open) {
      if (now.has(name)) continue;
      span.to = time;
      this.open.delete(name);
    }
    for (const [name, item] of now) {
      if (this.open.has(name)) continue;
      const span = { name, action: item.action, from: time, to: Infinity };
      this.open.set(name, span);
      this.spans.push(span);
      this.events.push({ time_s: time, kind: "condition", text: `${plain(name)}: ${item.reason} (${item.action})` });
    }
  }

  /** Index of the last frame at a time. */
  at(time) {
    let [low, high] = [0, this.frames.length - 1];
    while (low < high) {
      const middle = Math.ceil((low + high) / 2);
      if (this.frames[middle].time_s <= time) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  state(index) {
    let key = index;
    while (!this.keys.has(key)) key--;
    let state = this.keys.get(key);
    for (let at = key + 1; at <= index; at++) state = this.frames[at].all ?? merged(state, this.frames[at].changed);
    return state;
  }
}

export class PlaybackView {
  constructor(page, connection, opened) {
    Object.assign(this, { page, connection, opened });
    this.list = h("ul", { class: "recordings" });
    this.message = h("p", { role: "status" });
    this.listElement = h("div", { class: "page" }, h("h1", {}, "Recordings"), this.message, h("section", { class: "card" }, this.list));
    this.element = h("div");
    this.others = new Newest((request) => post("api/what-if", request), (found, _, newest) => newest && this.asked === this.now && this.view.setOthers(found.alternatives), () => {});
  }

  async open(name) {
    this.connection("Recordings", false);
    const chosen = name || this.page.recording;
    if (chosen) await this.play(chosen);
    else await this.showList();
  }

  close() {
    this.stop();
    this.loading = null;
    clearTimeout(this.settling);
  }

  async showList() {
    this.element.replaceChildren(this.listElement);
    try {
      const { recordings } = await get("api/recordings");
      setText(this.message, recordings.length ? "" : "Nothing is recorded yet.");
      this.list.replaceChildren(...recordings.map((recording) => this.row(recording)));
    } catch (error) {
      setText(this.message, error.message);
    }
  }

  row({ name, bytes: size, active, files }) {
    const encoded = encodeURIComponent(name);
    const link = (file) => h("a", { href: `api/recordings/${encoded}/${encodeURIComponent(file.name)}`, download: file.name }, `${file.name} (${bytes(file.bytes)})`);
    const remove = h("button", { type: "button", disabled: active || !this.page.orders, onclick: () => this.remove(name) }, "Delete");
    return h("li", {}, h("span", { class: "name" }, name), h("span", { class: "muted" }, active ? `${bytes(size)}, being recorded` : bytes(size)), ...files.map(link), h("a", { href: `#recordings=${encoded}` }, "Play back"), remove);
  }

  async remove(name) {
    if (!(await confirmed(`Delete ${name}?`, "The recording is removed from the companion computer.", "Delete"))) return;
    try {
      await get(`api/recordings/${encodeURIComponent(name)}`, { method: "DELETE", headers: authorization() });
      await this.showList();
      setText(this.message, `${name} is deleted.`);
    } catch (error) {
      setText(this.message, `Not deleted: ${error.message}`);
    }
  }

  async play(name) {
    this.name = name;
    this.frames = new Frames();
    this.now = 0;
    this.view = new StatusView();
    this.view.levelsChanged = () => this.seek(this.now);
    this.stamp = h("p", { class: "stamp" }, "REPLAY");
    this.view.lead.prepend(this.stamp);
    this.buildTimeline();
    this.element.replaceChildren(this.view.element);
    const encoded = encodeURIComponent(name);
    const loading = {};
    this.loading = loading;
    // Of another recording, or after this view was left.
    const isLeft = () => this.loading !== loading;
    try {
      const summary = await get(`api/playback/${encoded}`);
      const site = await get(`api/playback/${encoded}/site`);
      if (isLeft()) return;
      Object.assign(this, { summary, site });
      this.view.setSite(site, this.page.vehicle);
      this.slider.max = String(summary.duration_s);
      await this.load(encoded, isLeft);
    } catch (error) {
      if (!isLeft()) this.connection(error.message, true);
    }
  }

  async load(encoded, isLeft) {
    const { duration_s: whole } = this.summary;
    for (let from = 0; from <= whole; from += CHUNK_S) {
      const { frames } = await get(`api/playback/${encoded}/frames?from=${from}&to=${from + CHUNK_S}`);
      if (isLeft()) return;
      for (const frame of frames) if (!this.frames.frames.length || frame.time_s > this.frames.frames.at(-1).time_s) this.frames.add(frame);
      this.connection(`Loading ${this.name}`, false);
      this.drawTimeline();
      this.showEvents();
      this.seek(this.now);
    }
    this.connection(this.name, false);
    this.element.dataset.loaded = "true";
  }

  buildTimeline() {
    this.play_ = h("button", { type: "button", onclick: () => (this.timer ? this.stop() : this.start()) }, "Play");
    this.speed = h("select", { "aria-label": "Speed" }, ...[1, 2, 5, 10].map((factor) => h("option", { value: factor }, `${factor} ×`)));
    this.slider = h("input", { type: "range", min: 0, max: 1, step: 0.1, value: 0, "aria-label": "Time in the recording", oninput: () => this.seek(Number(this.slider.value)) });
    this.time = h("output", { class: "muted" });
    this.chart = s("svg", { class: "chart", viewBox: "0 0 1000 84", preserveAspectRatio: "none", role: "img", "aria-label": "The four risks over the flight; marks where the path changed, shades where a condition acted" });
    this.times = h("div", { class: "times", "aria-hidden": "true" });
    this.acted = h("span", {});
    this.cursor = s("line", { class: "now", y1: 0, y2: 84, "vector-effect": "non-scaling-stroke" });
    this.events = h("ol", { class: "events", tabindex: "0", "aria-label": "Events" });
    const key = (name, words) => h("span", {}, s("svg", { "aria-hidden": "true" }, s("path", { class: `curve ${name}`, d: "M0 5h26" })), words);
    this.view.below.append(
      h(
        "section",
        { class: "card timeline", "aria-label": "Time line" },
        h("div", { class: "controls" }, this.play_, this.speed, this.slider, this.time),
        h("div", { class: "plot" }, h("div", { class: "axis", "aria-hidden": "true" }, h("span", {}, "1"), h("span", {}, "risk"), h("span", {}, "0")), this.chart, this.times),
        h("div", { class: "legend" }, ...RISKS.map((name) => key(name, name)), h("span", {}, s("svg", { "aria-hidden": "true" }, s("path", { class: "mark", d: "M13 -2v14" })), "path changed"), h("span", {}, h("i", { class: "box condition" }), this.acted)),
        h("p", { class: "events-head", "aria-hidden": "true" }, h("span", {}, "time"), h("span", {}, "what"), h("span", {}, "text")),
        this.events,
      ),
    );
  }

  drawTimeline() {
    const whole = this.summary.duration_s || 1;
    const x = (time) => (1000 * Math.min(time, whole)) / whole;
    const scaled = { "vector-effect": "non-scaling-stroke" };
    const parts = [];
    for (const span of this.frames.spans) {
      if (span.action === "continue") continue;
      parts.push(s("rect", { class: "span", x: x(span.from), y: 0, width: Math.max(2, x(span.to) - x(span.from)), height: 84 }, s("title", {}, plain(span.name))));
    }
    for (const name of RISKS) {
      let pen = "M";
      const d = this.frames.curves[name].map(([time, value]) => {
        if (value === null) {
          pen = "M";
          return "";
        }
        const piece = `${pen}${x(time).toFixed(1)} ${(80 - 76 * value).toFixed(1)}`;
        pen = "L";
        return piece;
      });
      parts.push(s("path", { class: `curve ${name}`, d: d.join(""), ...scaled }));
    }
    for (const event of this.frames.events) {
      if (event.kind === "path") parts.push(s("line", { class: "mark", x1: x(event.time_s), x2: x(event.time_s), y1: 0, y2: 84, ...scaled }, s("title", {}, event.text)));
    }
    this.chart.replaceChildren(...parts, this.cursor);
    const names = new Set(this.frames.spans.filter((span) => span.action !== "continue").map((span) => plain(span.name)));
    setText(this.acted, names.size ? `condition: ${[...names].join(", ")}` : "no condition acted");
    const step = TIME_STEPS_S.find((each) => whole / each <= MOST_TIMES) ?? whole;
    this.times.replaceChildren();
    for (let time = 0; time <= whole; time += step) {
      const mark = h("span", {}, minutes(time));
      mark.style.left = `${(100 * time) / whole}%`;
      this.times.append(mark);
    }
  }

  showEvents() {
    const given = (this.summary.events ?? []).filter((event) => !SHOWN_BY_FRAMES.has(event.kind));
    this.shownEvents = [...given, ...this.frames.events].sort((a, b) => a.time_s - b.time_s);
    this.events.replaceChildren(
      ...this.shownEvents.map((event) =>
        h("li", {}, h("button", { type: "button", onclick: () => this.seek(event.time_s) }, h("span", { class: "at" }, clockOf(event.time_s)), h("span", { class: "kind" }, plain(event.kind)), h("span", {}, event.kind === "state" ? plain(event.text).replace("->", "→") : event.text))),
      ),
    );
  }

  seek(time) {
    if (!this.frames.frames.length) return;
    this.now = Math.min(Math.max(0, time), this.summary.duration_s);
    if (this.asked !== this.now) this.view.others = [];
    const index = this.frames.at(this.now);
    const state = this.frames.state(index);
    this.slider.value = String(this.now);
    const words = `${clockOf(this.now)} of ${clockOf(this.summary.duration_s)}`;
    setText(this.time, words);
    const { began_s: began } = this.summary;
    setText(this.stamp, isKnown(began) ? `REPLAY ${dateAndClock(began + this.now)}` : "REPLAY, date unknown");
    setAttribute(this.slider, "aria-valuetext", words);
    const at = (1000 * this.now) / (this.summary.duration_s || 1);
    setAttribute(this.cursor, "x1", at);
    setAttribute(this.cursor, "x2", at);
    if (state.mission) {
      const flown = this.frames.flown.filter(([when]) => when <= this.now).map(([, place]) => place);
      this.view.setStatus(state, flown);
      this.opened?.(this.site, flown, state.aircraft?.position_m);
      clearTimeout(this.settling);
      this.settling = setTimeout(() => this.askOthers(state), SETTLED_MS);
    }
    let last = -1;
    for (const [row, event] of this.shownEvents.entries()) if (event.time_s <= this.now + ROUNDING_S) last = row;
    [...this.events.children].forEach((item, row) => setAttribute(item.firstChild, "aria-current", row === last ? "true" : null));
    const current = this.events.children[last];
    if (current) this.events.scrollTop = current.offsetTop - 40;
  }

  /** Asks for the other risk levels where they are shown: only then the server loads the planner. */
  async askOthers(state) {
    this.asked = this.now;
    if (!this.view.show.levels || !this.page.what_if || !this.site) return;
    this.whatIf ??= await get("api/what-if").catch(() => null);
    const request = othersRequest(state, this.whatIf, this.site);
    if (request) this.others.ask(request);
  }

  start() {
    if (this.now >= this.summary.duration_s) this.now = 0;
    let before = performance.now();
    setText(this.play_, "Pause");
    this.timer = setInterval(() => {
      const now = performance.now();
      this.seek(this.now + ((now - before) / 1e3) * Number(this.speed.value));
      before = now;
      if (this.now >= this.summary.duration_s) this.stop();
    }, 100);
  }

  stop() {
    clearInterval(this.timer);
    this.timer = null;
    if (this.play_) setText(this.play_, "Play");
  }
}

function minutes(seconds) {
  const whole = Math.floor(seconds);
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

/** A time in the recording; tenths tell an event before the play head from one after it. */
function clockOf(seconds) {
  return `${minutes(seconds)}.${Math.floor((seconds % 1) * 10)}`;
}
