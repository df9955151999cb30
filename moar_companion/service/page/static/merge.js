// JSON Merge Patch (RFC 7396): a state, and what changed in it.

/** The state with a patch: null removes, objects merge, all else replaces. */
export function merged(state, patch) {
  if (patch === null || typeof patch !== "object" || Array.isArray(patch)) return patch;
  const base = state !== null && typeof state === "object" && !Array.isArray(state) ? state : {};
  const result = { ...base };
  for (const [key, value] of Object.entries(patch)) {
    if (value === null) delete result[key];
    else result[key] = merged(base[key], value);
  }
  return result;
}
