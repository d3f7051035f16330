// Mailbox in memory that the page and a worker share: the way in for what happens while a program runs. Where the browser
// gives no such memory (the page is not isolated), there is no mailbox, and a run goes as fast as it can.

const SIGNAL = 0, ALLOWED_MS = 1, HEAD = 2, TAIL = 3, HEADER_BYTES = 32, RING_BYTES = 1 << 16, LENGTH_BYTES = 4;

export class Mailbox {
  constructor(memory) {
    this.memory = memory;
    this.numbers = new Int32Array(memory, 0, HEADER_BYTES / 4);
    this.ring = new Uint8Array(memory, HEADER_BYTES, RING_BYTES);
  }

  static isPossible() {
    return typeof SharedArrayBuffer === "function" && globalThis.crossOriginIsolated === true;
  }

  static create() {
    return new Mailbox(new SharedArrayBuffer(HEADER_BYTES + RING_BYTES));
  }

  // The page: a message for the program; false if the box is full.
  send(message) {
    const text = new TextEncoder().encode(JSON.stringify(message)), head = this.numbers[HEAD];
    const used = (head - Atomics.load(this.numbers, TAIL) + RING_BYTES) % RING_BYTES;
    if (used + LENGTH_BYTES + text.length >= RING_BYTES) return false;
    const length = new Uint8Array(new Uint32Array([text.length]).buffer);
    [...length, ...text].forEach((byte, i) => (this.ring[(head + i) % RING_BYTES] = byte));
    Atomics.store(this.numbers, HEAD, (head + LENGTH_BYTES + text.length) % RING_BYTES);
    this.signal();
    return true;
  }

  // The page: how far simulated time may go.
  allow(ms) {
    if (Atomics.exchange(this.numbers, ALLOWED_MS, Math.min(ms, 0x7fffffff)) !== ms) this.signal();
  }

  signal() {
    Atomics.add(this.numbers, SIGNAL, 1);
    Atomics.notify(this.numbers, SIGNAL);
  }

  // Before a run: what was meant for the last one is forgotten.
  empty() {
    Atomics.store(this.numbers, TAIL, Atomics.load(this.numbers, HEAD));
  }

  // The worker: all messages that have come, as a JSON list; "" for none.
  take() {
    const head = Atomics.load(this.numbers, HEAD), messages = [];
    let tail = this.numbers[TAIL];
    if (head === tail) return "";
    const bytes = (count) => {
      const copy = Uint8Array.from({ length: count }, (_, i) => this.ring[(tail + i) % RING_BYTES]);
      tail = (tail + count) % RING_BYTES;
      return copy;
    };
    while (tail !== head) {
      const [length] = new Uint32Array(bytes(LENGTH_BYTES).buffer);
      messages.push(new TextDecoder().decode(bytes(length)));
    }
    Atomics.store(this.numbers, TAIL, tail);
    return `[${messages.join(",")}]`;
  }

  // The worker: waits until something has come, at most so long.
  wait(longest_ms) {
    const seen = Atomics.load(this.numbers, SIGNAL);
    if (Atomics.load(this.numbers, HEAD) === this.numbers[TAIL]) Atomics.wait(this.numbers, SIGNAL, seen, longest_ms);
  }

  // The worker: whether the page's clock has reached a time; waits a little until it has, or something comes.
  mayGoOn(ms, patience_ms) {
    const seen = Atomics.load(this.numbers, SIGNAL);
    if (Atomics.load(this.numbers, ALLOWED_MS) >= ms) return true;
    if (Atomics.load(this.numbers, HEAD) === this.numbers[TAIL]) Atomics.wait(this.numbers, SIGNAL, seen, patience_ms);
    return Atomics.load(this.numbers, ALLOWED_MS) >= ms;
  }
}
