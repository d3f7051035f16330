// Real devices of LEGO's kits: a program for LEGO's package runs on them. The person chooses each device that the program looks for,
// as browsers want a press for it; the page carries bytes, and can stop the motors whatever the program does.

import { Gatt } from "./gatt.js";
import { NO_BLUETOOTH, NO_WAY_IN } from "./real_hub.js";

const WRITE = "0000fd02-0001-1000-8000-00805f9b34fb";
const IS_FOR_KITS = /^\s*(import|from)\s+legoeducation\b/m;
const AGAIN_MS = 20;
const bytes = (numbers) => Uint8Array.from(numbers);

export class RealKit {
  // `hub`: the hub of the tab, which has the worker. `on`: functions start(), show(event), note(text).
  constructor(element, { button, hub, on }) {
    this.find = (name) => element.querySelector(`[data-kit="${name}"]`);
    Object.assign(this, { element, button, hub, on });
    this.isRunning = false;
    this.devices = []; // { gatt, name, stop }, by number
    this.late = []; // messages for which the mailbox has had no room yet
    this.wanted = null; // the device that the program looks for
    button.onclick = () => this.run();
    this.find("choose").onclick = () => this.choose();
    this.find("none").onclick = () => this.refuse();
    this.find("stop").onclick = () => this.stop();
  }

  // The program on the page is another one now.
  offer(source) {
    this.button.hidden = !IS_FOR_KITS.test(source);
  }

  run() {
    this.on.note("");
    if (!Gatt.isPossible()) return this.on.note(NO_BLUETOOTH);
    if (!this.hub.hasWayIn) return this.on.note(NO_WAY_IN);
    if (!this.on.start()) return;
    this.isRunning = true;
    this.devices = [];
    this.late = [];
    this.draw("The program begins.");
  }

  // The page stops the motors itself, at once; Python is told, and does the rest.
  async stop() {
    if (this.isRunning) this.hub.stop();
    const write = ({ gatt, stop }) => gatt.do({ operation: "send", characteristic: WRITE, data: stop }, true);
    await Promise.all(this.devices.filter(({ stop, gatt }) => stop && gatt.isConnected).map(write));
  }

  // The run has ended; false if none of ours has.
  end() {
    if (!this.isRunning) return false;
    this.isRunning = false;
    this.wanted = null;
    for (const { gatt } of this.devices) gatt.close();
    this.draw();
    return true;
  }

  // ---------------------------------------------------------------- the person chooses a device

  async choose() {
    const { number, title, filters } = this.wanted, device = this.devices.length;
    const gatt = new Gatt({
      event: (data) => this.tell({ kind: "event", device, data }),
      lost: () => this.lose(device),
    });
    try {
      await gatt.choose({ filters: filters.map(withBytes) });
    } catch (error) {
      // Who closes the browser's window may press again.
      if (error.name !== "NotFoundError") this.answer(number, { error: error.name, message: error.message });
      return;
    }
    if (this.wanted?.number !== number) return;
    const { name, id } = gatt.device;
    this.devices.push({ gatt, name: name || title, stop: "" });
    this.answer(number, { device, name: name ?? "", id });
  }

  refuse() {
    this.answer(this.wanted.number, { error: "NotFoundError", message: "User cancelled" });
  }

  answer(number, answer) {
    this.wanted = null;
    this.draw();
    this.tell({ kind: "answer", number, ...answer });
  }

  // ---------------------------------------------------------------- between Bluetooth and Python

  async ask({ number, operation, device, characteristic, data }) {
    if (operation === "choose") {
      this.wanted = { number, ...JSON.parse(data) };
      this.draw(`Your program looks for a ${this.wanted.title}. Switch it on, and choose it.`);
      return;
    }
    const answer = await this.devices[device].gatt.do({ operation, characteristic, data });
    this.tell({ kind: "answer", number, ...answer });
  }

  tell(message) {
    this.late.push(message);
    this.tellAll();
  }

  tellAll() {
    // After the run nobody listens, and nothing of it is for what comes next.
    while (this.late.length && (!this.isRunning || this.hub.tell(this.late[0]))) this.late.shift();
    if (this.late.length) this.timer ??= setTimeout(() => ((this.timer = null), this.tellAll()), AGAIN_MS);
  }

  lose(device) {
    this.tell({ kind: "lost", device });
    this.draw();
  }

  // What has come of Python.
  add(events) {
    for (const event of events) {
      if (event.kind !== "kit") this.on.show(event);
      else {
        Object.assign(this.devices[event.device], { stop: event.stop });
        this.draw();
      }
    }
  }

  draw(text = "") {
    const names = this.devices.filter(({ gatt }) => gatt.isConnected).map(({ name }) => name);
    this.element.hidden = !this.isRunning;
    this.find("choose").hidden = this.find("none").hidden = !this.wanted;
    this.find("status").textContent = text || (names.length ? `Connected: ${names.join(", ")}.` : "");
  }
}

// A filter of a browser's, of one that came as JSON.
function withBytes({ manufacturerData, ...filter }) {
  if (!manufacturerData) return filter;
  const data = manufacturerData.map(({ companyIdentifier, dataPrefix, mask }) => ({ companyIdentifier, dataPrefix: bytes(dataPrefix), mask: bytes(mask) }));
  return { ...filter, manufacturerData: data };
}
