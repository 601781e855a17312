// The connections to the server: two WebSockets that come back by themselves, and requests with the token.
// @ts-check

/** The token stands behind the '#', which no browser sends anywhere. */
export const token = () => location.hash.slice(1);

const BYTES = 18;

/**
 * A name of this page, known to the server alone. A reload keeps it, and with it the controls; a duplicated tab, which
 * copies the session, does not: while a page is open its name is not in there.
 */
export const client =
  sessionStorage.getItem("client") ??
  Array.from(crypto.getRandomValues(new Uint8Array(BYTES)), (byte) => byte.toString(16).padStart(2, "0")).join("");
sessionStorage.removeItem("client");
window.addEventListener("pagehide", () => sessionStorage.setItem("client", client));

export class Refusal extends Error {
  /** @param {number} status @param {{code: string, message: string, problems?: any[], choice?: any}} error */
  constructor(status, error) {
    super(error.message);
    this.status = status;
    this.code = error.code;
    this.problems = error.problems ?? [];
    /** What it leaves to choose. @type {{reason: string, remedies: import("./refusal.js").Remedy[], help?: string, force: boolean} | null} */
    this.choice = error.choice ?? null;
  }
}

/**
 * POST to the server.
 * @param {string} name
 * @param {any} body JSON, or what `type` says
 * @param {{type?: string, headers?: Record<string, string>}} [options]
 * @returns {Promise<Response>}
 */
export async function request(name, body, options = {}) {
  const type = options.type ?? "application/json";
  const reply = await fetch(`/api/${name}`, {
    method: "POST",
    headers: { Authorization: `Bearer ${token()}`, "Content-Type": type, "X-Client": client, ...options.headers },
    body: options.type ? body : JSON.stringify(body),
  });
  if (!reply.ok) {
    const answer = await reply.json().catch(() => ({ error: { code: "http", message: `HTTP ${reply.status}` } }));
    throw new Refusal(reply.status, answer.error);
  }
  return reply;
}

/** The same, with a JSON answer. @param {string} name @param {any} [body] @returns {Promise<any>} */
export async function ask(name, body = {}) {
  return (await request(name, body)).json();
}

const RETRY_MS = 500;
const BAD_TOKEN = 4401;

/**
 * A WebSocket that comes back.
 * @param {"rows" | "state"} name
 * @param {(data: any) => void} take
 * @param {(open: boolean, why: string) => void} changed
 */
export function follow(name, take, changed) {
  const socket = new WebSocket(`ws${location.protocol === "https:" ? "s" : ""}://${location.host}/ws/${name}`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    socket.send(JSON.stringify({ token: token(), client }));
    changed(true, "");
  };
  socket.onmessage = (event) => take(event.data);
  socket.onclose = (event) => {
    changed(false, event.code === BAD_TOKEN ? event.reason : "the scope's server does not answer; is 'hapticd scope' still running?");
    setTimeout(() => follow(name, take, changed), event.code === BAD_TOKEN ? 10 * RETRY_MS : RETRY_MS);
  };
  return socket;
}
