// Live page: shows the server's state, and sends presses to the server. All state is the server's, so that tabs agree.

import { Scene3D } from "./scene3d.js"; // of bricktwin.view
import { Chart, short } from "./charts.js";
import { $, cleanAddress, connect, fill, press, pressStop } from "./connection.js";
import { hear, showVisitors, you } from "./visitors.js";

const POSES = 1, IMAGE = 2, MIN_INTERVAL_MS = 60, REPEAT_MS = 300, REST_MS = 1500, IDLE_AXIS = 0.12;
let status = {}, scene = null, lost = "";
const charts = new Map();
const pushes = { values: [], sent_ms: 0, active: false };

// ---------------------------------------------------------------- messages

function onMessage(message) {
  if (message.you) {
    hear(message.you);
    if (status.title) show();
  }
  if (message.drawing) loadDrawing(message.drawing);
  if (message.status) {
    status = message.status;
    show();
  }
  for (const [name, changes] of Object.entries(message.series ?? {})) addRows(name, changes);
}

function onBinary(buffer) {
  const kind = new Uint8Array(buffer, 0, 1)[0];
  if (kind === POSES) {
    latestPoses = new Float32Array(buffer, 4);
    scene?.setPoses(latestPoses);
  } else if (kind === IMAGE) {
    const view = new DataView(buffer), height = view.getUint16(2, true), width = view.getUint16(4, true);
    showImage(new Uint8Array(buffer, 8), width, height);
  }
}

let latestPoses = null;

async function loadDrawing(version) {
  if (!scene) return;
  const response = await fetch(`drawing.json?${version}`);
  if (!response.ok) return;
  scene.load(await response.json());
  if (latestPoses) scene.setPoses(latestPoses);
}

function showImage(rgb, width, height) {
  $("camera").hidden = false;
  const canvas = $("image"), pen = canvas.getContext("2d"), pixels = new ImageData(width, height);
  [canvas.width, canvas.height] = [width, height];
  for (let i = 0, j = 0; i < rgb.length; i += 3, j += 4) {
    pixels.data.set(rgb.subarray(i, i + 3), j);
    pixels.data[j + 3] = 255;
  }
  pen.putImageData(pixels, 0, 0);
}

// ---------------------------------------------------------------- status

function showState() {
  const chip = $("state"), state = lost ? (lost.startsWith("no connection") ? "lost" : "finished") : status.state ?? "waiting";
  document.body.classList.toggle("lost", Boolean(lost));
  chip.textContent = lost || (state === "stopped" ? "STOPPED" : state);
  chip.className = `chip ${state}`;
  chip.hidden = !chip.textContent;
}

// What is known of the last stop: this page's own press first, then what the server says of the robot.
let pressed = ""; // "asked", "sent" or "silent"

function showStop() {
  const box = $("stop-said"), stop = status.stop;
  const byHand = "press the button of the hub itself";
  let kind = stop?.state ?? "";
  if (["asked", "silent"].includes(pressed)) kind = pressed;
  else if (pressed === "sent" && !stop) kind = "sent";
  if (lost && kind && kind !== "confirmed") kind = "silent";
  const whose = stop && stop.by !== you.name ? `${stop.by} has stopped it. ` : "";
  const said = {
    asked: "Stopping ...",
    sent: `${whose}The stop is sent. Motors are not confirmed to be stopped yet.`,
    confirmed: `${whose}Confirmed: the motors are stopped.`,
    unconfirmed: `Sent, but not confirmed: ${byHand}. ${stop?.reason ?? ""}`,
    silent: `No connection: ${byHand}.`,
  }[kind];
  box.hidden = !said;
  box.className = kind;
  if (box.textContent !== (said ?? "")) box.textContent = said ?? "";
}

function show() {
  const can = new Set(status.controls ?? []), state = status.state;
  document.title = `${status.title ?? "BricksRL"} · BricksRL`;
  $("title").textContent = status.title ?? "BricksRL";
  $("subtitle").textContent = status.subtitle ?? "";
  if (!status.stop && status.state === "running" && pressed === "sent") pressed = "";
  if (status.stop && pressed === "sent") pressed = "known";
  showState();
  showStop();
  showVisitors(status);
  const message = [status.note, status.message].filter(Boolean).join(" · ");
  $("message").hidden = !message;
  $("message").textContent = message ?? "";
  $("message").classList.toggle("note", !status.message);
  $("stop").hidden = !can.has("stop");
  showGoal();
  $("pause").hidden = !can.has("pause") || state === "paused";
  $("resume").hidden = !can.has("pause") || state !== "paused";
  $("step").hidden = !can.has("step");
  $("reset").hidden = !can.has("reset");
  $("discard").hidden = !can.has("discard");
  for (const id of ["pause", "resume", "step"]) $(id).disabled = state === "stopped" || state === "finished";
  $("control").hidden = !["pause", "step", "reset", "speed", "policy"].some((name) => can.has(name));
  showChoices(can);
  if (scene) scene.onPull = can.has("pull") ? showPull : null;
  $("hint").hidden = !can.has("pull") || pulled.isKnown || Boolean(status.no_scene) || !scene;
  showConsole();
  showFacts();
  showHub();
  showSeats();
  showDrive(can.has("drive") || Boolean(status.seats));
  showOwnSliders();
  $("no-scene").hidden = !status.no_scene && scene !== null;
  $("no-scene").textContent = scene === null ? "This browser has no WebGL 2, so the robot cannot be drawn." : status.no_scene ?? "";
}

// What the task asks for, and the returns to beat.
function showGoal() {
  const { goal, scores } = status, box = $("goal");
  box.hidden = !goal;
  box.firstChild.textContent = goal ?? "";
  box.querySelector("small").hidden = !status.has_ghost;
  fill(box.lastChild, Object.entries(scores ?? {}).map(([name, value]) => `${name} ${short(value)}`), "div", (row, text) => {
    const [, name, value] = text.match(/^(.*) (\S+)$/);
    row.append(Object.assign(document.createElement("dt"), { textContent: name }), Object.assign(document.createElement("dd"), { textContent: value }));
  });
}

function showChoices(can) {
  const speeds = $("speeds");
  speeds.hidden = !can.has("speed");
  fill(speeds, status.speeds ?? [], "button", (button, name) => {
    button.textContent = name;
    button.type = "button";
    button.onclick = () => press("speed", name);
  });
  for (const button of speeds.children) button.setAttribute("aria-pressed", String(button.textContent === status.speed));
  $("policy-row").hidden = !can.has("policy");
  fill($("policy"), status.policies ?? [], "option", (option, name) => {
    option.value = option.textContent = name;
  });
  $("policy").value = status.policy ?? "";
}

// What a program prints; the view follows the last line unless somebody reads further up.
function showConsole() {
  const box = $("console"), text = status.console ?? "", isAtEnd = box.scrollTop + box.clientHeight > box.scrollHeight - 20;
  box.hidden = status.console === undefined;
  if (box.textContent === text) return;
  box.textContent = text;
  if (isAtEnd) box.scrollTop = box.scrollHeight;
}

function showFacts() {
  const facts = Object.entries(status.facts ?? {});
  fill($("facts"), facts.map(([name]) => name), "span", (span, name) => {
    span.append(`${name} `, document.createElement("b"));
  });
  facts.forEach(([name, value], i) => {
    const output = $("facts").children[i].lastChild;
    output.textContent = typeof value === "string" ? value : short(value);
    output.dataset.fact = name;
  });
}

// A screen of four shades: four pixels to a byte, 0 is white, 3 is black.
function drawScreen(canvas, { width, height, pixels }) {
  if (canvas.dataset.pixels === pixels) return;
  canvas.dataset.pixels = pixels;
  Object.assign(canvas, { width, height });
  const bytes = atob(pixels), context = canvas.getContext("2d"), picture = context.createImageData(width, height);
  for (let i = 0; i < width * height; i++) {
    const shade = (bytes.charCodeAt(i >> 2) >> (6 - 2 * (i & 3))) & 3;
    picture.data.set([...Array(3).fill(235 - 70 * shade), 255], 4 * i);
  }
  context.putImageData(picture, 0, 0);
}

function showHub() {
  const { hub, link } = status;
  $("hub").hidden = !hub && !link;
  const display = $("display");
  display.hidden = !hub?.display;
  $("light").hidden = !hub;
  $("screen").hidden = !hub?.screen?.pixels;
  if (hub?.screen?.pixels) drawScreen($("screen"), hub.screen);
  if (hub) {
    if (display.hidden) display.replaceChildren();
    else if (hub.text) display.replaceChildren(Object.assign(document.createElement("b"), { textContent: hub.text }));
    else {
      if (display.childElementCount !== 25) display.replaceChildren(...Array.from({ length: 25 }, () => document.createElement("i")));
      hub.display.forEach((value, i) => {
        display.children[i].style.background = value ? `rgb(255 255 255 / ${0.25 + 0.75 * value / 100})` : "";
      });
    }
    $("light").style.background = hub.light ? hsv(...hub.light) : "";
    $("light").title = hub.light ? "light on" : "light off";
  }
  const rows = Object.entries(link ?? {}).flatMap(([name, value]) => [
    Object.assign(document.createElement("dt"), { textContent: name }),
    Object.assign(document.createElement("dd"), { textContent: value }),
  ]);
  $("link").replaceChildren(...rows);
}

function hsv(hue, saturation, value) {
  const v = value / 100, s = saturation / 100, light = v * (1 - s / 2);
  const part = light === 0 || light === 1 ? 0 : (v - light) / Math.min(light, 1 - light);
  return `hsl(${hue} ${100 * part}% ${100 * light}%)`;
}

// ---------------------------------------------------------------- plots

function addRows(name, changes) {
  if (changes.names) {
    for (const key of [...charts.keys()].filter((key) => key.startsWith(`${name}/`))) {
      charts.get(key).figure.remove();
      charts.delete(key);
    }
    changes.names.forEach((column, i) => charts.set(`${name}/${i}`, makeChart(name, column, i, changes.names.length)));
    sortCharts();
  }
  for (let i = 0; charts.has(`${name}/${i}`); i++) {
    charts.get(`${name}/${i}`).add({ ...changes, values: changes.rows.map((row) => row[i]) });
  }
}

function makeChart(name, column, i, count) {
  const isReturn = name === "return", chart = new Chart($("charts"), column, { points: isReturn, unit: isReturn ? "episode" : "step" });
  chart.figure.dataset.series = `${name}/${i}`;
  if (isReturn) chart.figure.classList.add("wide");
  return chart;
}

function sortCharts() {
  const rank = (figure) => ["return", "reward"].indexOf(figure.dataset.series.split("/")[0]);
  const figures = [...$("charts").children].map((figure, i) => [rank(figure) < 0 ? 9 : rank(figure), i, figure]);
  figures.sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  $("charts").append(...figures.map(([, , figure]) => figure));
}

// ---------------------------------------------------------------- driving

// In an arena, each visitor takes the seat of one robot, which is then the only one that this page drives. Who holds what is the
// server's; two tabs of one visitor share it.
let seat = null;

function showSeats() {
  const { seats, holders = {} } = status;
  $("seats").hidden = !seats;
  $("driving").hidden = Boolean(seats);
  if (!seats) return;
  seat = Object.keys(seats).find((name) => holders[name] === you.name) ?? null;
  status.drive = seat && seats[seat];
  fill($("seats"), Object.keys(seats), "button", (button, name) => {
    button.type = "button";
    button.style.borderBottom = `8px solid rgb(${seats[name].color.map((share) => 255 * share)})`;
    button.onclick = () => {
      const holder = status.holders?.[name];
      if (holder && holder !== you.name) press(`ask:${name}`);
      else press(`take_over:${name}`, !holder);
    };
  });
  Object.keys(seats).forEach((name, i) => {
    const button = $("seats").children[i], holder = holders[name];
    button.setAttribute("aria-pressed", String(name === seat));
    const text = holder && holder !== you.name ? `${holder} drives the ${name}. Ask` : `Drive the ${name}`;
    if (button.textContent !== text) button.textContent = text;
  });
}

const pressRobot = (name, value) => press(seat ? `${name}:${seat}` : name, value);

// The name of who else drives the only robot of this page.
function otherDriver() {
  const holder = status.seats ? null : status.holders?.robot;
  return holder && holder !== you.name ? holder : "";
}

function showDrive(canDrive) {
  $("drive").hidden = !canDrive;
  document.body.classList.toggle("arena", Boolean(status.seats));
  document.body.classList.toggle("driven", Boolean(canDrive && status.drive?.in_charge));
  document.querySelector(".sticks").hidden = !status.drive;
  if (!canDrive || !status.drive) return;
  const { commands, in_charge, can_give_back } = status.drive;
  const other = otherDriver();
  $("take-over").hidden = !can_give_back && !other;
  $("take-over").setAttribute("aria-pressed", String(in_charge && !other));
  $("take-over").textContent = other ? `Ask ${other}` : in_charge ? "Give back" : "Take over";
  $("driver").textContent = other ? `${other} drives` : in_charge ? ["you drive", ...(status.drive.moving ?? [])].join("; ") : "the agent drives";
  document.querySelector(".sticks").hidden = Boolean(other);
  fill($("sliders"), commands.map(({ name }) => name), "label", (label, name) => {
    const i = commands.findIndex((command) => command.name === name);
    label.className = "slider";
    const input = Object.assign(document.createElement("input"), { type: "range", min: -1, max: 1, step: 0.05, value: 0 });
    input.setAttribute("aria-label", name);
    input.oninput = () => push(pushes.values.with(i, Number(input.value)));
    input.ondblclick = () => push(pushes.values.with(i, 0));
    label.append(name, document.createElement("output"), input);
  });
  if (pushes.values.length !== commands.length) pushes.values = commands.map(() => 0);
  if (!pushes.active) pushes.values = [...status.drive.pushes];
  showPushes();
}

function showPushes() {
  const { commands, actions } = status.drive;
  pushes.values.forEach((value, i) => {
    const label = $("sliders").children[i], input = label.querySelector("input");
    input.value = value;
    label.querySelector("output").textContent = actions ? `${short(actions[i])} ${commands[i].unit}` : "";
  });
}

// Pushes are repeated while they last, so that a robot comes to rest when the page is closed. One that rests because the page
// slept, or had no connection, stays at rest, unless somebody holds the stick.
function push(values) {
  pushes.values = values.map((value) => Math.max(-1, Math.min(1, value)));
  pushes.active ||= pushes.values.some((value) => value !== 0); // or the server's last pushes replace them before they are sent
  showPushes();
  clearTimeout(pushes.timer);
  if (Date.now() - pushes.sent_ms < MIN_INTERVAL_MS) pushes.timer = setTimeout(send, MIN_INTERVAL_MS);
  else send();
}

function send() {
  pushes.sent_ms = Date.now();
  pushes.active = pushes.values.some((value) => value !== 0);
  pressRobot("drive", pushes.values);
}

setInterval(() => {
  if (!pushes.held && (lost || Date.now() - pushes.sent_ms > REST_MS)) pushes.active = false;
  if (pushes.active) send();
}, REPEAT_MS);

function makeStick() {
  const stick = $("stick"), knob = stick.firstElementChild;
  const move = (x, y) => {
    const size = Math.max(1, Math.hypot(x, y));
    [x, y] = [x / size, y / size];
    knob.style.transform = `translate(${33 * x}px, ${-33 * y}px)`;
    push((status.drive?.stick ?? []).map(([a, b]) => a * x + b * y));
  };
  const follow = (event) => {
    const box = stick.getBoundingClientRect();
    move((event.clientX - box.left - box.width / 2) / 33, -(event.clientY - box.top - box.height / 2) / 33);
  };
  stick.onpointerdown = (event) => {
    stick.setPointerCapture(event.pointerId);
    pushes.held = true;
    follow(event);
  };
  stick.onpointermove = (event) => stick.hasPointerCapture(event.pointerId) && follow(event);
  stick.onpointerup = stick.onpointercancel = () => {
    pushes.held = false;
    move(0, 0);
  };
  return move;
}

// The arrow keys push the stick while a human drives, unless they move the slider that has the focus.
function makeArrows(move) {
  const keys = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] }, down = new Set();
  const follow = () => {
    pushes.held = down.size > 0;
    move(...[0, 1].map((axis) => [...down].reduce((sum, key) => sum + keys[key][axis], 0)));
  };
  addEventListener("keydown", (event) => {
    if (!(event.key in keys) || !status.drive?.in_charge || event.target.matches("input, select")) return;
    event.preventDefault(); // or the page would scroll
    down.add(event.key);
    if (!event.repeat) follow();
  });
  addEventListener("keyup", (event) => down.delete(event.key) && follow());
  addEventListener("blur", () => down.size && (down.clear(), follow()));
}

// The left stick of a gamepad pushes the stick too.
function makeGamepad(move) {
  let isPushed = false;
  setInterval(() => {
    const pad = [...(navigator.getGamepads?.() ?? [])].find(Boolean);
    const [x, y] = pad && status.drive?.in_charge ? pad.axes.map((value) => (Math.abs(value) < IDLE_AXIS ? 0 : value)) : [0, 0];
    if (!x && !y && !isPushed) return;
    isPushed = pushes.held = Boolean(x || y);
    move(x, -y);
  }, MIN_INTERVAL_MS);
}

// ---------------------------------------------------------------- pulling

// A pull is repeated while it lasts, as the robot moves on below a pointer that rests.
const pulled = { sent_ms: 0, again: null };

function showPull(body, point, from, to) {
  const line = $("pull");
  clearTimeout(pulled.again);
  line.hidden = body < 0;
  if (body < 0) return press("pull");
  pulled.isKnown = true;
  if (from) {
    line.style.left = `${from[0]}px`;
    line.style.top = `${from[1]}px`;
    line.style.width = `${Math.hypot(to[0] - from[0], to[1] - from[1])}px`;
    line.style.transform = `rotate(${Math.atan2(to[1] - from[1], to[0] - from[0])}rad)`;
  }
  if (Date.now() - pulled.sent_ms >= MIN_INTERVAL_MS) {
    pulled.sent_ms = Date.now();
    press("pull", [body, ...point]);
  }
  pulled.again = setTimeout(() => scene.pull(body, ...to), MIN_INTERVAL_MS);
}

// Sliders of the program that shows the scene, such as the steps of a building plan.
function showOwnSliders() {
  const sliders = status.sliders ?? [], box = $("own-sliders");
  box.hidden = !sliders.length;
  fill(box, sliders.map(({ name, low, high }) => [name, low, high].join(" ")), "label", (label, key) => {
    const slider = sliders.find(({ name, low, high }) => [name, low, high].join(" ") === key);
    label.className = "slider";
    const input = Object.assign(document.createElement("input"), { type: "range", min: slider.low, max: slider.high, step: slider.step ?? 1 });
    input.setAttribute("aria-label", slider.name);
    input.oninput = () => press("slider", [slider.name, Number(input.value)]);
    label.append(slider.name, document.createElement("output"), input);
  });
  sliders.forEach(({ value, text }, i) => {
    const label = box.children[i], input = label.querySelector("input");
    if (document.activeElement !== input) input.value = value;
    label.querySelector("output").textContent = text ?? `${value}`;
  });
}

// ---------------------------------------------------------------- start

for (const button of document.querySelectorAll("[data-press]")) button.onclick = () => press(button.dataset.press);
$("stop").onclick = pressStop;
$("take-over").onclick = () => (otherDriver() ? press("ask") : press("take_over", !status.drive.in_charge));
$("policy").onchange = () => press("policy", $("policy").value);
$("follow").onchange = () => {
  if (scene) scene.follows = $("follow").checked;
};
$("home").onclick = () => scene?.home();
addEventListener("keydown", (event) => {
  if (event.code !== "Space" || isTyping(event)) return;
  event.preventDefault(); // or it would press the button that has the focus
  if (!event.repeat && !$("stop").hidden) pressStop();
}, { capture: true });
addEventListener("keyup", (event) => event.code === "Space" && !isTyping(event) && event.preventDefault(), { capture: true });
const isTyping = (event) => event.target === $("own-name");
cleanAddress();
$("home-page").hidden = !sessionStorage.getItem("start");
$("home-page").href = `http://${location.hostname}:${sessionStorage.getItem("start")}/`;
try {
  scene = new Scene3D($("scene"), $("metres"));
} catch (error) {
  console.warn(error);
}
const moveStick = makeStick();
makeArrows(moveStick);
makeGamepad(moveStick);
connect({
  onText: onMessage,
  onBinary,
  onChange: (reason) => {
    if (lost === reason) return;
    lost = reason;
    showState();
    showStop();
  },
  onStop: (known) => {
    if (pressed === known) return;
    pressed = known;
    showStop();
  },
});
