// Cable of the page, by Web Serial: carries bytes between one hub and Python in the worker, which makes messages of them.

import { bytesOf, digitsOf, Link } from "./link.js";

const BAUD_RATE = 115200; // a browser wants one; over USB it means nothing
const LAST_MS = 300; // in which the last bytes leave

export class Cable extends Link {
  constructor(on) {
    super(on);
    this.open = null; // the port that is open
  }

  static isPossible() {
    return Boolean(navigator.serial?.requestPort);
  }

  // A person chooses a port, as `requestPort` is asked for it; within the press of a button.
  async choose(options) {
    this.device = await navigator.serial.requestPort(options);
  }

  get isConnected() {
    return Boolean(this.open);
  }

  async perform({ operation, data }) {
    if (operation === "connect") return this.connect();
    if (!this.open) throw new DOMException("it is not connected", "NetworkError");
    return void (await this.writer.write(bytesOf(data)));
  }

  async connect() {
    await this.disconnect();
    const port = (this.device = await this.present());
    await port.open({ baudRate: BAUD_RATE });
    this.open = port;
    this.writer = port.writable.getWriter();
    this.listening = this.listen(port);
    // A hub says nothing before it knows that somebody listens.
    await port.setSignals({ dataTerminalReady: true });
    return { product: port.getInfo().usbProductId ?? 0 };
  }

  // A cable that was plugged in again is another port for the browser, which is known by what is at its end.
  async present() {
    const ports = await navigator.serial.getPorts(), { usbProductId } = this.device.getInfo();
    if (ports.includes(this.device)) return this.device;
    const alike = ports.filter((port) => port.getInfo().usbProductId === usbProductId);
    return alike.length === 1 ? alike[0] : this.device;
  }

  async listen(port) {
    // After an error of the line the browser has another stream; after the end of the cable it has none.
    while (this.open === port && port.readable) {
      const reader = (this.reader = port.readable.getReader());
      try {
        for (let chunk = await reader.read(); !chunk.done; chunk = await reader.read()) this.on.event(digitsOf(chunk.value));
      } catch {
        // What comes next says whether this was the end.
      } finally {
        reader.releaseLock();
      }
    }
    if (this.open !== port) return;
    this.open = null;
    this.lose();
    this.writer.releaseLock();
    await port.close().catch(() => {});
  }

  async disconnect() {
    const { open, writer, reader } = this;
    if (!open) return;
    this.open = null;
    // What a hub does not take is left behind.
    const late = setTimeout(() => writer.abort().catch(() => {}), LAST_MS);
    await writer.close().catch(() => {});
    clearTimeout(late);
    await reader.cancel().catch(() => {});
    await this.listening;
    writer.releaseLock();
    await open.close().catch(() => {});
  }
}
