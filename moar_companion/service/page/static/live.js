// The live view: the state of the service, ten times a second, and orders to it.
import { h, replaceWhen, setText } from "./dom.js";
import { merged } from "./merge.js";
import { authorization, confirmed, get, Newest, post, Refused } from "./server.js";
import { StatusView } from "./status.js";
import { clock, duration, plain } from "./words.js";

const RETRY_MS = 1000;
const SILENT_S = 2;
/** A connection that brings nothing for this time is made anew: the browser does not see that its network is gone. */
const LOST_S = 6;
const OTHERS_PERIOD_MS = 3000;
const APART_M = 0.1;
/** Points of the flown path, as the service keeps them. */
const MOST_FLOWN = 5000;
/** Status of an answer to a request that one of another tab has replaced. */
const SUPERSEDED = 429;

/** Obstacles of the site as seen now, that a site file does not have. */
function withSeen(document, view) {
  const known = new Set(document.obstacles.map((entry) => (entry.conductor ?? entry.polygon).name));
  const more = view.site.obstacles.filter((obstacle) => !known.has(obstacle.name)).map((obstacle) => {
    const { kind, ...shape } = obstacle;
    return { [kind]: { ...shape, keep_out_m: Math.max(0, shape.keep_out_m - (view.site.margin_m ?? 0)) } };
  });
  return more.length ? { ...document, obstacles: [...document.obstacles, ...more] } : null;
}

/** A what-if request for the mission under other risks, from where the aircraft is. */
export function othersRequest(status, whatIf, view) {
  const { aircraft, mission, plan, risk, weights } = status;
  if (!aircraft?.position_m || !plan || !whatIf) return null;
  const request = {
    mission: plan.mission,
    target: mission.goal ?? plan.target ?? null,
    start_m: [aircraft.position_m[0], aircraft.position_m[2]],
    risk: Object.fromEntries(Object.entries(risk).map(([name, index]) => [name, index.value])),
    parts: ["alternatives"],
  };
  if (weights) request.weights = weights.base;
  const site = withSeen(whatIf.site, view);
  if (site) request.site = site;
  return request;
}

export class LiveView {
  /**
   * page: the answer of /api/page. connection: called with a text, and whether it is bad. moved:
   * called with the site, the track and the place of the aircraft.
   */
  constructor(page, connection, moved) {
    Object.assign(this, { page, connection, moved });
    this.view = new StatusView();
    this.orders = h("div", { class: "orders", role: "group", "aria-label": "Orders" });
    this.answer = h("p", { class: "answer", role: "status" });
    this.choice = h("label", { class: "choice" }, "Target to inspect ");
    this.view.below.append(this.orders);
    this.element = this.view.element;
    this.others = new Newest((request) => post("api/what-if", request), (found) => this.view.setOthers(found.alternatives), (error) => error.status === SUPERSEDED || this.view.setOthers([]));
    this.view.levelsChanged = () => this.askOthers();
    this.makeOrders();
  }

  open() {
    if (this.closed === false) return;
    this.closed = false;
    this.received = performance.now();
    this.connect();
    this.timers = [setInterval(() => this.askOthers(), OTHERS_PERIOD_MS), setInterval(() => this.watch(), RETRY_MS)];
  }

  close() {
    this.closed = true;
    this.timers?.forEach(clearInterval);
    clearTimeout(this.retry);
    this.socket?.close();
  }

  connect() {
    const url = new URL("live", location.href);
    url.protocol = url.protocol.replace("http", "ws");
    url.hash = "";
    const socket = new WebSocket(url);
    this.socket?.close();
    this.socket = socket;
    this.connected = performance.now();
    socket.addEventListener("message", (event) => {
      if (this.closed || socket !== this.socket) return;
      this.received = performance.now();
      this.receive(JSON.parse(event.data));
    });
    socket.addEventListener("close", () => {
      if (this.closed || socket !== this.socket) return;
      this.connection("No connection to the service", true);
      this.retry = setTimeout(() => this.connect(), RETRY_MS);
    });
  }

  /** Says that nothing comes; the service sends once a second at least. */
  watch() {
    const now = performance.now();
    const silent = (now - this.received) / 1e3;
    if (silent < SILENT_S || this.socket.readyState === WebSocket.CLOSED) return;
    this.connection(`No data from the service for ${duration(Math.round(silent))}`, true);
    if ((now - Math.max(this.received, this.connected)) / 1e3 > LOST_S) this.connect();
  }

  receive(frame) {
    if (frame.all) {
      this.state = frame.all;
      this.flown = frame.flown ?? [];
      this.readSite();
    } else {
      const revision = this.state.site_revision;
      this.state = merged(this.state, frame.changed);
      if (this.state.site_revision !== revision) this.readSite();
    }
    const silent = this.state.silent_s ?? 0;
    const { time_s: time } = this.state;
    if (silent > SILENT_S) this.connection(`No data from the service for ${duration(silent)}`, true);
    else this.connection(time ? `Live, ${clock(time)}` : "Waiting for the service", !time);
    // A state has no status before the service has sent one.
    if (!this.state.mission) return;
    const position = this.state.aircraft.position_m;
    const last = this.flown.at(-1);
    if (position && this.state.aircraft.landed !== "on_ground" && (!last || Math.hypot(position[0] - last[0], position[2] - last[2]) > APART_M)) this.flown.push(position);
    if (this.flown.length > MOST_FLOWN) this.flown.shift();
    const planned = this.state.plan?.paths;
    const changed = planned !== this.planned;
    this.planned = planned;
    this.view.setStatus(this.state, this.flown);
    this.moved(this.site, this.flown, position);
    if (changed) this.askOthers();
    this.updateOrders();
  }

  async readSite() {
    const view = await get("api/site").catch((error) => (error instanceof Refused ? null : this.site));
    this.site = view;
    this.view.setSite(view, this.page.vehicle);
    this.updateTargets();
    this.moved(view, this.flown, this.state.aircraft?.position_m);
    this.askOthers();
  }

  /** Asks for the other risk levels where they are shown: only then the page's process loads the planner. */
  async askOthers() {
    if (!this.view.show.levels || !this.page.what_if || !this.state?.mission || !this.site || document.hidden) return;
    this.whatIf ??= await get("api/what-if").catch(() => null);
    const request = othersRequest(this.state, this.whatIf, this.site);
    if (request) this.others.ask(request);
    else this.view.setOthers([]);
  }

  makeOrders() {
    const button = (words, attributes, act) => h("button", { type: "button", ...attributes, onclick: act }, words);
    this.target = h("select");
    this.choice.append(this.target);
    this.hold = button("Hold", { class: "hold" }, () => this.order("hold", null, "Hold here?", "The aircraft stops and holds its position."));
    this.go = button("Continue", {}, () => this.order("continue", null, "Continue the mission?", "The aircraft flies on along its path."));
    const others = [
      button("Inspect", {}, () => this.order("inspection", this.target.value || null, `Inspect ${this.target.value || "every target"}?`, "A path to the target is planned and flown.")),
      button("Exit", {}, () => this.order("exit", null, "Exit?", "The aircraft leaves the site for a landing point, with the weights of the exit.")),
      button("Evacuate", {}, () => this.order("evacuation", null, "Evacuate?", "The aircraft leaves the site for the nearest landing point on the safest path.")),
      button("Release control", {}, () => this.order("release", null, "Release control?", "The companion sends no more setpoints. The autopilot acts as its own parameters say.")),
    ];
    this.buttons = [this.hold, this.go, ...others];
    if (this.page.orders) {
      this.orders.append(this.answer, ...this.buttons);
      this.view.below.prepend(this.choice);
    }
    else this.orders.append(h("p", { class: "muted" }, "This page shows; it gives no orders. To take over, select any other flight mode."));
  }

  updateTargets() {
    const names = this.site?.site.targets.map((target) => target.name) ?? [];
    // The site changes in flight, too: what is chosen stays.
    replaceWhen(this.target, names, () => [h("option", { value: "" }, "every target"), ...names.map((name) => h("option", { value: name }, name))]);
  }

  /** Hold counts in each state: it also keeps a mission from going on by itself. */
  updateOrders() {
    this.go.disabled = ["flying", "at_target", "landing_leg"].includes(this.state.mission.state);
  }

  async order(order, target, title, text) {
    if (!(await confirmed(title, text, title.replace("?", "")))) return;
    setText(this.answer, "Sent, waiting for the answer…");
    try {
      const found = await post("api/order", { order, target }, authorization());
      const reason = found.reason ? `: ${found.reason}` : "";
      setText(this.answer, `Answer to ${order}: ${plain(found.result.toLowerCase())}${reason}`);
    } catch (error) {
      setText(this.answer, `Not ordered: ${error.message}`);
    }
  }
}
