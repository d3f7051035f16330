// Bluetooth of the page: carries bytes between one hub, or device, and Python in the worker, which speaks with it. Nothing here knows what
// they mean.

const bytesOf = (digits) => Uint8Array.from(digits.match(/../g) ?? [], (byte) => parseInt(byte, 16));
const digitsOf = (view) => Array.from(new Uint8Array(view.buffer, view.byteOffset, view.byteLength), (byte) => byte.toString(16).padStart(2, "0")).join("");

export class Gatt {
  // `on`: functions event(digits), lost().
  constructor(on) {
    this.on = on;
    this.device = null;
    this.waiting = []; // operations, as a browser does one at a time
    this.atWork = null; // that whose answer is waited for
  }

  static isPossible() {
    return Boolean(navigator.bluetooth?.requestDevice);
  }

  // A person chooses a device, as `requestDevice` is asked for it; within the press of a button.
  async choose(options) {
    const device = await navigator.bluetooth.requestDevice(options);
    if (device !== this.device) device.addEventListener("gattserverdisconnected", () => this.lose());
    this.device = device;
  }

  get isConnected() {
    return Boolean(this.device?.gatt.connected);
  }

  // What was in flight may never have an answer of the browser's, or a late one, which nobody hears any more.
  lose() {
    this.characteristics = null;
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
    this.device?.gatt.disconnect();
    return {};
  }

  giveUp(message, isGiven) {
    const given = [this.atWork, ...this.waiting].filter((entry) => entry && isGiven(entry));
    if (given.includes(this.atWork)) this.atWork = null;
    this.waiting = this.waiting.filter((entry) => !given.includes(entry));
    for (const { resolve } of given) resolve({ error: "NetworkError", message });
    this.work();
  }

  async perform({ operation, characteristic, data }) {
    if (operation === "connect") return this.connect();
    const found = this.characteristics?.get(characteristic);
    if (!found) throw new DOMException(this.characteristics ? `it has no ${characteristic}` : "it is not connected", "NetworkError");
    if (operation === "read") return { value: digitsOf(await found.readValue()) };
    if (operation === "send") return void (await found.writeValueWithoutResponse(bytesOf(data)));
    if (operation === "write") return void (await found.writeValueWithResponse(bytesOf(data)));
    found.oncharacteristicvaluechanged = ({ target }) => this.on.event(digitsOf(target.value));
    await found.startNotifications();
    return {};
  }

  async connect() {
    const { gatt, name, id } = this.device, all = new Map();
    await gatt.connect();
    for (const service of await gatt.getPrimaryServices()) {
      for (const characteristic of await service.getCharacteristics()) all.set(characteristic.uuid, characteristic);
    }
    this.characteristics = all;
    return { name: name ?? "", id };
  }
}
