// Hub in a tab: a worker with Python that runs one program at a time, and its end, however the program behaves.

import { Mailbox } from "./mailbox.js";

const PATIENCE_MS = 70, LAST_MS = 160, STOPPED_CODE = 130;
const SIGINT = 2;
const REAL_LAST_MS = 15_000; // a real hub is far away: what is asked of it takes time
const UNSTOPPABLE_S = 300; // without a way in, a run is computed at once, and has to end by itself

export class Hub {
  // `on`: functions ready(), happened(events, frames), ended(code), failed(text), ask(what Python wants of Bluetooth). `needsPhysics`:
  // whether a robot is expected, so that MuJoCo is there when it runs.
  constructor(on, needsPhysics = false) {
    this.on = on;
    this.needsPhysics = needsPhysics;
    this.hasWayIn = Mailbox.isPossible();
    this.spare = null;
    this.takeWorker();
  }

  get isReady() {
    return this.worker.isReady;
  }

  takeWorker() {
    this.worker = this.spare ?? this.makeWorker();
    this.spare = null;
    if (this.worker.isReady) this.on.ready();
  }

  makeWorker() {
    const worker = new Worker("./worker.js", { type: "module" });
    const entry = { worker, isReady: false, isRunning: false, mailbox: null, hubMailbox: null, interrupt: null };
    if (this.hasWayIn) {
      entry.mailbox = Mailbox.create();
      entry.hubMailbox = Mailbox.create();
      entry.interrupt = new Uint8Array(new SharedArrayBuffer(1));
    }
    worker.onmessage = ({ data }) => this.hear(entry, data);
    worker.onerror = (event) => this.hear(entry, { kind: "failed", text: event.message || "the worker has not started" });
    const { mailbox, hubMailbox, interrupt } = entry;
    worker.postMessage({ kind: "start", memory: mailbox?.memory, hubMemory: hubMailbox?.memory, interrupt, needsPhysics: this.needsPhysics });
    return entry;
  }

  hear(entry, message) {
    if (entry === this.spare) entry.isReady ||= message.kind === "ready";
    if (entry !== this.worker) return;
    if (message.kind === "ready") {
      entry.isReady = true;
      this.on.ready();
    } else if (message.kind === "happened") {
      this.on.happened(message.events ? JSON.parse(message.events) : [], message.frames);
    } else if (message.kind === "ask") this.on.ask(message);
    else if (message.kind === "ended") this.end(message.code);
    else if (message.kind === "failed") this.fail(message.text);
  }

  run(request) {
    this.needsPhysics = Boolean(request.robot);
    const entry = this.worker;
    entry.isRunning = true;
    entry.run = request; // that a late stop does not end the next one
    entry.isOnHub = Boolean(request.hub);
    entry.mailbox?.empty();
    if (!this.hasWayIn) {
      request = { ...request, time_limit_s: UNSTOPPABLE_S };
      this.spare ??= this.makeWorker();
    }
    entry.worker.postMessage({ kind: "run", request });
  }

  // How far simulated time may go, ms.
  allow(ms) {
    if (this.worker.isRunning) this.worker.mailbox?.allow(ms);
  }

  send(message) {
    if (this.worker.isRunning) this.worker.mailbox?.send(message);
  }

  // What happens at the real hub. False if Python does not hear it now: there is no room, or another run goes on.
  tell(message) {
    const entry = this.worker;
    if (!entry.isReady || (entry.isRunning && !entry.isOnHub)) return false;
    if (!entry.hubMailbox.send(message)) return false;
    if (!entry.isRunning) entry.worker.postMessage({ kind: "attend" });
    return true;
  }

  // First the hub's own way, then Python's, then the worker's end.
  stop() {
    const entry = this.worker;
    if (!entry.isRunning) return;
    if (!this.hasWayIn) return this.giveUp(entry);
    const run = entry.run, isStill = () => entry === this.worker && entry.isRunning && entry.run === run;
    if (entry.isOnHub) {
      entry.hubMailbox.send({ kind: "stop" });
      setTimeout(() => isStill() && this.giveUp(entry), REAL_LAST_MS);
      return;
    }
    entry.mailbox.send({ kind: "stop" });
    setTimeout(() => isStill() && (entry.interrupt[0] = SIGINT), PATIENCE_MS);
    setTimeout(() => isStill() && this.giveUp(entry), LAST_MS);
  }

  // Nobody needs this hub any more.
  leave() {
    this.worker.worker.terminate();
    this.spare?.worker.terminate();
  }

  giveUp(entry) {
    entry.worker.terminate();
    this.on.happened([{ kind: "err", ms: 0, text: "The program was stopped (SystemExit).\n" }], new Float32Array());
    this.end(STOPPED_CODE);
    this.takeWorker();
  }

  end(code) {
    this.worker.isRunning = false;
    if (this.worker.interrupt) this.worker.interrupt[0] = 0;
    this.on.ended(code);
  }

  fail(text) {
    const wasReady = this.worker.isReady;
    this.worker.worker.terminate();
    this.worker.isRunning = false;
    this.on.failed(text, wasReady);
    if (wasReady) this.takeWorker(); // else it would fail again and again
  }
}
