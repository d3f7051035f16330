// Script of a test, in the site's own page, which somebody has opened by the address of an example for two hubs: it tells the test's
// server what is there in the end. (In a frame, WebKitGTK gives no memory to share.)

const PATIENCE_MS = 300_000;
const tell = (answer) => fetch("told", { method: "POST", body: JSON.stringify(answer) });
const pause = (ms) => new Promise((done) => setTimeout(done, ms));
const find = (selector) => document.querySelector(selector), textOf = (selector) => find(selector)?.textContent;
const tabs = () => [...document.querySelectorAll("#hubs [role=tab]")];

// What is there when nothing comes any more.
setTimeout(() => tell({ failed: JSON.stringify(["#state", "#hubs", "#note", "#console", "#clock", "#error"].map(textOf)) }), PATIENCE_MS);

// Where the page loads itself once more, this script begins anew, too. On a busy computer the service worker may come too late at
// the first visit, and the page says that it has no way in: then it is loaded again, as a person would.
while (!tabs().length || textOf("#state") !== "running") {
  const isAlone = document.body.dataset.page === "there" && !crossOriginIsolated;
  if (isAlone && !sessionStorage.getItem("loaded-again")) {
    sessionStorage.setItem("loaded-again", "yes");
    location.reload();
  }
  await pause(100);
}
const opened = tabs().map(({ textContent }) => textContent);
while (textOf("#state") === "running") await pause(100);
const shown = tabs().map((_, number) => {
  tabs()[number].click();
  return find("#programs").value;
});
await tell({
  opened, shown, isIsolated: crossOriginIsolated, state: textOf("#state"), printed: textOf("#console"), robot: find("#robot").value,
  isDrawn: !textOf("#view").includes("cannot be drawn"),
});
