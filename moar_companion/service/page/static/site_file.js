// A site as a file, and a state as a part of an address.

const KEY = /^[A-Za-z_][A-Za-z0-9_]*$/;

function flow(value) {
  if (Array.isArray(value)) return `[${value.map(flow).join(", ")}]`;
  if (value !== null && typeof value === "object") {
    return `{${Object.entries(value).map(([key, item]) => `${KEY.test(key) ? key : JSON.stringify(key)}: ${flow(item)}`).join(", ")}}`;
  }
  if (typeof value === "number" && Number.isFinite(value)) return String(Math.round(value * 1e7) / 1e7);
  return JSON.stringify(value);
}

/** The text of a site file: one line for each obstacle, target and landing point. */
export function siteFileText(site) {
  const lines = [];
  for (const [key, value] of Object.entries(site)) {
    if (Array.isArray(value) && value.length) {
      lines.push(`${key}:`, ...value.map((item) => `  - ${flow(item)}`));
    } else if ((key === "targets" || key === "landing") && Object.keys(value).length) {
      lines.push(`${key}:`, ...Object.entries(value).map(([name, item]) => `  ${JSON.stringify(name)}: ${flow(item)}`));
    } else {
      lines.push(`${key}: ${flow(value)}`);
    }
  }
  return `${lines.join("\n")}\n`;
}

async function through(bytes, stream) {
  return new Uint8Array(await new Response(new Blob([bytes]).stream().pipeThrough(stream)).arrayBuffer());
}

/** A value as text for an address: JSON, deflated, in base64url. */
export async function toAddress(value) {
  const packed = await through(new TextEncoder().encode(JSON.stringify(value)), new CompressionStream("deflate-raw"));
  const letters = Array.from(packed, (byte) => String.fromCharCode(byte)).join("");
  return btoa(letters).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
}

/** The value of such a text; null for any other text. */
export async function fromAddress(text) {
  try {
    const letters = atob(text.replaceAll("-", "+").replaceAll("_", "/"));
    const packed = Uint8Array.from(letters, (letter) => letter.charCodeAt(0));
    return JSON.parse(new TextDecoder().decode(await through(packed, new DecompressionStream("deflate-raw"))));
  } catch {
    return null;
  }
}
