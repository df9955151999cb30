// Requests to the service.

/** An answer that is no success: its status of HTTP, and the service's one line. */
export class Refused extends Error {
  constructor(status, problem) {
    super(problem ?? `the service answered ${status}`);
    this.status = status;
  }
}

async function answer(response) {
  const text = await response.text();
  let document = {};
  try {
    document = JSON.parse(text);
  } catch {
    if (response.ok) throw new Refused(response.status);
  }
  if (!response.ok) throw new Refused(response.status, document.problem);
  return document;
}

export async function get(path, options = {}) {
  return answer(await fetch(path, { cache: "no-store", ...options }));
}

export async function post(path, document, headers = {}) {
  const body = JSON.stringify(document);
  return answer(await fetch(path, { method: "POST", body, headers: { "Content-Type": "application/json", ...headers } }));
}

const TOKEN = "moar-token";

/** Takes the token of an address that sitl/fly has opened, and removes it from the address line. */
export function takeToken() {
  const given = new URLSearchParams(location.hash.slice(1)).get("token");
  if (given === null) return;
  sessionStorage.setItem(TOKEN, given);
  history.replaceState(null, "", location.pathname);
}

export function token() {
  return sessionStorage.getItem(TOKEN) ?? "";
}

export function authorization() {
  return { Authorization: `Bearer ${token()}` };
}

/**
 * Asks before an action, and for the token where none is known. Returns true for "yes".
 * title: the action as a question; text: its effect; button: the word of its button.
 */
export function confirmed(title, text, button, { withToken = true } = {}) {
  const dialog = document.getElementById("confirm");
  const field = document.getElementById("confirm-token");
  document.getElementById("confirm-title").textContent = title;
  document.getElementById("confirm-text").textContent = text;
  document.getElementById("confirm-ok").textContent = button;
  document.getElementById("confirm-token-row").hidden = !withToken;
  field.value = token();
  dialog.returnValue = "cancel";
  dialog.showModal();
  (withToken && !field.value ? field : document.getElementById("confirm-ok")).focus();
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => {
      const yes = dialog.returnValue === "ok";
      if (yes && withToken) sessionStorage.setItem(TOKEN, field.value.trim());
      resolve(yes);
    }, { once: true });
  });
}

/** Sends one request at a time; of those that come meanwhile only the newest. */
export class Newest {
  constructor(send, received, failed) {
    Object.assign(this, { send, received, failed, busy: false, next: null });
  }

  async ask(request) {
    this.next = request;
    if (this.busy) return;
    this.busy = true;
    while (this.next) {
      const current = this.next;
      this.next = null;
      try {
        const found = await this.send(current);
        this.received(found, current, this.next === null);
      } catch (error) {
        this.failed(error, current);
      }
    }
    this.busy = false;
  }
}
