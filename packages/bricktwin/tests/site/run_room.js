// Page of a test: what a visitor sees in this browser who opens the address of an example for two hubs; it is told to the test's server.

import { isolate } from "./isolation.js";

const tell = (answer) => fetch("told", { method: "POST", body: JSON.stringify(answer) });
const pause = (ms) => new Promise((done) => setTimeout(done, ms));
const ENDED = /finished|error|stopped|failed/;
const PATIENCE_MS = 300_000;

async function visit() {
  const frame = document.querySelector("iframe"), find = (selector) => frame.contentDocument.querySelector(selector);
  // Only now: a frame of a page that is not isolated yet is not, either, and shares no memory.
  frame.src = "./#example=hear.py";
  while (frame.contentWindow.location.pathname === "blank") await pause(100);
  while (!find("#hubs [role=tab]") || !/running|ready/.test(find("#state")?.textContent)) await pause(100);
  const opened = [...frame.contentDocument.querySelectorAll("#hubs [role=tab]")].map(({ textContent }) => textContent);
  if (find("#state").textContent === "ready") find("#run").click();
  while (!ENDED.test(find("#state").textContent)) await pause(100);
  const [first, second] = frame.contentDocument.querySelectorAll("#hubs [role=tab]");
  const shown = [];
  for (const tab of [first, second]) {
    tab.click();
    shown.push(find("#programs").value);
  }
  return {
    opened, shown, state: find("#state").textContent, printed: find("#console").textContent, robot: find("#robot").value,
    isDrawn: !find("#view").textContent.includes("cannot be drawn"), note: find("#note").textContent,
  };
}

// What is there when nothing comes any more.
setTimeout(() => {
  const { contentDocument: page } = document.querySelector("iframe"), text = (selector) => page.querySelector(selector)?.textContent;
  tell({ failed: JSON.stringify(["#state", "#hubs", "#note", "#console", "#clock", "#error"].map(text)) + isSecureContext + crossOriginIsolated });
}, PATIENCE_MS);
try {
  if (await isolate()) await tell({ browser: navigator.userAgent, isIsolated: crossOriginIsolated, visited: await visit() });
} catch (error) {
  await tell({ failed: String(error?.stack ?? error) });
}
