// Bench: what is on the hub's ports. Motors are dials; what sensors sense is set by hand, also while a program runs.

const COLOURS = {
  none: [0, 0, 0], black: [0, 0, 10], gray: [0, 0, 50], white: [0, 0, 100], red: [0, 100, 100], orange: [30, 100, 100],
  yellow: [60, 100, 100], green: [120, 100, 100], cyan: [180, 100, 100], blue: [240, 100, 100], violet: [270, 100, 100], magenta: [300, 100, 100],
};
const PAINT = {
  none: "transparent", black: "#111", gray: "#8b8f96", white: "#fff", red: "#e3202b", orange: "#f68620", yellow: "#fbd102", green: "#12a14b",
  cyan: "#35b9e0", blue: "#1357b8", violet: "#7a3fb0", magenta: "#d5318f",
};
const PORTS = "ABCDEF1234";
// Sliders of a sense: name, lowest, highest, step, at first, unit.
const SLIDERS = {
  ambient: [["Light around it", 0, 100, 1, 0, "%"]],
  force: [["Force", 0, 10, 0.5, 0, "N"]],
  tilt: [["Pitch", -90, 90, 1, 0, "°"], ["Roll", -90, 90, 1, 0, "°"]],
  count: [["Counted", 0, 50, 1, 0, ""]],
  rotation: [["Turned", -360, 360, 5, 0, "°"]],
  beacon: [["Beacon", 0, 100, 1, 0, "%"], ["Direction", -75, 75, 3, 0, "°"]],
};
const DISTANCE = { UltrasonicSensor: ["Distance", 40, 2000, 10, 2000, "mm"], Ev3UltrasonicSensor: ["Distance", 30, 2550, 10, 2550, "mm"], other: ["Distance", 0, 100, 1, 100, "%"] };

export class Bench {
  // `devices`: devices.json. `onReading`: called with [port, sense, value].
  constructor(element, { devices, onReading }) {
    this.element = element;
    this.devices = devices;
    this.onReading = onReading;
    this.readingsOf = [new Map()]; // of each hub
    this.hub = 0;
    this.cards = new Map();
    this.told = {};
    const classes = [...devices.motors, ...Object.keys(devices.sensors).map((kind) => kind.replace(/^Ev3/, ""))].join("|");
    this.pattern = new RegExp(`(?:(\\w+)\\s*=\\s*)?\\b(${classes})\\s*\\(\\s*(?:port\\s*=\\s*)?Port\\.([A-F]|S[1-4])`, "g");
  }

  // All that has been set for the hub that is shown.
  get readings() {
    return (this.readingsOf[this.hub] ??= new Map());
  }

  // All that has been set, for a run that begins.
  get settings() {
    return this.settingsOf(this.hub);
  }

  settingsOf(hub) {
    return [...(this.readingsOf[hub] ?? [])].map(([key, value]) => [...key.split("."), value]);
  }

  // Another hub's bench is shown.
  select(hub) {
    this.hub = hub;
    for (const { element } of this.cards.values()) element.remove();
    this.cards.clear();
  }

  // The devices that a program names, before it runs.
  take(source) {
    this.told = {};
    this.named = {};
    for (const [, name, device, port] of source.replace(/#.*/g, "").matchAll(this.pattern)) {
      // The ports with a digit are those of an EV3, with sensors of their own.
      const kind = port.length > 1 && this.devices.sensors[`Ev3${device}`] ? `Ev3${device}` : device;
      this.named[port.at(-1)] ??= { device: kind, name };
    }
    this.lay();
  }

  // The devices that a program has on the bench now.
  tell(devices) {
    this.told = devices;
    this.lay();
  }

  lay() {
    const found = { ...this.named };
    for (const [port, device] of Object.entries(this.told)) {
      if (found[port]?.device !== device) found[port] = { device, name: found[port]?.name };
    }
    for (const [port, card] of this.cards) {
      if (found[port]?.device === card.device && found[port].name === card.name) continue;
      card.element.remove();
      this.cards.delete(port);
    }
    for (const port of PORTS) {
      if (!found[port] || this.cards.has(port)) continue;
      const card = this.card(port, found[port]);
      this.cards.set(port, card);
      const next = PORTS.slice(PORTS.indexOf(port) + 1).split("").find((other) => this.cards.has(other));
      this.element.insertBefore(card.element, next ? this.cards.get(next).element : null);
    }
    this.element.dataset.count = this.cards.size;
  }

  card(port, { device, name }) {
    const element = make("section", { className: "device", ariaLabel: `Port ${port}: ${device}` });
    const title = make("h3", {}, make("b", { textContent: port }), make("span", { textContent: name ?? device }), make("small", { textContent: name ? device : "" }));
    element.append(title);
    const card = { element, device, name };
    if (this.devices.motors.includes(device)) {
      card.pointer = make("i", {});
      card.output = make("output", { textContent: "0°" });
      element.append(make("div", { className: "dial", role: "img", ariaLabel: "Motor's shaft" }, card.pointer), card.output);
    } else for (const sense of this.devices.sensors[device] ?? []) element.append(...this.controls(port, device, sense));
    if (!this.devices.motors.includes(device) && !this.devices.sensors[device]?.length) element.append(make("p", { className: "muted", textContent: "shows its light beside the hub" }));
    return card;
  }

  controls(port, device, sense) {
    const key = `${port}.${sense}`;
    const set = (value) => {
      this.readings.set(key, value);
      this.onReading([port, sense, value]);
    };
    if (sense === "surface") return [this.swatches(set, this.readings.get(key))];
    const sliders = sense === "distance" ? [DISTANCE[device] ?? DISTANCE.other] : SLIDERS[sense];
    const values = [this.readings.get(key) ?? sliders.map((slider) => slider[4])].flat();
    const inputs = sliders.map((slider, i) =>
      this.slider(port, slider, values[i], (value) => {
        values[i] = value;
        set(sliders.length > 1 ? [...values] : value);
      }));
    if (sense === "force") inputs.push(this.pressButton(port, inputs[0].querySelector("input")));
    return inputs;
  }

  slider(port, [label, min, max, step, , unit], value, set) {
    const output = make("output", { textContent: `${value} ${unit}`.trim() });
    const input = make("input", { type: "range", min, max, step, ariaLabel: `${label} at port ${port}` });
    input.value = value;
    input.addEventListener("input", () => {
      output.textContent = `${input.value} ${unit}`.trim();
      input.setAttribute("aria-valuetext", output.textContent);
      set(Number(input.value));
    });
    return make("label", { className: "slider" }, make("span", { textContent: label }), output, input);
  }

  swatches(set, value) {
    const group = make("div", { className: "swatches", role: "group", ariaLabel: "What it sees" });
    const chosen = JSON.stringify(value ?? COLOURS.none);
    for (const [name, hsv] of Object.entries(COLOURS)) {
      const button = make("button", { type: "button", title: name, ariaLabel: name, className: name });
      button.style.background = PAINT[name];
      button.setAttribute("aria-pressed", JSON.stringify(hsv) === chosen);
      button.addEventListener("click", () => {
        group.querySelectorAll("button").forEach((other) => other.setAttribute("aria-pressed", other === button));
        set(hsv);
      });
      group.append(button);
    }
    return group;
  }

  // A force sensor is a button, too: pressed as long as the finger is.
  pressButton(port, input) {
    const button = make("button", { type: "button", textContent: "Press", ariaLabel: `Press the sensor at port ${port}` });
    const press = (newtons) => {
      input.value = newtons;
      input.dispatchEvent(new Event("input"));
    };
    button.addEventListener("pointerdown", (event) => {
      button.setPointerCapture(event.pointerId);
      press(10);
    });
    for (const end of ["pointerup", "pointercancel"]) button.addEventListener(end, () => press(0));
    button.addEventListener("keydown", (event) => event.key === " " && !event.repeat && press(10));
    button.addEventListener("keyup", (event) => event.key === " " && press(0));
    return button;
  }

  // Angles of the motors by port, deg, of a frame.
  turn(row) {
    for (const [port, card] of this.cards) {
      const angle = row[1 + PORTS.indexOf(port)];
      if (!card.pointer || Number.isNaN(angle)) continue;
      card.pointer.style.transform = `rotate(${angle}deg)`;
      card.output.textContent = `${Math.round(angle)}°`;
    }
  }
}

export function make(tag, properties, ...children) {
  const { role, ariaLabel, ...others } = properties, element = Object.assign(document.createElement(tag), others);
  if (role) element.setAttribute("role", role);
  if (ariaLabel) element.setAttribute("aria-label", ariaLabel);
  element.append(...children);
  return element;
}
