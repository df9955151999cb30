// The site in the world: north up, to scale, with the track of the aircraft.
import { h, replaceWhen, s, setAttribute } from "./dom.js";
import { table } from "./status.js";
import { number } from "./words.js";

const SEMI_MAJOR_M = 6378137;
const ECCENTRICITY_2 = 6.69437999014e-3;
const WIRE_M = 25;
const TILE_PX = 256;
const MOST_ZOOM = 19;
const radians = (degrees) => (degrees * Math.PI) / 180;
const degrees = (angle) => (angle * 180) / Math.PI;

/** East and north of (x, y) in the site's frame: x along the azimuth, y to the left of it. */
export function eastNorth(azimuth, [x, y]) {
  const turn = radians(azimuth);
  return [x * Math.sin(turn) - y * Math.cos(turn), x * Math.cos(turn) + y * Math.sin(turn)];
}

/** Metres per degree of longitude and latitude on WGS84. */
function metresPerDegree(latitude) {
  const sine2 = Math.sin(radians(latitude)) ** 2;
  const vertical = SEMI_MAJOR_M / Math.sqrt(1 - ECCENTRICITY_2 * sine2);
  const meridian = (vertical * (1 - ECCENTRICITY_2)) / (1 - ECCENTRICITY_2 * sine2);
  return [radians(1) * vertical * Math.cos(radians(latitude)), radians(1) * meridian];
}

/** Latitude and longitude of (x, y) in the site's frame. */
export function geodetic(frame, place) {
  const [east, north] = eastNorth(frame.azimuth_deg, place);
  const [perLongitude, perLatitude] = metresPerDegree(frame.origin.latitude_deg);
  return [frame.origin.latitude_deg + north / perLatitude, frame.origin.longitude_deg + east / perLongitude];
}

/** Web Mercator: column and row of a place in a zoom, with fractions, and back. */
function tileOf([latitude, longitude], zoom) {
  const count = 2 ** zoom;
  const angle = radians(latitude);
  return [((longitude + 180) / 360) * count, ((1 - Math.asinh(Math.tan(angle)) / Math.PI) / 2) * count];
}

function placeOf([column, row], zoom) {
  const count = 2 ** zoom;
  return [degrees(Math.atan(Math.sinh(Math.PI * (1 - (2 * row) / count)))), (column / count) * 360 - 180];
}

export class MapView {
  constructor(connection, page) {
    this.connection = connection;
    this.page = page;
    this.svg = s("svg", { role: "img", "aria-label": "Map of the site, north up" });
    this.host = h("div", { class: "plane" }, this.svg);
    this.host.append(h("p", { class: "empty", hidden: true }, "No site is known."));
    this.places = h("div");
    this.facts = h("p", { class: "muted" });
    this.element = h(
      "div",
      { class: "view" },
      h("div", { class: "main" }, h("section", { class: "lead" }, h("h1", {}, "The site in the world"), this.facts), this.host),
      h("div", { class: "side", role: "region", "aria-label": "Coordinates", tabindex: "0" }, h("section", { class: "card" }, h("h2", {}, "Coordinates, WGS84"), this.places)),
    );
    new ResizeObserver(() => this.draw()).observe(this.host);
  }

  open() {
    this.connection("Map", false);
    this.draw();
  }

  close() {}

  /** view: of /api/site; flown: [[x, y, z]]; aircraft: (x, y, z), or null. */
  show(view, flown, aircraft) {
    Object.assign(this, { site: view?.site, flown: flown ?? [], aircraft });
    this.draw();
  }

  draw() {
    const [width, height] = [this.host.clientWidth, this.host.clientHeight];
    this.host.lastElementChild.hidden = Boolean(this.site);
    if (!this.site || width < 60) return;
    const { frame, workspace, targets, landing, obstacles } = this.site;
    const wires = obstacles.filter((obstacle) => obstacle.kind === "conductor");
    const landings = Object.entries(landing).flatMap(([mission, points]) => points.map((point, index) => [points.length > 1 ? `${mission}, point ${index}` : mission, [point.x_m, 0], point.z_m]));
    const to = (place) => eastNorth(frame.azimuth_deg, place);
    const all = [[workspace.x_m[0], 0], [workspace.x_m[1], 0], ...landings.map(([, place]) => place), ...this.flown.map(([x, y]) => [x, y])].map(to);
    for (const wire of wires) all.push(to([wire.x_m, WIRE_M]), to([wire.x_m, -WIRE_M]));
    const range = [0, 1].map((axis) => [Math.min(...all.map((at) => at[axis])) - 8, Math.max(...all.map((at) => at[axis])) + 8]);
    const scale = Math.min(width / (range[0][1] - range[0][0]), height / (range[1][1] - range[1][0]));
    const centre = range.map(([low, high]) => (low + high) / 2);
    const px = ([east, north]) => [width / 2 + (east - centre[0]) * scale, height / 2 - (north - centre[1]) * scale];
    const line = (points, kind) => s("path", { class: `line ${kind}`, d: points.map((at, index) => (index ? "L" : "M") + px(at).map((value) => value.toFixed(1)).join(" ")).join("") });
    setAttribute(this.svg, "viewBox", `0 0 ${width} ${height}`);
    const parts = this.tiles(width, height, centre, scale);
    for (const wire of wires) parts.push(line([to([wire.x_m, WIRE_M]), to([wire.x_m, -WIRE_M])], "other"));
    for (const tower of obstacles.filter((obstacle) => obstacle.kind !== "conductor")) {
      const xs = tower.vertices_m.map(([x]) => x);
      parts.push(line([to([Math.min(...xs), 0]), to([Math.max(...xs), 0])], "tower"));
    }
    parts.push(line([to([workspace.x_m[0], 0]), to([workspace.x_m[1], 0])], "path"));
    const [ax, ay] = px(to([workspace.x_m[0], 0]));
    parts.push(s("text", { class: "goal", x: ax, y: ay + 40 }, `plane of the site, +x to ${number(frame.azimuth_deg, 0)}°`));
    const marks = new Map();
    for (const target of targets) marks.set(`${target.x_m}`, ["target", [target.x_m, 0], target.name]);
    for (const [name, place] of landings) {
      const key = `landing ${place[0]}`;
      marks.set(key, ["landing", place, marks.has(key) ? `${marks.get(key)[2]}, ${name}` : `landing: ${name}`]);
    }
    let above = true;
    for (const [kind, place, words] of marks.values()) {
      const [x, y] = px(to(place));
      parts.push(s("circle", { class: kind, cx: x, cy: y, r: 6 }), s("text", { x, y: above ? y - 14 : y + 24, "text-anchor": "middle" }, words));
      above = !above;
    }
    if (this.flown.length > 1) parts.push(line(this.flown.map(([x, y]) => to([x, y])), "flown"));
    if (this.aircraft) {
      const [x, y] = px(to(this.aircraft));
      parts.push(s("g", { class: "aircraft" }, s("circle", { cx: x, cy: y, r: 8 })), s("text", { class: "own", x: x + 12, y: y - 12 }, "aircraft"));
    }
    parts.push(...this.scaleBar(height, scale), ...north(width));
    this.svg.replaceChildren(...parts);
    this.showPlaces(landings);
  }

  scaleBar(height, scale) {
    const step = [1, 2, 5, 10, 20, 50, 100, 200].find((each) => each * scale > 70) ?? 500;
    const y = height - 22;
    return [s("path", { class: "line scale", d: `M16 ${y - 5}v5h${step * scale}v-5` }), s("text", { x: 16 + (step * scale) / 2, y: y - 8, "text-anchor": "middle" }, `${step} m`)];
  }

  /** Tiles of the configured address, under all else; none without one. */
  tiles(width, height, centre, scale) {
    const { tile_url: url } = this.page;
    if (!url) return [];
    const { frame } = this.site;
    const [perLongitude, perLatitude] = metresPerDegree(frame.origin.latitude_deg);
    const toPlace = ([x, y]) => [frame.origin.latitude_deg + (centre[1] - (y - height / 2) / scale) / perLatitude, frame.origin.longitude_deg + (centre[0] + (x - width / 2) / scale) / perLongitude];
    const toPx = ([latitude, longitude]) => [width / 2 + ((longitude - frame.origin.longitude_deg) * perLongitude - centre[0]) * scale, height / 2 - ((latitude - frame.origin.latitude_deg) * perLatitude - centre[1]) * scale];
    const circumference = 2 * Math.PI * SEMI_MAJOR_M * Math.cos(radians(frame.origin.latitude_deg));
    const zoom = Math.max(0, Math.min(MOST_ZOOM, Math.round(Math.log2((circumference * scale) / TILE_PX))));
    const [first, last] = [tileOf(toPlace([0, 0]), zoom), tileOf(toPlace([width, height]), zoom)];
    const images = [];
    for (let column = Math.floor(first[0]); column <= last[0]; column++) {
      for (let row = Math.floor(first[1]); row <= last[1]; row++) {
        const [[x, y], [right, bottom]] = [toPx(placeOf([column, row], zoom)), toPx(placeOf([column + 1, row + 1], zoom))];
        const href = url.replace("{z}", zoom).replace("{x}", column).replace("{y}", row);
        images.push(s("image", { href, x, y, width: right - x + 0.5, height: bottom - y + 0.5, preserveAspectRatio: "none" }));
      }
    }
    return images;
  }

  showPlaces(landings) {
    const { frame, start, targets } = this.site;
    this.facts.textContent = `Plane with +x to ${number(frame.azimuth_deg, 1)}° from north; z = 0 at ${number(frame.origin.altitude_amsl_m, 1)} m above mean sea level.`;
    const places = [["origin", [0, 0], 0], ["start", [start.x_m, 0], start.z_m], ...targets.map((target) => [target.name, [target.x_m, 0], target.z_m]), ...landings];
    if (this.aircraft) places.push(["aircraft", [this.aircraft[0], this.aircraft[1]], this.aircraft[2]]);
    const rows = places.map(([name, place, z]) => [name, ...geodetic(frame, place).map((value) => value.toFixed(6)), number(frame.origin.altitude_amsl_m + z, 1)]);
    replaceWhen(this.places, rows, () => [table(["", "latitude", "longitude", "AMSL, m"], rows)]);
  }
}

function north(width) {
  const x = width - 26;
  return [s("path", { class: "line scale", d: `M${x} 44V16l-6 9M${x} 16l6 9` }), s("text", { x, y: 58, "text-anchor": "middle" }, "N")];
}
