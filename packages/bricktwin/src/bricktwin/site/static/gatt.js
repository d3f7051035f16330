// Bluetooth of the page: carries bytes between one hub and Python in the worker, which speaks with it. Nothing here knows what
// they mean.

const bytesOf = (digits) => Uint8Array.from(digits.match(/../g) ?? [], (byte) => parseInt(byte, 16));
const digitsOf = (view) => Array.from(new Uint8Array(view.buffer, view.byteOffset, view.byteLength), (byte) => byte.toString(16).padStart(2, "0")).join("");

export class Gatt {
  // `on`: functions event(digits), lost().
  constructor(on) {
    this.on = on;
    this.device = null;
    this.waiting = []; // operations, as a browser does one at a time
    this.isAtWork = false;
  }

  static isPossible() {
    return Boolean(navigator.bluetooth?.requestDevice);
  }

  // A person chooses a hub; asked for within the press of a button.
  async choose({ service, others }) {
    const device = await navigator.bluetooth.requestDevice({ filters: [{ services: [service] }], optionalServices: others });
    if (device !== this.device) device.addEventListener("gattserverdisconnected", () => this.lose());
    this.device = device;
  }

  get isConnected() {
    return Boolean(this.device?.gatt.connected);
  }

  lose() {
    this.characteristics = null;
    this.on.lost();
  }

  // An operation of Python's; resolves to its answer, always. One that is urgent comes before others that wait.
  do(request, isUrgent = false) {
    return new Promise((resolve) => {
      const entry = { request, resolve };
      // A connection that does not come about is given up at once, and not after what waits for it.
      if (request.operation === "close") {
        this.device?.gatt.disconnect();
        resolve({});
        return;
      }
      if (isUrgent) this.waiting.unshift(entry);
      else this.waiting.push(entry);
      this.work();
    });
  }

  async work() {
    if (this.isAtWork) return;
    this.isAtWork = true;
    while (this.waiting.length) {
      const { request, resolve } = this.waiting.shift();
      try {
        resolve((await this.perform(request)) ?? {});
      } catch (error) {
        resolve({ error: error.name ?? "Error", message: String(error.message ?? error) });
      }
    }
    this.isAtWork = false;
  }

  async perform({ operation, characteristic, data }) {
    if (operation === "connect") return this.connect();
    const found = this.characteristics?.get(characteristic);
    if (!found) throw new DOMException(this.characteristics ? `it has no ${characteristic}` : "it is not connected", "NetworkError");
    if (operation === "read") return { value: digitsOf(await found.readValue()) };
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
