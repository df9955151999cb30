// The page: its views by the address, colours, the connection.
import { setAttribute, setText } from "./dom.js";
import { LiveView } from "./live.js";
import { MapView } from "./map.js";
import { PlaybackView } from "./playback.js";
import { get, takeToken } from "./server.js";
import { WhatIfView } from "./what_if.js";

const THEMES = { auto: "as the system", light: "light", dark: "dark" };
const KEY = "moar-theme";
const system = matchMedia("(prefers-color-scheme: dark)");
const FIRST = { service: "live", site: "what-if", recording: "recordings" };
const SHOWN = { service: ["live", "what-if", "recordings", "map"], site: ["what-if", "map"], recording: ["recordings", "what-if", "map"] };

let view = null;

function applyTheme(choice) {
  const dark = choice === "dark" || (choice === "auto" && system.matches);
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  const button = document.getElementById("theme");
  for (const name of ["title", "aria-label"]) setAttribute(button, name, `Theme: ${THEMES[choice]}`);
  for (const each of [view?.plane, view?.view?.plane]) each?.recolour();
}

function themeChoice() {
  return THEMES[localStorage.getItem(KEY)] ? localStorage.getItem(KEY) : "auto";
}

function connection(words, bad) {
  const element = document.getElementById("connection");
  setText(element, words);
  setAttribute(element, "class", bad ? "connection bad" : "connection");
  setAttribute(element, "role", bad ? "alert" : null);
}

class Page {
  constructor(page) {
    this.page = page;
    this.views = {};
    this.shown = SHOWN[page.kind].filter((name) => name !== "what-if" || page.what_if);
    for (const name of SHOWN.service) document.getElementById(`tab-${name}`).hidden = !this.shown.includes(name);
    addEventListener("hashchange", () => this.route());
  }

  make(name) {
    const { page } = this;
    if (name === "live") return new LiveView(page, connection, (...track) => this.moved(track));
    if (name === "what-if") return new WhatIfView(connection, (address) => history.replaceState(null, "", `#what-if=${address}`));
    if (name === "recordings") return new PlaybackView(page, connection, (...track) => this.moved(track));
    return new MapView(connection, page);
  }

  async route() {
    const [wanted, ...rest] = location.hash.slice(1).split("=");
    const name = this.shown.includes(wanted) ? wanted : FIRST[this.page.kind];
    if (view && view === this.views[name] && name === "what-if" && !rest.length) return;
    view?.close();
    const follows = this.page.kind === "service" && (name === "live" || name === "map");
    if (follows) this.views.live ??= this.make("live");
    this.views[name] ??= this.make(name);
    view = this.views[name];
    document.getElementById("view").replaceChildren(view.element);
    for (const each of SHOWN.service) setAttribute(document.getElementById(`tab-${each}`), "aria-current", each === name ? "page" : null);
    try {
      if (name === "map" && !follows) this.views.map.show(...(this.track ?? [await get("api/site").catch(() => null), [], null]));
      if (follows) await this.views.live.open();
      if (name !== "live") await view.open(decodeURIComponent(rest.join("=")));
    } catch (error) {
      connection(error.message, true);
    }
  }

  /** track: the site, where the aircraft was, and where it is. */
  moved(track) {
    this.track = track;
    if (view === this.views.map) view.show(...track);
  }
}

takeToken();
applyTheme(themeChoice());
system.addEventListener("change", () => applyTheme(themeChoice()));
document.getElementById("theme").addEventListener("click", () => {
  const choices = Object.keys(THEMES);
  localStorage.setItem(KEY, choices[(choices.indexOf(themeChoice()) + 1) % choices.length]);
  applyTheme(themeChoice());
});
try {
  const page = await get("api/page");
  const site = await get("api/site").catch(() => null);
  setText(document.getElementById("site-name"), site?.site.name ?? page.recording ?? "");
  document.title = `${site?.site.name ?? "flight"} - moar-companion`;
  await new Page(page).route();
} catch (error) {
  connection(`No connection to the service: ${error.message}`, true);
}
