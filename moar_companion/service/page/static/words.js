// Numbers and states as words: the contracts' words, for people.

export const UNKNOWN = "unknown";
const AUTOPILOT_SILENT_S = 3;
/** Speed above which an aircraft that holds has not stopped yet; wind moves one at rest by less. */
const BRAKING_MPS = 0.5;

export function isKnown(value) {
  return value !== null && value !== undefined;
}

/** A number with its unit; unknown is never 0. */
export function number(value, digits = 1, unit = "") {
  if (!isKnown(value)) return UNKNOWN;
  return `${value.toFixed(digits)}${unit}`;
}

export function duration(seconds) {
  if (!isKnown(seconds)) return UNKNOWN;
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  if (seconds < 100) return `${Math.round(seconds)} s`;
  const whole = Math.round(seconds);
  return `${Math.floor(whole / 60)} min ${String(whole % 60).padStart(2, "0")} s`;
}

export function percent(share) {
  return !isKnown(share) ? UNKNOWN : `${Math.round(100 * share)} %`;
}

export function clock(seconds) {
  return new Date(1e3 * seconds).toISOString().slice(11, 19) + " UTC";
}

export function dateAndClock(seconds) {
  return `${new Date(1e3 * seconds).toISOString().slice(0, 10)} ${clock(seconds)}`;
}

export function bytes(count) {
  return count < 1e6 ? `${Math.max(1, Math.round(count / 1e3))} kB` : `${(count / 1e6).toFixed(1)} MB`;
}

export function plain(word) {
  return String(word).replaceAll("_", " ");
}

export function capital(text) {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

/** The goal of a mission: a target by name, or a landing point by number. */
export function goalWords(mission, goal) {
  if (mission === "inspection") return isKnown(goal) ? String(goal) : "every target";
  return !isKnown(goal) ? "the nearest landing point" : `landing point ${goal}`;
}

/** What a hold adds while the aircraft still moves. */
function braking(speed_mps) {
  return speed_mps > BRAKING_MPS ? `, braking: ${number(speed_mps, 1, " m/s")}` : "";
}

/** What the aircraft does, as a headline. */
export function headline(status) {
  const { state, mission, goal } = status.mission;
  const to = isKnown(mission) ? ` ${mission} to ${goalWords(mission, goal)}` : "";
  const mode = status.autopilot?.kind === "ardupilot" ? "GUIDED" : "OFFBOARD";
  switch (state) {
    case "flying":
      return `Flying${to}`;
    case "at_target":
      return `At target ${goal ?? ""}`.trim();
    case "landing_leg":
      return `Landing leg${isKnown(mission) ? ` of the ${mission}` : ""}`;
    case "holding":
      return (isKnown(goal) ? `Holding on the way to ${goalWords(mission, goal)}` : "Holding position") + braking(status.aircraft?.speed_mps);
    case "planning":
      return `Planning${to}`;
    case "ready":
      return `Ready${to ? ` for${to}` : " to hold"}: select ${mode}`;
    case "overridden":
      return `Overridden: ${status.autopilot?.mode ?? "another mode"} has control`;
    case "released":
      return "Released: the autopilot has control";
    case "idle":
      return "Idle: no setpoints are sent";
    default:
      return isKnown(state) ? capital(plain(state)) : "The companion is not in this recording";
  }
}

/** True if the last report of the autopilot is old: it sends one a second. */
export function isSilent(autopilot) {
  return (autopilot?.age_s ?? 0) > AUTOPILOT_SILENT_S;
}

/** Who moves the aircraft now. */
export function controlWords(status) {
  const autopilot = status.autopilot;
  if (!autopilot) return "No autopilot is received";
  const armed = !isKnown(autopilot.armed) ? "arming unknown" : autopilot.armed ? "armed" : "disarmed";
  if (isSilent(autopilot)) return `${autopilot.mode}, ${armed} ${duration(autopilot.age_s)} ago; no report since`;
  if (!isKnown(autopilot.ours)) return `${autopilot.mode ?? "mode unknown"}, ${armed}`;
  const who = autopilot.ours && status.path ? "the companion steers" : "the companion does not steer";
  return `${autopilot.mode}, ${armed}: ${who}`;
}

const ACTIONS = {
  continue: "Note",
  slow: "Slows down",
  hold: "Holds",
  leave: "Leaves this place",
  exit: "Exits",
  evacuation: "Evacuates",
  release: "Gives up control",
};

/** What the companion does by a condition. */
export function actionWords(action) {
  return ACTIONS[action] ?? capital(plain(action));
}

/** What the setpoint gate did last, and why; a reason that names its limit needs it no second time. */
export function gateWords(gate) {
  if (!gate) return "none so far";
  const limit = isKnown(gate.limit) && !gate.reason.includes(">") ? ` (limit ${number(gate.limit, 2)} ${gate.unit})` : "";
  const act = gate.action === "ended" ? "stopped sending setpoints" : "held at the last good setpoint";
  return `${duration(gate.age_s)} ago, ${act}: ${gate.reason}${limit}`;
}

/** Grade of a condition's action: note, caution or warning. */
export function grade(action) {
  if (action === "continue") return "note";
  return action === "slow" || action === "hold" ? "caution" : "warning";
}

/** Grade of a risk index, as in the terminal's view. */
export function riskGrade(value) {
  return value >= 0.8 ? "warning" : value >= 0.5 ? "caution" : "note";
}

/** An action as what a named agent does: "hold" becomes "PX4 holds". */
export function actsWords(agent, action) {
  const [verb, ...rest] = action.split(" ");
  return [agent, verb === "go" ? "goes" : `${verb}s`, ...rest].join(" ");
}

/** Name of an autopilot's kind, as its makers write it. */
export function autopilotName(kind) {
  return { px4: "PX4", ardupilot: "ArduPilot" }[kind] ?? "the autopilot";
}

/** Reason of a plan, where its short text for pilots is no sentence. */
export function reasonWords(reason) {
  const wider = /^obstacles wider by (.+) -> (.+) m$/.exec(reason);
  if (!wider) return reason.replaceAll("->", "→");
  return `the position's uncertainty: margin for its error ${wider[1]} m → ${wider[2]} m`;
}
