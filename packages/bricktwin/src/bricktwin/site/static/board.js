// The hub itself: light, display, buttons and loudspeaker.

const PORTS = "ABCDEF";

export class Board {
  // `hubs`: buttons and display by the class of a hub. `onButton`: called with a message.
  constructor(element, { hubs, onButton }) {
    this.hubs = hubs;
    this.element = element;
    this.onButton = onButton;
    this.display = element.querySelector(".display");
    this.screen = element.querySelector(".screen");
    this.light = element.querySelector(".light");
    this.angles = element.querySelector(".angles");
    this.lamps = element.querySelector(".lamps");
    this.pixels = Array.from({ length: 25 }, () => this.display.appendChild(document.createElement("i")));
    this.letter = this.display.appendChild(document.createElement("b"));
    this.sound = new Sound();
    element.querySelectorAll("[data-button]").forEach((button) => this.listen(button));
    this.show(null);
  }

  // A button is held as long as the finger, or the key, is.
  listen(button) {
    const name = button.dataset.button;
    let isHeld = false;
    const hold = (down) => {
      if (down === isHeld) return;
      isHeld = down;
      button.classList.toggle("held", down);
      this.onButton({ kind: down ? "press" : "release", button: name });
    };
    button.addEventListener("pointerdown", (event) => {
      button.setPointerCapture(event.pointerId);
      hold(true);
    });
    for (const end of ["pointerup", "pointercancel", "blur"]) button.addEventListener(end, () => hold(false));
    const isKey = (event) => event.key === " " || event.key === "Enter";
    button.addEventListener("keydown", (event) => isKey(event) && (event.preventDefault(), hold(true)));
    button.addEventListener("keyup", (event) => isKey(event) && hold(false));
  }

  // Angles of the motors by port, and the heading, deg, of a frame.
  turn(row) {
    const motors = [...PORTS].map((port, i) => [port, row[1 + i]]).filter(([, angle]) => !Number.isNaN(angle));
    const facts = [...motors.map(([port, angle]) => `${port} ${Math.round(angle)}°`), `heading ${Math.round(row[7])}°`];
    this.angles.textContent = facts.join("   ");
  }

  // The kind of hub that a program imports.
  take(source) {
    const names = /from\s+pybricks\.hubs\s+import\s+([\w, ]+)/.exec(source)?.[1].split(/\s*,\s*/) ?? [];
    const usual = /^\s*(from|import)\s+pybricks\.(ev3|nxt)devices\b/m.test(source) ? "EV3Brick" : "PrimeHub";
    const name = names.find((name) => this.hubs[name]) ?? usual, hub = this.hubs[name];
    this.element.dataset.hub = name;
    this.element.querySelector(".kind").textContent = name;
    this.display.hidden = !hub.display;
    this.screen.hidden = !hub.screen;
    if (hub.screen) [this.screen.width, this.screen.height] = hub.screen;
    this.element.querySelectorAll("[data-button]").forEach((button) => (button.hidden = !hub.buttons.includes(button.dataset.button)));
    const stops = hub.buttons.includes("left_up") ? "" : ", which stops the program";
    this.element.querySelector('[data-button="center"]').ariaLabel = `Center button${stops}`;
  }

  // The screen of a brick: base64 of its shades; empty for nothing.
  draw(pixels) {
    const { width, height, hidden } = this.screen;
    if (hidden) return;
    const bytes = atob(pixels), context = this.screen.getContext("2d"), picture = context.createImageData(width, height);
    for (let i = 0; i < width * height; i++) {
      const shade = SHADES[(bytes.charCodeAt(i >> 2) >> (6 - 2 * (i & 3))) & 3] ?? SHADES[0];
      picture.data.set([shade, shade, shade, 255], 4 * i);
    }
    context.putImageData(picture, 0, 0);
  }

  // What the hub shows; null for nothing.
  show(panel) {
    const { light = null, display = [], text = "", turns = 0, hz = 0, lamps = {}, screen = "" } = panel ?? {};
    this.draw(screen);
    this.light.style.setProperty("--light", light ? colour(light) : "#d4d8df");
    this.light.classList.toggle("on", Boolean(light));
    this.light.setAttribute("aria-label", light ? `Light: hue ${light[0]}, ${light[2]} %` : "Light: off");
    this.pixels.forEach((pixel, i) => {
      const bright = text ? 0 : (display[turned(i, turns)] ?? 0) / 100;
      pixel.hidden = Boolean(text);
      pixel.style.background = bright ? `rgb(255 ${Math.round(225 + 30 * bright)} ${Math.round(170 + 60 * bright)} / ${0.25 + 0.75 * bright})` : "";
    });
    this.letter.hidden = !text;
    this.letter.textContent = text;
    const isDark = !text && !display.some((bright) => bright > 0);
    this.display.setAttribute("aria-label", text ? `Display: ${text}` : isDark ? "Display: off" : `Display: ${rows(display)}`);
    this.lamps.textContent = Object.entries(lamps).map(([port, bright]) => `light ${port}: ${bright} %`).join(", ");
    this.sound.play(hz);
  }
}

// Shades of a screen, four pixels to a byte, as red, green and blue.
const SHADES = [235, 165, 95, 25];

// Index of the pixel that is shown at a place, after clockwise quarter turns.
function turned(i, turns) {
  let [row, column] = [Math.floor(i / 5), i % 5];
  for (let turn = 0; turn < turns % 4; turn++) [row, column] = [4 - column, row];
  return 5 * row + column;
}

function rows(display) {
  return [0, 5, 10, 15, 20].map((start) => display.slice(start, start + 5).map((bright) => (bright ? "#" : ".")).join("")).join(" ");
}

function colour([hue, saturation, value]) {
  const lightness = (value / 100) * (1 - saturation / 200), spread = Math.min(lightness, 1 - lightness);
  const s = spread ? (value / 100 - lightness) / spread : 0;
  return `hsl(${hue} ${Math.round(100 * s)}% ${Math.round(100 * lightness)}%)`;
}

class Sound {
  constructor() {
    this.isMuted = false;
    this.context = null;
  }

  // Browsers allow sound only after a press of a button.
  allow() {
    const Context = globalThis.AudioContext;
    if (!Context || this.context) return;
    this.context = new Context();
    this.volume = this.context.createGain();
    this.volume.gain.value = 0;
    this.tone = this.context.createOscillator();
    this.tone.type = "square";
    this.tone.connect(this.volume).connect(this.context.destination);
    this.tone.start();
  }

  play(hz) {
    if (!this.context) return;
    if (hz) this.tone.frequency.value = hz;
    this.volume.gain.setTargetAtTime(hz && !this.isMuted ? 0.04 : 0, this.context.currentTime, 0.005);
  }
}
