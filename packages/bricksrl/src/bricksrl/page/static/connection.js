// Connection to the server of a page: messages from it, presses to it, and the port of the start page that it was opened from.

export const $ = (id) => document.getElementById(id);
let socket = null, retry_ms = 300, ended = "";

// onText: a message; onBinary: an array; onChange: "" while connected, else the reason why not.
export function connect(handlers) {
  socket = new WebSocket(`ws://${location.host}/ws`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    [retry_ms, ended] = [300, ""];
    handlers.onChange("");
  };
  socket.onmessage = ({ data }) => (typeof data === "string" ? handlers.onText(JSON.parse(data)) : handlers.onBinary?.(data));
  socket.onclose = ({ reason }) => {
    ended ||= reason; // the server's last word
    handlers.onChange(ended || "no connection");
    setTimeout(() => connect(handlers), retry_ms);
    retry_ms = Math.min(5000, retry_ms * 1.5);
  };
}

export function press(name, value = null) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ press: name, value }));
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
