// The triangle of the weights k_S, k_T, k_E: where they are, and which path is optimal where.
import { replaceWhen, s, setAttribute } from "./dom.js";

const CORNERS = { safety: [100, 16], time: [14, 160], energy: [186, 160] };
const NAMES = ["safety", "time", "energy"];

function place(weights) {
  return [0, 1].map((axis) => NAMES.reduce((sum, name) => sum + weights[name] * CORNERS[name][axis], 0));
}

/** The weights at a place; outside the triangle those of its nearest border. */
function weightsAt([x, y]) {
  const height = CORNERS.time[1] - CORNERS.safety[1];
  const width = CORNERS.energy[0] - CORNERS.time[0];
  const safety = Math.min(1, Math.max(0, (CORNERS.time[1] - y) / height));
  const left = CORNERS.time[0] + (safety * width) / 2;
  const along = (1 - safety) * width;
  const energy = along ? Math.min(1, Math.max(0, (x - left) / along)) * (1 - safety) : 0;
  return { safety, time: Math.max(0, 1 - safety - energy), energy };
}

/** Colour of a path of the front by its place in it: from the safest to the fastest, in turn lighter. */
function frontColour(index, count) {
  const share = count > 1 ? Math.round((100 * index) / (count - 1)) : 0;
  const mixed = `color-mix(in oklab, var(--accent) ${share}%, rgb(var(--safety)))`;
  return `color-mix(in oklab, ${mixed} ${[78, 52, 65][index % 3]}%, var(--panel))`;
}

export class WeightTriangle {
  /** changed(weights): of a drag; absent: it only shows. chosen(index): a click on a path. */
  constructor(label, { changed = null, chosen = null } = {}) {
    this.chosen = chosen;
    this.regions = s("g");
    this.marks = s("g");
    this.svg = s(
      "svg",
      { class: "triangle", viewBox: "0 0 200 184", role: changed ? "group" : "img", "aria-label": label },
      this.regions,
      s("path", { class: "edge", d: "M100 16L14 160H186Z" }),
      s("text", { x: 100, y: 11, "text-anchor": "middle" }, "safety"),
      s("text", { x: 4, y: 177 }, "time"),
      s("text", { x: 196, y: 177, "text-anchor": "end" }, "energy"),
      this.marks,
    );
    if (changed) this.addHandle(changed);
  }

  /** base, adjusted: weights before and after the risks. */
  show(base, adjusted) {
    this.base = base;
    replaceWhen(this.marks, [base, adjusted], () => {
      const [from, to] = [place(base), place(adjusted)];
      return [
        s("line", { class: "shift", x1: from[0], y1: from[1], x2: to[0], y2: to[1] }),
        s("circle", { class: "base", cx: from[0], cy: from[1], r: 5 }),
        s("circle", { class: "adjusted", cx: to[0], cy: to[1], r: 6 }),
      ];
    });
    if (this.handle) {
      const [x, y] = place(base);
      setAttribute(this.handle, "transform", `translate(${x} ${y})`);
      const words = NAMES.map((name) => `${name} ${base[name].toFixed(2)}`).join(", ");
      setAttribute(this.handle, "aria-label", `base weights: ${words}. Arrow keys move them.`);
    }
  }

  /** front: [{region: [[k_S, k_T, k_E]]}]; shown: index of the chosen path, or null. */
  showFront(front, shown) {
    replaceWhen(this.regions, [front.map((point) => point.region), shown], () =>
      front
        .map((point, index) => [index, point])
        .sort((a, b) => (a[0] === shown) - (b[0] === shown))
        .map(([index, point]) => {
          const corners = point.region.map(([safety, time, energy]) => place({ safety, time, energy }).map((value) => value.toFixed(2)).join());
          const region = s("polygon", { class: index === shown ? "region shown" : "region", points: corners.join(" "), onclick: () => this.chosen?.(index) });
          region.style.fill = frontColour(index, front.length);
          return region;
        }),
    );
  }

  addHandle(changed) {
    this.handle = s("g", { class: "handle", tabindex: "0", role: "button" }, s("circle", { class: "ring", r: 13 }));
    this.svg.append(this.handle);
    const at = (event) => {
      const box = this.svg.getBoundingClientRect();
      return weightsAt([((event.clientX - box.left) / box.width) * 200, ((event.clientY - box.top) / box.height) * 184]);
    };
    this.handle.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      this.handle.focus();
      this.svg.setPointerCapture(event.pointerId);
      const move = (moved) => changed(at(moved));
      const end = (last) => {
        this.svg.removeEventListener("pointermove", move);
        changed(at(last));
      };
      this.svg.addEventListener("pointermove", move);
      this.svg.addEventListener("pointerup", end, { once: true });
      this.svg.addEventListener("pointercancel", end, { once: true });
    });
    this.handle.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: [-4, 0], ArrowRight: [4, 0], ArrowUp: [0, -4], ArrowDown: [0, 4] }[event.key];
      if (!by) return;
      event.preventDefault();
      const [x, y] = place(this.base);
      changed(weightsAt([x + by[0], y + by[1]]));
    });
  }
}
