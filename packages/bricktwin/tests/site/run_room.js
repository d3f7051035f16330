// Script of a test, in the site's own page, which somebody has opened by the address of an example for two hubs: it tells the test's
// server what is there in the end.

const PATIENCE_MS = 300_000;
const tell = (answer) => fetch("told", { method: "POST", body: JSON.stringify(answer) });
const pause = (ms) => new Promise((done) => setTimeout(done, ms));
const find = (selector) => document.querySelector(selector), textOf = (selector) => find(selector)?.textContent;
const tabs = () => [...document.querySelectorAll("#hubs [role=tab]")];

// What is there when nothing comes any more.
setTimeout(() => tell({ failed: JSON.stringify(["#state", "#hubs", "#note", "#console", "#clock", "#error"].map(textOf)) }), PATIENCE_MS);

// Where the page loads itself once more, this script begins anew, too. A browser without memory to share opens the first hub alone.
const hasMemory = typeof SharedArrayBuffer === "function";
while ((hasMemory && !tabs().length) || textOf("#state") !== "running") await pause(100);
const opened = tabs().map(({ textContent }) => textContent);
while (textOf("#state") === "running") await pause(100);
const shown = tabs().map((_, number) => {
  tabs()[number].click();
  return find("#programs").value;
});
await tell({
  opened, shown, hasMemory, note: textOf("#note"), isIsolated: crossOriginIsolated, state: textOf("#state"), printed: textOf("#console"), robot: find("#robot").value,
  isDrawn: !textOf("#view").includes("cannot be drawn"),
});
