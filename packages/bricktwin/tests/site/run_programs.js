// Page of a test: what a visitor sees in this browser, then programs in a worker of this page; all is told to the test's server.

import { Hub } from "./hub.js";
import { isolate } from "./isolation.js";

const tell = (answer) => fetch("told", { method: "POST", body: JSON.stringify(answer) });
const pause = (ms) => new Promise((done) => setTimeout(done, ms));

// The site itself, in a frame, with an example on a robot.
async function visit() {
  const frame = document.querySelector("iframe"), find = (selector) => frame.contentDocument.querySelector(selector);
  const seconds = () => parseFloat(find("#clock")?.textContent ?? "0");
  // Where this page had to load itself once more, the frame's first visit is over.
  while (!/ready|running/.test(find("#state")?.textContent)) await pause(100);
  if (find("#state").textContent === "ready") find("#run").click();
  while (!(seconds() > 1)) await pause(100);
  const told = {
    state: find("#state").textContent, seconds: seconds(), printed: find("#console").textContent,
    isDrawn: !find("#view").textContent.includes("cannot be drawn"), note: find("#note").textContent,
  };
  find("#stop").click();
  while (!["stopped", "finished"].includes(find("#state").textContent)) await pause(50);
  frame.remove();
  return told;
}

async function runAll() {
  const programs = await (await fetch("programs_to_run.json")).json();
  let ended;
  const hub = await new Promise((done) => {
    const made = new Hub({ ready: () => done(made), happened: () => {}, ended: () => {}, failed: (text) => ended([text]) });
  });
  const answers = [];
  for (const files of programs) {
    const printed = { out: [], err: [] };
    hub.on.happened = (events) => events.forEach(({ kind, text }) => printed[kind]?.push(text));
    answers.push(await new Promise((done) => {
      ended = done;
      hub.on.ended = (code) => done([code, printed.out.join(""), printed.err.join("")]);
      hub.run({ files, name: "main.py", readings: [], time_limit_s: 600 });
      hub.allow(Infinity);
    }));
  }
  return answers;
}

try {
  if (await isolate()) {
    const visited = await visit();
    await tell({ browser: navigator.userAgent, isIsolated: crossOriginIsolated, visited, answers: await runAll() });
  }
} catch (error) {
  await tell({ failed: String(error?.stack ?? error) });
}
