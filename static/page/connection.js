// The socket to the server: comes back by itself, says so, and drops nothing silently; requests, and questions.

const FIRST_WAIT_MS = 300;
const LONGEST_WAIT_MS = 5000;

const nothing = () => null;

/** The answer to a request; null without a connection. @returns {Promise<Response | null>} */
export const ask = (/** @type {string} */ address, /** @type {RequestInit} */ options = {}) =>
  fetch(address, options).catch(nothing);

/** What the server says, with the units as people write them. */
const parsed = (/** @type {string} */ text) => JSON.parse(text.replaceAll(" cm2", " cm²"));

/** What a request is answered with; null without a connection, or if it is refused. */
export async function askJson(/** @type {string} */ address) {
  const answer = await ask(address);
  return answer?.ok ? answer.text().then(parsed).catch(nothing) : null;
}

/** The picture at an address; null if it cannot be had. @returns {Promise<ImageBitmap | null>} */
export async function askPicture(/** @type {string} */ address) {
  const answer = await ask(address);
  return answer?.ok ? answer.blob().then(createImageBitmap).catch(nothing) : null;
}

/** Send an object as JSON; null without a connection. */
export const post = (/** @type {string} */ address, /** @type {object} */ message) =>
  ask(address, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(message) });

/**
 * @typedef {object} ConnectionHandlers
 * @property {(message: ServerMessage) => void} message
 * @property {(again: boolean) => void} opened
 * @property {(seconds: number, refusal: string | null) => void} lost with the time until the next attempt; again
 *   with why the socket is refused, if something answers
 */

export class Connection {
  constructor(/** @type {ConnectionHandlers} */ handlers) {
    this.handlers = handlers;
    this.wait = FIRST_WAIT_MS;
    this.openedBefore = false;
    this.socket = this.open();
  }

  open() {
    const address = new URL("ws", document.baseURI);
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(address);
    socket.onopen = () => {
      this.wait = FIRST_WAIT_MS;
      this.handlers.opened(this.openedBefore);
      this.openedBefore = true;
    };
    socket.onmessage = ({ data }) => this.handlers.message(parsed(data));
    socket.onclose = () => {
      this.handlers.lost(this.wait / 1000, null);
      void this.explain(this.wait / 1000);
      setTimeout(() => (this.socket = this.open()), this.wait);
      this.wait = Math.min(2 * this.wait, LONGEST_WAIT_MS);
    };
    return socket;
  }

  /** Browsers do not tell why a socket is refused: a request to its address is answered in words. */
  async explain(/** @type {number} */ seconds) {
    const answer = await ask("ws", { method: "POST" });
    const isOurs = answer?.headers.get("Content-Type")?.startsWith("text/plain");
    // A program that has just come back answers too; it lets the next attempt in.
    if (!answer || (isOurs ? answer.status !== 403 && this.openedBefore : answer.status >= 500)) return;
    const refusal = isOurs ? await answer.text() : `A proxy answers ${answer.status} for ${answer.url}.`;
    if (this.socket.readyState !== WebSocket.OPEN) this.handlers.lost(seconds, refusal);
  }

  /** Send a message; returns false if there is no connection. */
  send(/** @type {ClientMessage} */ message) {
    if (this.socket.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }
}

/**
 * What is known of something that has another address whenever it changes: asked for once, the latest alone counts.
 * @template T
 */
export class Fetched {
  /**
   * @param {(address: string) => Promise<T | null>} ask
   * @param {() => void} changed called when an answer has come
   */
  constructor(ask, changed) {
    this.ask = ask;
    this.changed = changed;
    this.address = /** @type {string | null} */ (null);
    this.value = /** @type {T | null} */ (null); // null until the answer is there
  }

  /** Ask for what an address has, unless it is the last one; null: nothing is wanted. */
  want(/** @type {string | null} */ address) {
    if (address === this.address) return;
    this.address = address;
    this.value = null;
    if (address !== null) void this.fetch(address);
  }

  async fetch(/** @type {string} */ address) {
    const value = await this.ask(address);
    if (this.address !== address) return;
    this.value = value;
    if (value === null)
      this.address = null; // it is asked for again when it is wanted the next time
    else this.changed();
  }
}

/**
 * One question at a time, always about the latest thing: what is asked meanwhile replaces what waits.
 * @template About @template {{ id: number }} Answer
 */
export class Question {
  /**
   * @param {(id: number, about: About) => boolean} send tells whether it was sent
   * @param {(answer: Answer) => void} take gets the answers about what was asked last
   */
  constructor(send, take, pauseMs = 0) {
    this.send = send;
    this.take = take;
    this.pauseMs = pauseMs; // from an answer to the next question
    this.id = 0;
    this.busy = false;
    this.wanted = /** @type {About | null} */ (null);
  }

  ask(/** @type {About} */ about) {
    this.wanted = about;
    this.next();
  }

  next() {
    if (this.busy || this.wanted === null) return;
    this.id += 1;
    this.busy = this.send(this.id, this.wanted);
    this.wanted = null;
  }

  answered(/** @type {Answer} */ answer) {
    if (answer.id === this.id) this.take(answer);
    if (this.pauseMs) setTimeout(() => this.free(), this.pauseMs);
    else this.free();
  }

  free() {
    this.busy = false;
    this.next();
  }

  /** What waits is not asked, and what is on its way is about nothing. */
  drop() {
    this.wanted = null;
    this.id += 1;
  }

  /** The connection was lost, or something was refused: what was asked may never be answered. */
  lost() {
    this.busy = false;
  }
}
