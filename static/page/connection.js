// The socket to the server: comes back by itself, says so, and drops nothing silently.

const FIRST_WAIT_MS = 300;
const LONGEST_WAIT_MS = 5000;

/** The answer to a request; null without a connection. @returns {Promise<Response | null>} */
export const ask = (/** @type {string} */ address, /** @type {RequestInit} */ options = {}) =>
  fetch(address, options).catch(/** @returns {null} */ () => null);

export class Connection {
  /** `handlers`: message(object), frame(buffer), opened(again), lost(seconds until the next attempt). */
  constructor(/** @type {any} */ handlers) {
    this.handlers = handlers;
    this.wait = FIRST_WAIT_MS;
    this.openedBefore = false;
    this.open();
  }

  open() {
    const address = new URL("/ws", location.href);
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    this.socket = new WebSocket(address);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => {
      this.wait = FIRST_WAIT_MS;
      this.handlers.opened(this.openedBefore);
      this.openedBefore = true;
    };
    this.socket.onmessage = ({ data }) => {
      if (typeof data === "string") this.handlers.message(JSON.parse(data));
      else this.handlers.frame(data);
    };
    this.socket.onclose = () => {
      this.handlers.lost(this.wait / 1000);
      setTimeout(() => this.open(), this.wait);
      this.wait = Math.min(2 * this.wait, LONGEST_WAIT_MS);
    };
  }

  /** Send a message; returns false if there is no connection. */
  send(/** @type {ClientMessage} */ message) {
    if (this.socket.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }
}
