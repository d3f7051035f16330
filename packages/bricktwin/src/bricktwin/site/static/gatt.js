// Bluetooth of the page: carries bytes between one hub, or device, and Python in the worker, which speaks with it. Nothing here knows what
// they mean.

import { bytesOf, digitsOf, Link } from "./link.js";

export class Gatt extends Link {
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

  lose() {
    this.characteristics = null;
    super.lose();
  }

  disconnect() {
    this.device?.gatt.disconnect();
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
