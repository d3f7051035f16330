// What carries bytes between the page and one hub, or device: one operation at a time, as a browser does.

export const bytesOf = (digits) => Uint8Array.from(digits.match(/../g) ?? [], (byte) => parseInt(byte, 16));
export const digitsOf = (view) => Array.from(new Uint8Array(view.buffer, view.byteOffset, view.byteLength), (byte) => byte.toString(16).padStart(2, "0")).join("");

// A kind of it has `choose(options)`, `isConnected`, `perform(request)` and `disconnect()`.
export class Link {
  // `on`: functions event(digits), lost().
  constructor(on) {
    this.on = on;
    this.device = null; // that a person has chosen
    this.waiting = [];
    this.atWork = null; // that whose answer is waited for
  }

  // What was in flight may never have an answer of the browser's, or a late one, which nobody hears any more.
  lose() {
    this.giveUp("the link is lost", ({ request }) => request.operation !== "connect");
    this.on.lost();
  }

  // An operation of Python's; resolves to its answer, always. One that is urgent comes before others that wait.
  do(request, isUrgent = false) {
    if (request.operation === "close") return this.close();
    return new Promise((resolve) => {
      if (isUrgent) this.waiting.unshift({ request, resolve });
      else this.waiting.push({ request, resolve });
      this.work();
    });
  }

  async work() {
    while (this.waiting.length && !this.atWork) {
      const entry = (this.atWork = this.waiting.shift());
      try {
        entry.resolve((await this.perform(entry.request)) ?? {});
      } catch (error) {
        entry.resolve({ error: error.name ?? "Error", message: String(error.message ?? error) });
      }
      if (this.atWork !== entry) return; // it was given up meanwhile
      this.atWork = null;
    }
  }

  // Give up all that waits, also what a browser never answers.
  async close() {
    this.giveUp("the connection was given up", () => true);
    await this.disconnect();
    return {};
  }

  giveUp(message, isGiven) {
    const given = [this.atWork, ...this.waiting].filter((entry) => entry && isGiven(entry));
    if (given.includes(this.atWork)) this.atWork = null;
    this.waiting = this.waiting.filter((entry) => !given.includes(entry));
    for (const { resolve } of given) resolve({ error: "NetworkError", message });
    this.work();
  }
}
