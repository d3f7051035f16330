// Connection to the server of a page: messages from it, presses to it, and the port of the start page that it was opened from.

export const $ = (id) => document.getElementById(id);
const PING_MS = 1000, SILENT_MS = 4000, OPEN_MS = 5000, MAX_RETRY_MS = 5000, GIVE_UP_MS = 600000, STOP_MS = 1000, RESEND_MS = 10000, SILENT = 4000, GOING_AWAY = 1001;
let socket = null, handlers = null, retry_ms = 300, timer = 0, isOver = false;
let heard_ms = 0; // when the server answered last
let begun_ms = 0; // when the present attempt to connect began
const stopped = { number: 0, pressed_ms: 0, heard: 0 };

// onText: a message; onBinary: an array; onChange: "" while connected, else the reason why not; onStop: what is known of a press
// of the stop: "asked", "sent" or "silent".
export function connect(given) {
  handlers = given;
  heard_ms = Date.now();
  open();
  setInterval(watch, PING_MS / 4);
  for (const event of ["online", "pageshow"]) addEventListener(event, wake);
  document.addEventListener("visibilitychange", () => document.hidden || wake());
}

function open() {
  clearTimeout(timer);
  begun_ms = Date.now();
  const mine = (socket = new WebSocket(`ws://${location.host}/ws`));
  let wasOpen = false;
  mine.binaryType = "arraybuffer";
  mine.onopen = () => {
    wasOpen = true;
    retry_ms = 300;
    heard();
    ping();
    if (stopped.heard < stopped.number && Date.now() - stopped.pressed_ms < RESEND_MS) sendStop();
  };
  mine.onmessage = ({ data }) => {
    if (socket !== mine) return;
    if (typeof data !== "string") return handlers.onBinary?.(data);
    const message = JSON.parse(data);
    if (message.pong !== undefined) return heard();
    if (message.heard !== undefined) return stopHeard(message.heard);
    handlers.onText(message);
  };
  mine.onclose = ({ code, reason }) => {
    if (socket !== mine) return;
    if (code === GOING_AWAY && reason) return end(reason); // the server's last word
    handlers.onChange("no connection");
    if (wasOpen) retry();
    else refusal().then((isRefused) => (isRefused ? end("this page has ended") : retry()));
  };
}

// Whether another program, or a later page, answers here: it does not know us, and never will.
async function refusal() {
  try {
    return (await fetch("visitors.json", { cache: "no-store", signal: AbortSignal.timeout(OPEN_MS) })).status === 403;
  } catch {
    return false;
  }
}

function end(reason) {
  isOver = true;
  socket = null;
  handlers.onChange(reason);
}

function retry() {
  if (Date.now() - heard_ms > GIVE_UP_MS) return end("no connection; reload to try again");
  timer = setTimeout(open, retry_ms);
  retry_ms = Math.min(MAX_RETRY_MS, retry_ms * 1.5);
}

function heard() {
  heard_ms = Date.now();
  handlers.onChange("");
}

let pinged_ms = 0;

function ping() {
  pinged_ms = Date.now();
  socket.send(JSON.stringify({ press: "ping", value: pinged_ms }));
}

// The server is asked each second whether it is there. A connection without answers is dead, whatever it says of itself.
function watch() {
  if (isOver || !socket) return;
  const now_ms = Date.now();
  if (stopped.heard < stopped.number && now_ms - stopped.pressed_ms > STOP_MS) handlers.onStop?.("silent");
  if (socket.readyState === WebSocket.OPEN) {
    if (now_ms - heard_ms > SILENT_MS) return again();
    if (now_ms - pinged_ms >= PING_MS) ping();
  } else if (socket.readyState === WebSocket.CONNECTING && now_ms - begun_ms > OPEN_MS) again();
}

function again() {
  const dead = socket;
  handlers.onChange("no connection");
  socket = null;
  dead.close(SILENT, "silent"); // its end may take a minute, and is not waited for
  open();
}

// A phone that slept, or has its network again.
function wake() {
  if (isOver) return;
  watch();
  if (socket?.readyState === WebSocket.CLOSED) open();
}

export function press(name, value = null) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ press: name, value }));
}

// A stop is numbered, so that its answer is known; it is sent once more if the connection comes back soon.
export function pressStop() {
  stopped.number += 1;
  stopped.pressed_ms = Date.now();
  handlers.onStop?.("asked");
  sendStop();
}

function sendStop() {
  press("stop", stopped.number);
}

function stopHeard(number) {
  stopped.heard = Math.max(stopped.heard, number);
  heard();
  if (stopped.heard === stopped.number) handlers.onStop?.("sent");
}

// One child per name. The children are replaced only when the names change, or a press would lose its button.
export function fill(parent, names, tag, setUp) {
  const key = JSON.stringify(names);
  if (parent.dataset.names === key) return;
  parent.dataset.names = key;
  parent.replaceChildren(...names.map((name) => {
    const child = document.createElement(tag);
    setUp(child, name);
    return child;
  }));
}

export function element(tag, properties, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

// The token in the address is in a cookie now; a start page names its port behind the address.
export function cleanAddress() {
  const port = location.hash.match(/^#start=(\d+)$/)?.[1];
  if (port) sessionStorage.setItem("start", port);
  if (location.search || location.hash) history.replaceState(null, "", "/");
}
