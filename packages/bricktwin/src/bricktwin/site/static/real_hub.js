// The real hub: a bar of the page to connect it, to run programs on it, and to stop it whatever else happens.

import { Cable } from "./cable.js";
import { Gatt } from "./gatt.js";

export const NO_BLUETOOTH = "This browser lets no page use Bluetooth. Chrome and Edge do, on Windows, macOS, ChromeOS and Android; on Linux once "
  + "chrome://flags/#enable-experimental-web-platform-features is switched on. Firefox, Safari, iPhones and iPads do not.";
const NO_SERIAL = "This browser lets no page use a cable. Chrome, Edge and Opera do, on a computer with Windows, macOS, Linux or ChromeOS. Firefox, Safari, "
  + "phones and tablets do not.";
export const NO_WAY_IN = "A hub needs an address that begins with https, or that of this computer (python serve.py); this one has none, or the page has just been opened for the first time: load it again.";
const LOST = "The link to the hub is lost.";
const LOST_IN_PROGRAM = `${LOST} Your program goes on, on the hub: press the hub's button to stop it. Then connect again.`;
const LOST_IN_TRY = `${LOST} The hub ends its try by itself, and its motors stop. The page connects again …`;
const AGAIN_MS = 20;
// What carries the bytes.
const WAYS = {
  bluetooth: { Kind: Gatt, title: "Bluetooth", lacking: NO_BLUETOOTH },
  cable: { Kind: Cable, title: "The cable", lacking: NO_SERIAL },
};

export class RealHub {
  // `buttons`: that connect, by way. `names`: links.json. `hub`: the hub of the tab, which has the worker. `on`: functions start(request),
  // event(event), changed(), note(text).
  constructor(element, { buttons, names, hub, on }) {
    this.find = (name) => element.querySelector(`[data-real="${name}"]`);
    Object.assign(this, { element, buttons, names, hub, on });
    this.links = {};
    for (const [by, { Kind }] of Object.entries(WAYS)) {
      this.links[by] = new Kind({ event: (data) => this.tell({ kind: "event", data }), lost: () => this.lose() });
      buttons[by].onclick = () => this.connect(by);
    }
    this.by = "bluetooth";
    this.known = { connected: false };
    this.doing = null; // what Python does on the hub: connect, leave, run or teach
    this.late = []; // messages for which the mailbox has had no room yet
    this.find("run").onclick = () => this.on.run();
    this.find("stop").onclick = () => this.stop();
    this.find("again").onclick = () => this.begin("connect");
    this.find("leave").onclick = () => this.leave();
    this.draw();
  }

  get link() {
    return this.links[this.by];
  }

  get isConnected() {
    return this.known.connected && this.link.isConnected;
  }

  // ---------------------------------------------------------------- the person

  async connect(by) {
    const { Kind, title, lacking } = WAYS[by];
    this.on.note("");
    if (!Kind.isPossible()) return this.on.note(lacking);
    if (!this.hub.hasWayIn) return this.on.note(NO_WAY_IN);
    try {
      await this.links[by].choose(this.names[by]);
    } catch (error) {
      // Who closes the browser's window of hubs wants none.
      if (error.name !== "NotFoundError") this.on.note(`${title} cannot be used here: ${error.message}`);
      return;
    }
    this.by = by;
    this.begin("connect");
  }

  leave() {
    if (this.begin("leave")) return;
    this.link.do({ operation: "close" });
  }

  // Python does something on the hub; false while it does something else.
  begin(doing, request = {}) {
    if (!this.on.start({ hub: doing, by: this.by, ...request })) return false;
    this.doing = doing;
    this.say(doing === "connect" ? "connecting …" : "");
    this.draw();
    return true;
  }

  // The page stops the hub itself, at once; Python is told, and does the rest.
  async stop() {
    if (this.doing) this.hub.stop();
    if (!this.known.stop) return;
    await this.link.do({ operation: "write", characteristic: this.names.command, data: this.known.stop }, true);
  }

  goOn() {
    this.tell({ kind: "go on" });
  }

  // ---------------------------------------------------------------- between the hub and Python

  async ask({ number, operation, characteristic, data }) {
    const answer = await this.link.do({ operation, characteristic, data });
    this.tell({ kind: "answer", number, ...answer });
  }

  tell(message) {
    this.late.push(message);
    this.tellAll();
  }

  tellAll() {
    // What Python does not hear while it does something else, the hub says again.
    while (this.late.length && (this.hub.tell(this.late[0]) || !this.doing)) this.late.shift();
    if (this.late.length) this.timer ??= setTimeout(() => ((this.timer = null), this.tellAll()), AGAIN_MS);
  }

  lose() {
    this.tell({ kind: "lost" });
    if (this.doing === "teach") this.say(LOST_IN_TRY);
    else if (this.known.connected) this.say(this.known.running ? LOST_IN_PROGRAM : LOST);
    this.draw();
  }

  // What has come of Python while it does something on the hub, or listens to it.
  add(events) {
    for (const event of events) {
      if (event.kind === "hub") this.learn(event);
      else this.on.event(event);
    }
  }

  learn(state) {
    const wasConnected = this.known.connected;
    this.known = state.connected ? state : { ...this.known, connected: false };
    if (state.connected && !wasConnected) this.say("");
    this.draw();
  }

  // Python has done it.
  end(code) {
    const done = this.doing;
    this.doing = null;
    if (done === "leave") {
      this.known = { connected: false };
      this.say("");
    } else if (done === "connect" && code) this.say("not connected");
    this.draw();
    return done;
  }

  // Python has begun anew, and knows of no hub: it connects again, as the browser still does.
  restart() {
    this.doing = null;
    this.late = [];
    if (this.link.isConnected) this.begin("connect");
  }

  // ---------------------------------------------------------------- the bar

  say(text) {
    this.find("status").textContent = text;
  }

  draw() {
    const { name, type, firmware, battery, running } = this.known, isConnected = this.isConnected;
    const isKnown = Boolean(this.link.device) && (isConnected || Boolean(name) || Boolean(this.doing));
    this.element.hidden = !isKnown;
    for (const button of Object.values(this.buttons)) button.hidden = isKnown;
    this.find("name").textContent = name || "Hub";
    this.find("facts").textContent = isConnected ? `${type}, firmware ${firmware}, battery ${battery}${running ? ", a program runs" : ""}` : "";
    this.find("facts").classList.toggle("low", isConnected && battery !== "charged");
    this.find("run").disabled = !isConnected || Boolean(this.doing);
    this.find("again").hidden = isConnected || Boolean(this.doing);
    this.find("leave").disabled = Boolean(this.doing);
    this.on.changed();
  }
}
