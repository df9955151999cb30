const link = document.querySelector("#link");
const state = document.querySelector("#state");
let shown = {};

function merged(before, patch) {
  if (patch === null || typeof patch !== "object" || Array.isArray(patch)) return patch;
  const after = { ...(before && typeof before === "object" && !Array.isArray(before) ? before : {}) };
  for (const [name, value] of Object.entries(patch)) {
    if (value === null) delete after[name];
    else after[name] = merged(after[name], value);
  }
  return after;
}

function connect() {
  const socket = new WebSocket(`${location.protocol.replace("http", "ws")}//${location.host}/live`);
  socket.onopen = () => { link.textContent = "live"; };
  socket.onmessage = (event) => {
    const frame = JSON.parse(event.data);
    shown = frame.all ?? merged(shown, frame.changed);
    state.textContent = JSON.stringify(shown, null, 1);
  };
  socket.onclose = () => { link.textContent = "not connected"; setTimeout(connect, 1000); };
}

connect();
