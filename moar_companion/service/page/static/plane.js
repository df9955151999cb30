// The vertical plane of a site: maps, obstacles, paths, the aircraft; metres to pixels.
import { h, replaceWhen, s, setAttribute } from "./dom.js";
import { number } from "./words.js";

const PAD_M = 2;
const MARGIN_PX = { left: 34, right: 14, top: 14, bottom: 26 };
const OCCUPIED = 255;
/** Least speed that has an arrow. */
const MOVING_MPS = 0.15;
/** Pixels of a metre below which only the goal has its name. */
const DENSE = 15;

/** Bytes of a map in base64. */
function bytesOf(text) {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}

/** The map as an image: safety cost grows darker, so does a lower speed limit. */
function mapImage(maps, layer) {
  const { columns, rows } = maps;
  const { data, scale } = maps[layer];
  const safety = layer === "safety";
  const values = bytesOf(data);
  const style = getComputedStyle(document.documentElement);
  const colour = style.getPropertyValue(safety ? "--safety" : "--speed").split(",").map(Number);
  const occupied = style.getPropertyValue("--occupied").split(",").map(Number);
  const canvas = document.createElement("canvas");
  canvas.width = columns;
  canvas.height = rows;
  const context = canvas.getContext("2d");
  const image = context.createImageData(columns, rows);
  const most = safety ? 1 / scale : OCCUPIED - 1;
  for (let row = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++) {
      const value = values[row * columns + column];
      const at = 4 * ((rows - 1 - row) * columns + column);
      const blocked = value === OCCUPIED;
      const share = Math.min(1, value / most);
      const [red, green, blue] = blocked ? occupied : colour;
      const alpha = blocked ? 0.6 : safety ? 0.8 * share : 0.75 * (1 - share);
      image.data.set([red, green, blue, 255 * alpha], at);
    }
  }
  context.putImageData(image, 0, 0);
  return canvas.toDataURL();
}

/** Nearest point of an obstacle's surface to a place. */
function surface(obstacle, [x, z]) {
  if (obstacle.kind === "conductor") {
    const distance = Math.hypot(x - obstacle.x_m, z - obstacle.z_m) || 1;
    const share = obstacle.radius_m / distance;
    return [obstacle.x_m + (x - obstacle.x_m) * share, obstacle.z_m + (z - obstacle.z_m) * share];
  }
  let best = null;
  obstacle.vertices_m.forEach((from, index) => {
    const to = obstacle.vertices_m[(index + 1) % obstacle.vertices_m.length];
    const along = [to[0] - from[0], to[1] - from[1]];
    const length2 = along[0] ** 2 + along[1] ** 2 || 1;
    const share = Math.min(1, Math.max(0, ((x - from[0]) * along[0] + (z - from[1]) * along[1]) / length2));
    const point = [from[0] + share * along[0], from[1] + share * along[1]];
    if (!best || Math.hypot(point[0] - x, point[1] - z) < Math.hypot(best[0] - x, best[1] - z)) best = point;
  });
  return best;
}

/** The obstacle nearest to a place, and the nearest point of its surface. */
export function nearest(obstacles, [x, z]) {
  const found = obstacles.map((obstacle) => ({ name: obstacle.name, place: surface(obstacle, [x, z]) }));
  const away = ({ place }) => Math.hypot(place[0] - x, place[1] - z);
  return found.reduce((a, b) => (away(b) < away(a) ? b : a));
}

export class PlaneView {
  /** host: the element to fill. label: of the picture. */
  constructor(host, label) {
    this.layer = "safety";
    this.layers = {};
    this.site = null;
    this.maps = null;
    this.bounds = null;
    this.handles = [];
    /** True to show landing points that are far outside the workspace. */
    this.wide = false;
    this.empty = h("p", { class: "empty" }, "No site is known: there is no plane to draw.");
    this.svg = s("svg", { role: "group", "aria-label": label });
    const names = ["map", "frame", "obstacles", "paths", "marks", "aircraft", "labels", "handles"];
    this.groups = Object.fromEntries(names.map((name) => [name, s("g")]));
    this.svg.append(...Object.values(this.groups));
    host.classList.add("plane");
    host.append(this.svg, this.empty);
    this.host = host;
    new ResizeObserver(() => this.draw()).observe(host);
  }

  setSite(site, maps) {
    this.site = site;
    this.maps = maps;
    this.image = null;
    this.draw();
  }

  setLayer(layer) {
    this.layer = layer;
    this.image = null;
    this.draw();
  }

  /** The map in the present colours. */
  recolour() {
    this.image = null;
    this.draw();
  }

  /**
   * What is drawn beside the site. paths: [{points, kind, label, left_m}]; flown: [[x, z]]; aircraft:
   * {position, velocity, radius}; setpoint: [x, z]; goal: {mission, goal}; seen: [[x, z]].
   */
  show(layers) {
    this.layers = layers;
    this.draw();
  }

  px([x, z]) {
    return [this.left + (x - this.x0) * this.scale, this.bottom - (z - this.z0) * this.scale];
  }

  metres([left, top]) {
    return [this.x0 + (left - this.left) / this.scale, this.z0 + (this.bottom - top) / this.scale];
  }

  draw() {
    this.empty.hidden = Boolean(this.site);
    const width = this.host.clientWidth;
    const height = this.host.clientHeight;
    if (!this.site || width < 60 || height < 60) return;
    this.fit(width, height);
    this.drawMap();
    this.drawFrame();
    this.drawObstacles();
    this.drawPaths();
    this.drawMarks();
    this.drawAircraft();
    this.drawHandles();
  }

  /** The window in metres: the workspace, and all that is flown or planned outside it. */
  fit(width, height) {
    const space = this.site.workspace;
    let [x0, x1] = [space.x_m[0] - PAD_M, space.x_m[1] + PAD_M];
    const floors = (space.ground?.profile_m ?? [[0, space.min_altitude_m ?? space.z_m[0]]]).map(([, z]) => z);
    let [z0, z1] = [Math.min(space.z_m[0], ...floors), space.z_m[1] + PAD_M / 2];
    const { paths = [], aircraft, flown = [] } = this.layers;
    const main = paths.find((path) => path.kind === "path");
    const handles = this.wide ? this.handles.map((handle) => handle.at) : [];
    const places = [...(main?.points ?? []), ...(aircraft ? [aircraft.position] : []), ...flown, ...handles];
    for (const [x, z] of places) {
      if (Math.abs(x - x0) > 500 || Math.abs(z - z0) > 500) continue;
      [x0, x1] = [Math.min(x0, x - 1.5), Math.max(x1, x + 1.5)];
      [z0, z1] = [Math.min(z0, z - 1.5), Math.max(z1, z + 1.5)];
    }
    const inner = [width - MARGIN_PX.left - MARGIN_PX.right, height - MARGIN_PX.top - MARGIN_PX.bottom];
    this.scale = Math.min(inner[0] / (x1 - x0), inner[1] / (z1 - z0));
    this.left = MARGIN_PX.left + (inner[0] - (x1 - x0) * this.scale) / 2;
    this.bottom = MARGIN_PX.top + inner[1] - (inner[1] - (z1 - z0) * this.scale) / 2;
    [this.x0, this.x1, this.z0, this.z1] = [x0, x1, z0, z1];
    this.size = [width, height];
    this.view = [width, height, x0, x1, z0, z1].map((value) => Math.round(value * 100));
    this.svg.classList.toggle("dense", this.scale < DENSE);
    setAttribute(this.svg, "viewBox", `0 0 ${width} ${height}`);
  }

  pixels(places) {
    return places.map((place) => this.px(place).join()).join(" ");
  }

  drawMap() {
    const shown = this.layer !== "none" && this.maps;
    if (shown && !this.image) this.image = mapImage(this.maps, this.layer);
    replaceWhen(this.groups.map, [this.view, this.layer, shown ? this.image.length + this.image.slice(-400) : ""], () => {
      if (!shown) return [];
      const { columns, rows, lower_m: lower, cell_m: cell } = this.maps;
      const [x, y] = this.px([lower[0], lower[1] + rows * cell]);
      return [s("image", { href: this.image, x, y, width: columns * cell * this.scale, height: rows * cell * this.scale, preserveAspectRatio: "none" })];
    });
  }

  drawFrame() {
    replaceWhen(this.groups.frame, [this.view, this.site.workspace], () => {
      const { x_m: xs, z_m: zs, min_altitude_m: floor, ground } = this.site.workspace;
      const [x, y] = this.px([xs[0], zs[1]]);
      const parts = [s("rect", { class: "space", x, y, width: (xs[1] - xs[0]) * this.scale, height: (zs[1] - zs[0]) * this.scale })];
      if (floor !== null && floor !== undefined) {
        const line = ground?.floor_m ?? [[xs[0], floor], [xs[1], floor]];
        const [labelX, labelY] = this.px([(xs[0] + xs[1]) / 2, line[Math.floor(line.length / 2)][1]]);
        if (ground) parts.push(s("polyline", { class: "ground", points: this.pixels(ground.profile_m) }));
        parts.push(s("polyline", { class: "floor", points: this.pixels(line) }));
        parts.push(s("text", { class: "soft least", x: labelX, y: labelY + 16, "text-anchor": "middle" }, `least altitude ${floor} m${ground ? " above ground" : ""}`));
      }
      const step = [1, 2, 5, 10, 20, 50, 100].find((each) => each * this.scale > 55) ?? 200;
      const bottom = this.size[1] - 8;
      for (let at = Math.ceil(this.x0 / step) * step; at <= this.x1 && this.px([at, 0])[0] < this.size[0] - 50; at += step)
        parts.push(s("text", { class: "tick", x: this.px([at, 0])[0], y: bottom, "text-anchor": "middle" }, at));
      for (let at = Math.ceil(this.z0 / step) * step; at <= this.z1; at += step)
        parts.push(s("text", { class: "tick", x: 26, y: this.px([0, at])[1] + 4, "text-anchor": "end" }, at));
      parts.push(s("text", { class: "tick", x: this.size[0] - 8, y: bottom, "text-anchor": "end" }, "x, m"));
      parts.push(s("text", { class: "tick", x: 6, y: 16 }, "z, m"));
      return parts;
    });
  }

  drawObstacles() {
    replaceWhen(this.groups.obstacles, [this.view, this.site.obstacles, this.layers.seen], () => [
      ...this.site.obstacles.flatMap((obstacle) => {
        if (obstacle.kind !== "conductor") {
          const points = this.pixels(obstacle.vertices_m);
          const [x, y] = this.px(obstacle.vertices_m.reduce((a, b) => (b[1] > a[1] ? b : a)));
          return [s("polygon", { class: "obstacle", points }), s("text", { class: "soft", x, y: y - 6, "text-anchor": "middle" }, obstacle.name)];
        }
        const [x, y] = this.px([obstacle.x_m, obstacle.z_m]);
        const radius = Math.max(4.5, obstacle.radius_m * this.scale);
        return [s("circle", { class: "obstacle", cx: x, cy: y, r: radius }), s("text", { class: "soft", x, y: y - radius - 4, "text-anchor": "middle" }, obstacle.name)];
      }),
      ...(this.layers.seen ?? []).map((place) => {
        const [x, y] = this.px(place);
        return s("rect", { class: "seen", x: x - 7, y: y - 7, width: 14, height: 14, transform: `rotate(45 ${x} ${y})` });
      }),
    ]);
  }

  /** The part of a path that is left, and the part behind; left_m: its length, null: all of it. */
  parted(points, left) {
    if (left === null || left === undefined) return [points, []];
    let rest = left;
    for (let index = points.length - 1; index > 0; index--) {
      const [from, to] = [points[index - 1], points[index]];
      const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
      if (length > rest) {
        const place = [0, 1].map((axis) => to[axis] + ((from[axis] - to[axis]) * rest) / length);
        return [[place, ...points.slice(index)], [...points.slice(0, index), place]];
      }
      rest -= length;
    }
    return [points, []];
  }

  /** Sign and name where an escape ends, or leaves the picture. */
  escapeEnd(points, kind) {
    const places = points.map((point) => this.px(point));
    const [low, high] = [[10, 10], [this.size[0] - 10, this.size[1] - 10]];
    const beyond = (value, axis) => Math.max(low[axis] - value, value - high[axis]);
    const out = places.findIndex((place) => place.some((value, axis) => beyond(value, axis) > 0));
    const end = out < 0 ? places.length - 1 : out;
    const [from, to] = [places[Math.max(0, end - 1)], places[end]];
    const shares = to.map((value, axis) => (beyond(value, axis) > 0 ? ((value > from[axis] ? high : low)[axis] - from[axis]) / (value - from[axis]) : 1));
    const share = out < 0 ? 1 : Math.max(0, Math.min(...shares));
    const [x, y] = [0, 1].map((axis) => from[axis] + (to[axis] - from[axis]) * share);
    const angle = (Math.atan2(to[1] - from[1], to[0] - from[0]) * 180) / Math.PI;
    const sign = out < 0 ? s("circle", { class: `end ${kind}`, cx: x, cy: y, r: 4 }) : s("path", { class: `end ${kind}`, d: "M8 0l-12 -6v12z", transform: `translate(${x} ${y}) rotate(${angle})` });
    const right = x > this.size[0] / 2;
    // Both may end at one place; an end within the picture has a landing point's name below it.
    const apart = kind === "exit" ? -12 : out < 0 ? -26 : 20;
    return [sign, s("text", { class: kind, x: right || out < 0 ? x : MARGIN_PX.left, y: y + apart, "text-anchor": right ? "end" : "start" }, kind)];
  }

  line(points, kind) {
    const d = points.map((point, index) => (index ? "L" : "M") + this.px(point).map((value) => value.toFixed(1)).join(" ")).join("");
    return s("path", { class: `line ${kind}`, d });
  }

  drawPaths() {
    const { paths = [], flown = [] } = this.layers;
    replaceWhen(this.groups.paths, [this.view, paths, flown.length, flown.at(-1)], () => [
      ...(flown.length > 1 ? [this.line(flown, "flown")] : []),
      ...paths.filter((path) => path.points.length > 1).flatMap((path) => {
        if (path.kind === "exit" || path.kind === "evacuation") return [this.line(path.points, path.kind), ...this.escapeEnd(path.points, path.kind)];
        if (path.kind !== "path") return [this.line(path.points, path.kind)];
        const [ahead, behind] = this.parted(path.points, path.left_m);
        return [this.line(behind, "behind"), this.line(ahead, "casing"), this.line(ahead, "path")];
      }),
    ]);
  }

  drawMarks() {
    const { goal = {}, paths = [] } = this.layers;
    const { targets, landing } = this.site;
    replaceWhen(this.groups.marks, [this.view, targets, landing, goal, paths.map((path) => [path.label, path.points.at(-1)])], () => {
      const parts = [];
      for (const target of targets) {
        const [x, y] = this.px([target.x_m, target.z_m]);
        const own = goal.mission === "inspection" && goal.goal === target.name;
        parts.push(s("circle", { class: own ? "target goal" : "target", cx: x, cy: y, r: own ? 9 : 7 }), s("circle", { class: "obstacle", cx: x, cy: y, r: 2 }));
        const before = paths.find((path) => path.kind === "path")?.points.at(-2);
        const room = 12 * target.name.length;
        const left = x > this.size[0] - room || (own && before?.[0] > target.x_m && x > room);
        parts.push(s("text", { class: own ? "goal" : "other-goal", x: left ? x - 4 : x + 13, y: left ? y + 22 : y + 5, "text-anchor": left ? "end" : "start" }, target.name));
      }
      const places = new Map();
      for (const [mission, points] of Object.entries(landing)) {
        points.forEach((point, index) => {
          const key = `${point.x_m},${point.z_m}`;
          const words = places.get(key) ?? { point: [point.x_m, point.z_m], names: [], own: false };
          words.names.push(points.length > 1 ? `${mission}, point ${index}` : mission);
          words.own ||= goal.mission === mission && (goal.goal === index || goal.goal === null || goal.goal === undefined);
          places.set(key, words);
        });
      }
      for (const { point, names, own } of places.values()) parts.push(...this.landingMark(point, names.join("; "), own));
      return parts;
    });
  }

  /** A landing point; one outside the picture is an arrow at its edge with the distance. */
  landingMark(point, name, own) {
    const [low, high] = [MARGIN_PX.left, this.size[0] - MARGIN_PX.right].map((left) => this.metres([left, 0])[0]);
    const inside = point[0] >= low && point[0] <= high && point[1] >= this.z0 && point[1] <= this.z1;
    const shape = own ? "landing goal" : "landing";
    const style = own ? "goal" : "soft-landing";
    if (inside) {
      const [x, y] = this.px(point);
      const anchor = x > this.size[0] * 0.7 ? "end" : x < this.size[0] * 0.3 ? "start" : "middle";
      return [s("path", { class: shape, d: `M${x - 8} ${y - 8}h16l-8 11z` }), s("text", { class: style, x: anchor === "end" ? x + 8 : anchor === "start" ? x - 8 : x, y: y - 14, "text-anchor": anchor }, `land: ${name}`)];
    }
    const right = point[0] > high;
    const edge = this.px([right ? high : low, Math.min(Math.max(point[1], this.z0), this.z1)]);
    const away = right ? point[0] - high : low - point[0];
    const [x, y] = [edge[0] + (right ? -4 : 4), Math.min(edge[1], this.size[1] - 40)];
    const side = right ? -1 : 1;
    return [
      s("path", { class: shape, d: `M${x} ${y}l${14 * side} -7v14z` }),
      s("text", { class: style, x, y: y + 24, "text-anchor": right ? "end" : "start" }, name + (this.scale < DENSE ? "" : `, ${number(away, 1, " m")} ${right ? "right" : "left"} of the picture`)),
    ];
  }

  drawAircraft() {
    const { aircraft, setpoint, clearance } = this.layers;
    replaceWhen(this.groups.aircraft, [this.view, aircraft, setpoint, clearance], () => {
      if (!aircraft) return [];
      const parts = [];
      const [x, y] = this.px(aircraft.position);
      if (this.site.obstacles.length && clearance !== undefined && clearance !== null) {
        const { place: near } = nearest(this.site.obstacles, aircraft.position);
        const [nx, ny] = this.px(near);
        const away = Math.hypot(nx - x, ny - y) || 1;
        const hull = Math.min(1, (aircraft.radius * this.scale) / away);
        parts.push(s("line", { class: "clearance", x1: x + (nx - x) * hull, y1: y + (ny - y) * hull, x2: nx, y2: ny }), s("circle", { class: "clearance-end", cx: nx, cy: ny, r: 3 }));
        parts.push(s("text", { x: (x + nx) / 2 + 6, y: (y + ny) / 2 }, number(clearance, 1, " m")));
      }
      const group = s("g", { class: "aircraft" });
      const hull = aircraft.radius * this.scale;
      if (hull > 10) group.append(s("circle", { class: "hull", cx: x, cy: y, r: hull }));
      const [vx, vz] = aircraft.velocity ?? [0, 0];
      const speed = Math.hypot(vx, vz);
      if (speed > MOVING_MPS) {
        const length = Math.min(60, 18 + 14 * speed);
        const angle = (Math.atan2(-vz, vx) * 180) / Math.PI;
        group.append(s("path", { class: "movement", d: `M0 0h${length}m-7 -5l7 5l-7 5`, transform: `translate(${x} ${y}) rotate(${angle})` }));
      }
      group.append(s("circle", { cx: x, cy: y, r: 8 }));
      const behind = speed > MOVING_MPS && vx > 0 ? -1 : 1;
      parts.push(group, s("text", { class: "own", x: x + 12 * behind, y: y - 12, "text-anchor": behind < 0 ? "end" : "start" }, "aircraft"));
      if (setpoint) {
        const [sx, sy] = this.px(setpoint);
        parts.push(s("path", { class: "setpoint", d: `M${sx - 6} ${sy}h12M${sx} ${sy - 6}v12` }));
      }
      return parts;
    });
  }

  /** Handles to drag: [{id, label, at: [x, z], moved(place)}]. Arrow keys move, too. */
  setHandles(handles) {
    this.handles = handles;
    this.draw();
  }

  drawHandles() {
    const known = new Map([...this.groups.handles.children].map((element) => [element.dataset.id, element]));
    for (const handle of this.handles) {
      let element = known.get(handle.id);
      known.delete(handle.id);
      if (!element) {
        element = this.makeHandle(handle.id);
        this.groups.handles.append(element);
      }
      const [x, y] = this.px(handle.at);
      setAttribute(element, "visibility", x >= 0 && x <= this.size[0] && y >= 0 && y <= this.size[1] ? null : "hidden");
      setAttribute(element, "transform", `translate(${x.toFixed(1)} ${y.toFixed(1)})`);
      setAttribute(element, "aria-label", `${handle.label}: x ${number(handle.at[0], 2)} m, z ${number(handle.at[1], 2)} m. Arrow keys move it.`);
    }
    for (const element of known.values()) element.remove();
  }

  makeHandle(id) {
    const current = () => this.handles.find((handle) => handle.id === id);
    const element = s("g", { class: "handle", tabindex: "0", role: "button", "data-id": id }, s("circle", { class: "ring", r: 15 }));
    const snap = (value) => Math.round(value * 20) / 20;
    const place = (event) => {
      const box = this.svg.getBoundingClientRect();
      return this.metres([event.clientX - box.left, event.clientY - box.top]).map(snap);
    };
    element.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      element.focus();
      element.classList.add("held");
      this.svg.setPointerCapture(event.pointerId);
      // The scale stays while a handle is held: the place under the pointer must not move.
      const fit = this.fit;
      this.fit = () => {};
      const move = (moved) => current()?.moved(place(moved));
      const end = (last) => {
        this.svg.removeEventListener("pointermove", move);
        element.classList.remove("held");
        this.fit = fit;
        current()?.moved(place(last));
      };
      this.svg.addEventListener("pointermove", move);
      this.svg.addEventListener("pointerup", end, { once: true });
      this.svg.addEventListener("pointercancel", end, { once: true });
    });
    element.addEventListener("keydown", (event) => {
      const step = event.shiftKey ? 1 : 0.25;
      const by = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] }[event.key];
      const handle = current();
      if (!by || !handle) return;
      event.preventDefault();
      handle.moved([snap(handle.at[0] + by[0]), snap(handle.at[1] + by[1])]);
    });
    return element;
  }
}

const SAMPLES = {
  path: ["path", "M0 5h26"],
  ghost: ["ghost", "M0 5h26"],
  flown: ["flown", "M0 5h26"],
  setpoint: ["setpoint", "M7 5h12M13 -1v12"],
  movement: ["movement", "M0 5h24m-7 -5l7 5l-7 5"],
  exit: ["exit", "M0 5h26"],
  evacuation: ["evacuation", "M0 5h26"],
  other: ["other", "M0 5h26"],
  shown: ["shown", "M0 5h26"],
};

/** A line of the legend. */
export function legendLine(kind, words) {
  const [name, d] = SAMPLES[kind];
  return h("span", {}, s("svg", { "aria-hidden": "true" }, s("path", { class: `line ${name}`, d })), words);
}

/** The legend of the map layer. */
export function legendMap(layer, maps) {
  if (layer === "none" || !maps) return [];
  const box = h("span", {}, h("i", { class: "box" }), "occupied");
  const most = maps.speed_mps.scale * (OCCUPIED - 1);
  return layer === "safety"
    ? [h("span", {}, "safety cost 0", h("i", { class: "ramp safety" }), "1"), box]
    : [h("span", {}, "speed limit 0", h("i", { class: "ramp speed" }), number(most, 1, " m/s")), box];
}

/** Buttons that choose one of several values. */
export function segments(label, choices, chosen, choose) {
  const buttons = choices.map(([value, words]) =>
    h("button", { type: "button", "aria-pressed": String(value === chosen), onclick: () => {
      for (const [index, button] of buttons.entries()) setAttribute(button, "aria-pressed", String(choices[index][0] === value));
      choose(value);
    } }, words),
  );
  return h("div", { class: "segments", role: "group", "aria-label": label }, ...buttons);
}

export const MAP_LAYERS = [["safety", "Safety map"], ["speed_mps", "Speed map"], ["none", "No map"]];
