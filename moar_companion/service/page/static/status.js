// The state of a flight at one instant: headline, plane, and what explains it. Live and played back.
import { h, replaceWhen, setAttribute, setText } from "./dom.js";
import { legendLine, legendMap, MAP_LAYERS, nearest, PlaneView, segments } from "./plane.js";
import { WeightTriangle } from "./triangle.js";
import { actionWords, actsWords, autopilotName, capital, controlWords, duration, gateWords, goalWords, grade, headline, isKnown, isSilent, number, percent, plain, reasonWords, riskGrade, UNKNOWN } from "./words.js";

/** Least risk whose cause is shown beside its bar. */
const LOW = 0.05;
/** What is lost, in pilots' words; both agents' actions for one loss share a row. */
const LOSSES = { "ground station": "Ground station", "GCS loss": "Ground station", "RC loss": "Remote control", "GPS loss": "GPS", "companion loss": "Companion" };
/** The losses of a link, which come first. */
const LINKS = ["Ground station", "Remote control", "Companion"];
/** Losses of which no action of the autopilot is worth no row. */
const QUIET = /battery$|^GCS/;
const RISKS = ["wind", "communication", "localization", "battery"];

export class StatusView {
  constructor() {
    this.others = [];
    /** Called when the other risk levels are to be shown, or no more. */
    this.levelsChanged = () => {};
    this.plane = null;
    this.show = { escapes: true, levels: false, before: true };
    this.build();
  }

  build() {
    this.title = h("h1", { id: "headline" });
    this.figures = h("dl", { class: "figures" });
    this.control = h("strong");
    this.lastText = h("span");
    const host = h("div");
    this.plane = new PlaneView(host, "The vertical plane of the site");
    this.legend = h("div", { class: "legend" });
    const check = (key, words) =>
      h("label", { class: "check" }, h("input", { type: "checkbox", checked: this.show[key], onchange: (event) => {
        this.show[key] = event.target.checked;
        if (key === "levels") this.levelsChanged();
        this.update();
      } }), words);
    this.options = h(
      "div",
      { class: "legend" },
      segments("Map under the plane", MAP_LAYERS, this.plane.layer, (layer) => {
        this.plane.setLayer(layer);
        this.updateLegend();
      }),
      check("escapes", "Exit and evacuation"),
      check("levels", "Other risk levels"),
      check("before", "Path before"),
    );
    this.conditionsCard = h("section", { class: "card", "aria-labelledby": "conditions-title" }, h("h2", { id: "conditions-title" }, "Against the flight"));
    this.conditions = h("ul", { class: "conditions" });
    this.conditionsCard.append(this.conditions);
    this.why = h("div", { class: "why" });
    this.risks = Object.fromEntries(RISKS.map((name) => [name, new RiskGauge(name)]));
    this.triangle = new WeightTriangle("Triangle of the weights of safety, time and energy");
    this.weightWords = h("div");
    this.energy = new EnergyCard();
    this.losses = h("dl", { class: "rows" });
    this.otherLosses = h("dl", { class: "rows others" });
    this.rows = h("dl", { class: "rows" });
    this.lead = h("section", { class: "lead", "aria-labelledby": "headline" }, this.title, this.figures, h("p", { class: "last-text" }, this.control, " ", this.lastText));
    this.below = h("div", { class: "below" });
    const card = (title, ...content) => h("section", { class: "card" }, h("h2", {}, title), ...content);
    this.element = h(
      "div",
      { class: "view" },
      h("div", { class: "main" }, this.lead, host, folded("Map and legend", this.options, this.legend), this.below),
      h(
        "div",
        { class: "side", role: "region", "aria-label": "Explanation", tabindex: "0" },
        this.conditionsCard,
        card("Why this path", this.why),
        this.energy.element,
        card("Risks, 0 to 1", ...RISKS.map((name) => this.risks[name].element)),
        card("If something fails", this.losses, this.otherLosses),
        card("Weights of the path", h("div", { class: "weights" }, this.triangle.svg, this.weightWords)),
        card("Links and sensors", this.rows),
      ),
    );
  }

  setSite(view, vehicle) {
    this.vehicle = vehicle;
    this.plane.setSite(view?.site ?? null, view?.maps ?? null);
    this.updateLegend();
    this.update();
  }

  /** status: a state; flown: [[x, y, z]]. */
  setStatus(status, flown) {
    // A telemetry log has no conditions, and at first no place.
    this.conditionsKnown = Boolean(status.supervision);
    this.status = { ...status, supervision: status.supervision ?? { conditions: [] }, aircraft: status.aircraft ?? {} };
    this.flown = flown;
    this.update();
  }

  /** others: the mission under other risks, by what-if. */
  setOthers(others) {
    this.others = others.filter((item) => item.mission !== item.name);
    this.update();
  }

  updateLegend() {
    const items = [["path", "path ahead"], ["flown", "flown"], ["ghost", "path before"], ["exit", "exit"], ["evacuation", "evacuation"], ["movement", "movement"], ["setpoint", "setpoint"]];
    this.legend.replaceChildren(...items.map(([kind, words]) => legendLine(kind, words)), ...legendMap(this.plane.layer, this.plane.maps));
  }

  update() {
    if (!this.status) return;
    this.updateLead();
    this.updatePlane();
    this.updateConditions();
    this.updateWhy();
    for (const name of RISKS) this.risks[name].update(this.status.risk?.[name]);
    this.updateWeights();
    this.energy.update(this.status, this.vehicle);
    this.updateLosses();
    this.updateRows();
  }

  updateLead() {
    const { mission, aircraft, path } = this.status;
    setText(this.title, headline(this.status));
    const figures = [
      ["to go", path ? `${number(path.left_m, 1)} m, ${duration(path.left_s)}` : this.conditionsKnown ? "no path is flown" : UNKNOWN],
      ["speed", number(aircraft.speed_mps, 1, " m/s")],
      ["height z", number(aircraft.position_m?.[2], 1, " m")],
      ["clearance", number(aircraft.clearance_m, 1, " m") + this.clearedWords()],
    ];
    setRows(this.figures, figures);
    setText(this.control, controlWords(this.status));
    setText(this.lastText, mission.text ? `${duration(mission.text_age_s)} ago: ${mission.text}` : "");
  }

  /** What the clearance is to: from the hull to an obstacle's surface. */
  clearedWords() {
    const { clearance_m: clearance, position_m: position } = this.status.aircraft;
    const obstacles = this.plane.site?.obstacles ?? [];
    if (!isKnown(clearance) || !isKnown(position) || !obstacles.length) return "";
    return `, hull to ${nearest(obstacles, [position[0], position[2]]).name}`;
  }

  updatePlane() {
    const { plan, before, aircraft, path, mission, perception, energy } = this.status;
    const paths = [];
    const { levels, escapes, before: ghost } = this.show;
    if (levels) for (const item of this.others) paths.push({ points: item.path, kind: "other" });
    for (const kind of ["exit", "evacuation"]) {
      const route = energy?.[kind]?.path;
      if (escapes && route?.length && mission.mission !== kind) paths.push({ points: points(route), kind });
    }
    if (ghost && before?.path) paths.push({ points: points(before.path), kind: "ghost" });
    if (plan?.path && mission.state !== "idle") paths.push({ points: points(plan.path), kind: "path", left_m: path?.left_m });
    const own = (vector) => (vector ? [vector[0], vector[2]] : null);
    const position = own(aircraft.position_m);
    this.plane.show({
      paths,
      flown: (this.flown ?? []).map(own),
      aircraft: position && { position, velocity: own(aircraft.velocity_mps), radius: this.vehicle?.radius_m ?? 0 },
      clearance: aircraft.clearance_m,
      setpoint: path ? own(path.setpoint.position_m) : null,
      goal: { mission: mission.mission, goal: mission.goal },
      seen: (perception?.conductors ?? []).map((seen) => [seen.x_m, seen.z_m]),
    });
    setAttribute(this.plane.svg, "aria-label", `The vertical plane of the site. ${headline(this.status)}. Aircraft at x ${number(position?.[0])} m, z ${number(position?.[1])} m.`);
  }

  updateConditions() {
    const { supervision: { conditions }, risk, mission } = this.status;
    const grades = conditions.filter((item) => !item.overridden).map((item) => grade(item.action));
    const worst = ["warning", "caution"].find((each) => grades.includes(each));
    const acts = conditions.some((item) => !item.overridden && item.action !== "continue");
    const risks = riskWords(acts ? {} : (risk ?? {}));
    const resumes = mission.state === "holding" && isKnown(mission.mission) && conditions.some((item) => item.action === "hold" && !item.overridden);
    setAttribute(this.conditionsCard, "class", `card ${worst ?? ""}`);
    const key = [this.conditionsKnown, conditions, risks, resumes];
    replaceWhen(this.conditions, key, () => {
      const entry = (kind, chip, title, text) => h("li", { class: kind }, h("span", { class: "chip" }, chip), h("span", {}, h("strong", {}, title), h("br"), text));
      const items = conditions.map((item) => entry(item.overridden ? "" : grade(item.action), item.overridden ? "Overridden" : actionWords(item.action), capital(plain(item.name)), item.reason));
      const verdict = items.length ? "" : this.conditionsKnown ? "No limit is exceeded. " : "This recording has no conditions. ";
      const chip = risks.chip || (this.conditionsKnown ? "Clear" : "Unknown");
      if (verdict || risks.words) items.push(h("li", { class: risks.grade }, h("span", { class: "chip" }, chip), h("span", {}, verdict + risks.words)));
      if (resumes) items.push(h("li", { class: "muted after" }, "The mission resumes when no condition acts any more, unless an operator has ordered a hold."));
      return items;
    });
  }

  updateWhy() {
    const { plan } = this.status;
    const weights = this.status.weights?.base ? this.status.weights : null;
    const key = [plan?.paths, plan?.reason, plan?.change, plan?.mission, plan?.target, weights && shifts(weights)];
    replaceWhen(this.why, key, () => {
      if (!plan) return [h("p", { class: "muted" }, "There is no path yet.")];
      return [
        h("p", {}, h("strong", {}, `${capital(plan.mission)} to ${goalWords(plan.mission, plan.target)}.`)),
        h("p", {}, `Planned because of ${reasonWords(plan.reason)}.`),
        plan.change ? h("p", {}, `Against the path before: ${plan.change}.`) : null,
        weights ? h("p", {}, shifts(weights)) : null,
      ].filter(Boolean);
    });
  }

  updateWeights() {
    const { weights } = this.status;
    if (!weights?.base) return;
    this.triangle.show(weights.base, weights.adjusted);
    replaceWhen(this.weightWords, [weights.words], () => [
      table(["", "base", "now"], ["safety", "time", "energy"].map((name) => [name, weights.base[name].toFixed(2), weights.adjusted[name].toFixed(2)])),
    ]);
  }

  updateLosses() {
    const { failsafes, autopilot } = this.status;
    const agents = { companion: "companion", autopilot: autopilotName(autopilot?.kind) };
    const rows = new Map();
    for (const { trigger, by, action, after_s: after } of failsafes?.actions ?? []) {
      const name = LOSSES[trigger] ?? capital(trigger);
      if (QUIET.test(trigger) && action === "go on") continue;
      const words = actsWords(agents[by], action) + (after === null || after === undefined ? "" : ` after ${after} s`);
      rows.set(name, rows.has(name) ? `${rows.get(name)}; ${words}` : words);
    }
    const links = LINKS.filter((name) => rows.has(name)).map((name) => [name, rows.get(name)]);
    if (!rows.size) links.push(["Actions", `${UNKNOWN}: the autopilot's parameters are not read yet`]);
    setRows(this.losses, links);
    setRows(this.otherLosses, [...rows].filter(([name]) => !LINKS.includes(name)));
  }

  updateRows() {
    const { link, autopilot, radio, perception, plan, path, supervision, host } = this.status;
    const ages = this.status.age_s ?? {};
    const gate = supervision.conditions.find((item) => item.name.startsWith("setpoint_"));
    const rows = [
      ["Autopilot link", link ? autopilotLink(link, autopilot) : UNKNOWN],
      ["Ground station", isKnown(ages.ground_station) ? `${duration(ages.ground_station)} ago` : "none is received"],
    ];
    if (radio) rows.push([`Radio ${radio.kind}`, `${number(radio.rssi, 0)} here, ${number(radio.remote_rssi, 0)} there`]);
    rows.push(["Position", isKnown(ages.local_position) ? `${duration(ages.local_position)} old` : UNKNOWN]);
    rows.push(["Setpoint gate", gate ? gate.reason : path ? `passes; aircraft ${number(path.error_m, 2)} m from the setpoint` : "no setpoint is sent"]);
    rows.push(["Last refused setpoint", this.conditionsKnown ? gateWords(this.status.gate) : UNKNOWN]);
    rows.push(["Plan time", plan ? `${number(plan.search_ms, 1, " ms")}, ${duration(plan.age_s)} ago; ${plan.paths} paths` : UNKNOWN]);
    rows.push(["Lidar", perception ? lidar(perception) : "none is configured"]);
    if (host) rows.push(["Computer", `${gigabytes(host.memory_free_mb, 1)} memory, ${gigabytes(host.disk_free_mb, 0)} disk free`]);
    setRows(this.rows, rows);
  }
}

/** Options and legend under a plane; on a phone they open by a touch. */
export function folded(summary, ...content) {
  return h("details", { class: "tools", open: !matchMedia("(max-width: 900px)").matches }, h("summary", {}, summary), ...content);
}

function points(path) {
  return path.map((point) => [point.x_m, point.z_m]);
}

/** Rows of a description list; only texts that differ are changed. */
export function setRows(list, rows) {
  if (list.dataset.keys !== rows.map(([key]) => key).join("|")) {
    list.dataset.keys = rows.map(([key]) => key).join("|");
    list.replaceChildren(
      ...rows.flatMap(([key]) => {
        const parts = [h("dt", {}, key), h("dd")];
        return list.classList.contains("figures") ? [h("div", {}, ...parts)] : parts;
      }),
    );
  }
  list.querySelectorAll("dd").forEach((element, index) => setText(element, String(rows[index][1])));
}

export function table(head, rows) {
  const cells = (name, values) => h("tr", {}, ...values.map((value, index) => h(name, { class: index ? "n" : "", scope: name === "th" ? "col" : null }, value)));
  return h("table", {}, h("thead", {}, cells("th", head)), h("tbody", {}, ...rows.map((row) => cells("td", row))));
}

/** The cause of a risk index, short. */
function cause(index) {
  const worst = index.inputs?.find((input) => input.name === index.worst);
  return worst ? `${worst.name} ${worst.reading}` : (index.words ?? index.cause ?? "");
}

/** What the risks add to the verdict: those that are high, with their cause, and those without data. */
function riskWords(risk) {
  const all = Object.entries(risk).filter(([, index]) => isKnown(index.value)).sort((a, b) => b[1].value - a[1].value);
  const high = all.filter(([, index]) => index.known && riskGrade(index.value) !== "note");
  const missing = all.filter(([, index]) => !index.known).map(([name]) => name);
  const words = high.map(([name, index]) => `${capital(name)} risk is high${isFalling(index) ? ", falling" : ""}: ${cause(index)}.`);
  if (missing.length) words.push(`No data for the risk of ${missing.join(" and ")}.`);
  return { grade: high.length ? riskGrade(high[0][1].value) : "", chip: high.length ? "High risk" : missing.length ? "No data" : "", words: words.join(" ") };
}

function isFalling(index) {
  return isKnown(index.target) && riskGrade(index.target) !== riskGrade(index.value) && index.target < index.value;
}

/** The risks that moved the weight of safety, from where and to where: a safer or a faster path. */
function shifts(weights) {
  const moved = Object.entries(weights.by_risk ?? {}).map(([risk, change]) => [risk, change.safety]).filter(([, change]) => Math.abs(change) >= 0.005);
  if (!moved.length) return "No risk moves the weights from their base.";
  const words = moved.map(([risk, change]) => `${risk} ${change > 0 ? "+" : "−"}${Math.abs(change).toFixed(2)}`);
  const [from, to] = [weights.base.safety, weights.adjusted.safety];
  return `Weight of safety ${from.toFixed(2)} → ${to.toFixed(2)} (${words.join(", ")}): a ${to >= from ? "safer" : "faster"} path.`;
}

/** Packets of the autopilot; their rate is that of the last ones, however old these are. */
function autopilotLink(link, autopilot) {
  const rate = isSilent(autopilot) ? `nothing for ${duration(autopilot.age_s)}` : number(link.rate_hz, 0, " packets/s");
  return `${rate}, ${link.packets_lost} lost`;
}

function gigabytes(megabytes, digits) {
  return number(isKnown(megabytes) ? megabytes / 1e3 : null, digits, " GB");
}

function lidar(perception) {
  if (perception.refusal) return `packets ${plain(perception.refusal)}`;
  if (perception.scan_age_s === undefined || perception.scan_age_s === null) return "no scan yet";
  return `${perception.conductors.length} conductors, ${perception.solids} other obstacles; scan ${duration(perception.scan_age_s)} ago`;
}

/** A risk index as a bar that opens to its inputs. */
class RiskGauge {
  constructor(name) {
    this.fill = h("i");
    this.value = h("span", { class: "value" });
    this.cause = h("span", { class: "cause" });
    this.inputs = h("div");
    this.element = h(
      "details",
      { class: "risk" },
      h("summary", {}, h("span", { class: "name" }, capital(name)), h("span", { class: "bar" }, this.fill), this.value, this.cause),
      this.inputs,
    );
    this.element.addEventListener("toggle", () => this.update(this.index));
  }

  update(index) {
    this.index = index;
    if (!isKnown(index?.value)) {
      setAttribute(this.element, "class", "risk unknown");
      setText(this.value, "no data");
      setText(this.cause, "");
      return;
    }
    setAttribute(this.element, "class", `risk ${index.known ? riskGrade(index.value) : "unknown"}`);
    this.fill.style.width = `${100 * index.value}%`;
    setText(this.value, index.known ? index.value.toFixed(2) : "no data");
    setText(this.cause, !index.known ? `none of its inputs is received; planned with ${index.value.toFixed(2)}` : index.value >= LOW ? cause(index) : "");
    if (!this.element.open) return;
    const known = (index.inputs ?? []).filter((input) => input.age_s !== null && input.age_s !== undefined);
    const missing = (index.inputs ?? []).filter((input) => !known.includes(input)).map((input) => input.name);
    replaceWhen(this.inputs, [index.words, known.map((input) => [input.name, input.reading, input.risk])], () => [
      h("p", { class: "muted" }, index.words ?? ""),
      h(
        "table",
        {},
        h("thead", {}, h("tr", {}, ...["input", "value", "age", "risk"].map((word, at) => h("th", { scope: "col", class: at ? "n" : "" }, word)))),
        h("tbody", {}, ...known.map((input) => h("tr", { class: input.name === index.worst ? "decides" : "" }, h("td", {}, input.name), h("td", { class: "n" }, input.reading), h("td", { class: "n" }, duration(input.age_s)), h("td", { class: "n" }, number(input.risk, 2))))),
      ),
      missing.length ? h("p", { class: "muted" }, `Not received: ${missing.join(", ")}.`) : null,
    ].filter(Boolean));
  }
}

/** Battery against the point of no return: flight time left, and what the escape needs. */
class EnergyCard {
  constructor() {
    this.words = h("p");
    this.parts = ["left", "escape", "reserve"].map((name) => h("i", { class: name }));
    this.bar = h("div", { class: "energy" }, ...this.parts);
    this.key = h("p", { class: "energy-key muted" });
    this.rows = h("dl", { class: "rows" });
    this.element = h("section", { class: "card" }, h("h2", {}, "Battery and point of no return"), this.words, this.bar, this.key, this.rows);
  }

  update(status, vehicle) {
    const { energy, batteries } = status;
    const charge = batteries?.map((battery) => `${percent(battery.remaining)}${battery.voltage_v ? `, ${number(battery.voltage_v, 1, " V")}` : ""}`).join("; ");
    const reserve = vehicle?.reserve_s ?? 0;
    const better = energy?.better ? energy[energy.better] : null;
    const slack = better?.left_s === undefined || better?.left_s === null ? null : better.left_s - reserve;
    const flown = energy?.better === status.mission.mission && ["flying", "landing_leg"].includes(status.mission.state) && slack !== null && better.left_s > 0;
    let words = "The point of no return is unknown.";
    if (flown) words = `The ${energy.better} is flown: after it, ${duration(better.left_s)} of flight are left.`;
    else if (slack > 0) words = `${capital(energy.better)} must begin within ${duration(slack)}.`;
    else if (slack !== null) words = `Past the point of no return for the ${energy.better}.`;
    setText(this.words, words);
    setAttribute(this.element, "class", `card ${slack !== null && slack < 30 ? "warning" : slack !== null && slack < 120 ? "caution" : ""}`);
    const whole = Math.max(vehicle?.endurance_s ?? 0, energy?.flight_s ?? 0) || 1;
    const share = (seconds) => `${Math.min(100, (100 * Math.max(0, seconds)) / whole)}%`;
    this.bar.hidden = !isKnown(energy?.flight_s);
    this.key.hidden = this.bar.hidden;
    setText(this.key, `Dark: ${better ? `the ${energy.better} and ` : ""}the reserve of ${duration(reserve)}. Light: the rest of the flight time.`);
    this.parts[0].style.width = share(energy?.flight_s ?? 0);
    this.parts[1].style.width = share((better?.duration_s ?? 0) + reserve);
    this.parts[2].style.width = share(reserve);
    const left = (route) => (route ? `${duration(route.duration_s)}, then ${duration(route.left_s)} left` : UNKNOWN);
    setRows(this.rows, [
      // A recording has no batteries.
      ...(batteries ? [["charge", charge || "no data"]] : []),
      ["flight time left", duration(energy?.flight_s)],
      ["rest of the mission", left(energy?.finish)],
      ["exit", left(energy?.exit)],
      ["evacuation", left(energy?.evacuation)],
    ]);
  }
}
