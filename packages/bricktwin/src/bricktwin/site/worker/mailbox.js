// Mailbox in memory that the page and a worker share: the way in for what happens while a program runs. Where the browser
// gives no such memory (the page is not isolated), there is no mailbox, and a run goes as fast as it can.

const SIGNAL = 0, ALLOWED_MS = 1, HEAD = 2, TAIL = 3, CLOSED = 4, HEADER_BYTES = 32, RING_BYTES = 1 << 16, LENGTH_BYTES = 4;

const LATER_MS = 5; // between two looks for room
// One of each for all messages: while a worker runs a program, a browser is slow to free what it has beside the scripts' memory.
const ENCODER = new TextEncoder(), DECODER = new TextDecoder(), MOST_BYTES_OF_LETTER = 3;
let scratch = new Uint8Array(RING_BYTES);

// Memory for so many bytes, which the next call gives away again.
function scratchOf(bytes) {
  if (scratch.length < bytes) scratch = new Uint8Array(2 * bytes);
  return scratch;
}

export class Mailbox {
  constructor(memory) {
    this.memory = memory;
    this.numbers = new Int32Array(memory, 0, HEADER_BYTES / 4);
    this.ring = new Uint8Array(memory, HEADER_BYTES);
  }

  static isPossible() {
    return typeof SharedArrayBuffer === "function" && globalThis.crossOriginIsolated === true;
  }

  static create(bytes = RING_BYTES) {
    return new Mailbox(new SharedArrayBuffer(HEADER_BYTES + bytes));
  }

  // The page: a message for the program; false if the box is full.
  send(message) {
    return this.put(JSON.stringify(message));
  }

  // Who writes: a message that is JSON already.
  put(json) {
    const text = scratchOf(MOST_BYTES_OF_LETTER * json.length), length = ENCODER.encodeInto(json, text).written;
    const head = this.numbers[HEAD], size = this.ring.length;
    const used = (head - Atomics.load(this.numbers, TAIL) + size) % size;
    if (used + LENGTH_BYTES + length >= size) return false;
    for (let i = 0; i < LENGTH_BYTES; i++) this.ring[(head + i) % size] = length >>> (8 * i);
    const place = (head + LENGTH_BYTES) % size, untilEnd = Math.min(length, size - place);
    this.ring.set(text.subarray(0, untilEnd), place);
    this.ring.set(text.subarray(untilEnd, length), 0);
    Atomics.store(this.numbers, HEAD, (place + length) % size);
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

  // One worker to another: a message, once there is room for it. Nothing is kept for who reads no more.
  tell(json) {
    while (!this.isClosed && !this.put(json)) Atomics.wait(this.numbers, TAIL, Atomics.load(this.numbers, TAIL), LATER_MS);
  }

  get isClosed() {
    return Atomics.load(this.numbers, CLOSED) === 1;
  }

  close() {
    Atomics.store(this.numbers, CLOSED, 1);
    this.signal();
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
    const size = this.ring.length;
    while (tail !== head) {
      let length = 0;
      for (let i = 0; i < LENGTH_BYTES; i++) length |= this.ring[(tail + i) % size] << (8 * i);
      const place = (tail + LENGTH_BYTES) % size, untilEnd = Math.min(length, size - place), text = scratchOf(length);
      text.set(this.ring.subarray(place, place + untilEnd));
      text.set(this.ring.subarray(0, length - untilEnd), untilEnd);
      messages.push(DECODER.decode(text.subarray(0, length)));
      tail = (place + length) % size;
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
