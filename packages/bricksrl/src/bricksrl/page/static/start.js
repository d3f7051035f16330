// Start page: cards of environments, runs, plans and jobs. All state is the server's.

import { short } from "./charts.js";
import { $, cleanAddress, connect, element, fill, press } from "./connection.js";
import { hear, showVisitors, you } from "./visitors.js";

const TEXTS = { play: "Play", train: "Train", drive: "Drive", game: "Play together" };
const DOES = { play: "plays", drive: "is driven", game: "is played", train: "learns", watch: "is shown", compare: "are compared", class: "are listed", build: "is built", look: "is looked at", teach: "learns", booklet: "gets its booklet", check: "is checked" };
let status = {}, awaited = null;
const chosen = new Set();

function show() {
  $("message").hidden = !status.message;
  $("message").textContent = status.message ?? "";
  showVisitors(status);
  fill($("envs"), status.cards ?? [], "article", (card, { env, summary, is_arena }) => {
    card.className = "env";
    card.setAttribute("aria-label", env);
    const picture = element("img", { src: `${env}.jpg`, alt: "", loading: "lazy" });
    const buttons = (is_arena ? ["game"] : ["play", "train", "drive"]).map((action) => starter(TEXTS[action], action, env));
    buttons[0].className = "main";
    card.append(picture, element("h3", { textContent: env }), element("p", { textContent: summary }), element("div", { className: "row" }, ...buttons));
  });
  showRuns();
  showDrawings();
  fill($("build").querySelector("ul"), status.plans ?? [], "li", (item, plan) => {
    item.append(element("b", { textContent: plan }), starter("Step by step in 3D", "build", plan), booklet(plan));
  });
  fill($("check-env"), (status.cards ?? []).filter(({ is_arena }) => !is_arena).map(({ env }) => env), "option", (option, name) => (option.textContent = name));
  showJobs();
}

// The booklet of a plan: one that is drawn already opens at once.
function booklet(plan) {
  const text = "Booklet (PDF)";
  if (!(status.booklets ?? []).includes(plan)) return starter(text, "booklet", plan);
  return element("a", { className: "button", textContent: text, href: `booklets/${plan}.pdf`, target: "_blank" });
}

// A button that starts a job, and opens its page once there is one.
function starter(text, action, about) {
  const button = element("button", { type: "button", textContent: text });
  button.onclick = () => start(action, about);
  return button;
}

function start(action, about) {
  // What was found in a drawing is shown where it was asked for.
  if (action === "look") {
    press(action, about);
    return;
  }
  awaited = { action, after: Math.max(0, ...(status.jobs ?? []).map(({ number }) => number)) };
  press(action, about);
  scrollTo(0, 0);
}

function showDrawings() {
  const drawings = status.drawings ?? [], section = $("drawings");
  $("folder").textContent = status.folder ?? "";
  fill(section.querySelector("ul"), drawings, "li", (item, { name, found }) => {
    item.append(element("b", { textContent: name }));
    if (!found) {
      item.append(starter("What can it learn?", "look", name));
      return;
    }
    if (found.error) {
      item.append(element("small", { className: "found", role: "alert", textContent: found.error }));
      return;
    }
    const devices = [...found.motors.map(({ port, name, moves }) => `${port}  ${name} ${moves}`), ...found.sensors.map(({ port, name, looks }) => `${port}  ${name} looks ${looks || "askew"}`)];
    item.append(element("small", { className: "found", textContent: [found.hub, ...devices, ...found.notes].join("\n") }));
    const can = found.abilities.filter(({ reason }) => !reason), cannot = found.abilities.filter(({ reason }) => reason);
    const row = element("div", { className: "row" }, ...can.map((ability) => starter(`Teach it to ${ability.sentence}`, "teach", `${name}:${ability.name}`)));
    if (can.length) row.firstChild.className = "main";
    const remarks = can.filter(({ remark }) => remark).map(({ sentence, remark }) => `${sentence}: ${remark}`).join("\n");
    if (remarks) item.append(element("small", { className: "found", textContent: remarks }));
    const reasons = cannot.map(({ sentence, reason }) => `${sentence}: ${reason}`).join("\n");
    item.append(row, element("details", {}, element("summary", { textContent: "What it cannot learn, and why" }), element("small", { className: "found", textContent: reasons })));
  });
}

function showRuns() {
  const runs = status.runs ?? [], section = $("runs");
  const untrusted = status.untrusted ?? [], [first] = untrusted;
  section.querySelector(".hint").hidden = runs.length + untrusted.length > 0;
  $("untrusted").hidden = !first;
  const number = untrusted.length === 1 ? "1 run is" : `${untrusted.length} runs are`;
  $("untrusted").textContent = `${number} from elsewhere and would run code: ${untrusted.map(({ name }) => name).join(", ")}. `
    + `Read that code, then allow it in a terminal: ${first?.allow}`;
  section.querySelector(".row").hidden = runs.length < 2;
  fill(section.querySelector("ul"), runs, "li", (item, run) => {
    const box = element("input", { type: "checkbox", checked: chosen.has(run.name) });
    box.setAttribute("aria-label", `Compare ${run.name}`);
    box.onchange = () => {
      box.checked ? chosen.add(run.name) : chosen.delete(run.name);
      $("compare").disabled = chosen.size < 2;
    };
    const about = element("small", { textContent: `${run.agent}, ${run.episodes} episodes, seed ${run.seed} · ${run.name}` });
    const score = element("output", {}, element("b", { textContent: run.return === null ? "" : short(run.return) }), element("small", { textContent: run.score }));
    const title = element("b", { textContent: run.pupil ? `${run.pupil} · ${run.env}` : run.env });
    const home = element("span", { className: "home" });
    if (run.has_report) home.append(element("a", { textContent: "Report", href: `runs/${encodeURIComponent(run.name)}/report.html`, target: "_blank", title: "print it: one sheet to hand out" }));
    if (run.has_film) home.append(element("a", { textContent: "Film", href: `runs/${encodeURIComponent(run.name)}/before_after.mp4`, download: `${run.pupil || run.name}.mp4` }));
    item.append(element("label", {}, box, element("span", {}, title, about)), curve(run.points), score, home, starter("Watch", "watch", run.name));
  });
}

function curve(points) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg"), line = document.createElementNS(svg.namespaceURI, "polyline");
  const low = Math.min(...points), span = Math.max(...points) - low || 1;
  svg.setAttribute("viewBox", "0 0 100 40");
  svg.setAttribute("preserveAspectRatio", "none");
  line.setAttribute("points", points.map((value, i) => `${(100 * i) / Math.max(1, points.length - 1)},${37 - (34 * (value - low)) / span}`).join(" "));
  svg.append(line);
  return svg;
}

function showJobs() {
  const jobs = status.jobs ?? [];
  fill($("jobs"), jobs.map(({ number }) => number), "article", (card, number) => {
    const job = jobs.find((one) => one.number === number);
    card.className = "job";
    card.dataset.action = job.action.split(" ")[0];
    const end = element("button", { type: "button", textContent: "End", onclick: () => press("end", number) });
    const title = element("b", { textContent: `${job.about} ${DOES[job.action.split(" ")[0]]}` }, element("small", { className: "whose" }));
    card.append(element("div", { className: "row" }, title, element("span", { className: "chip" }), element("a", { className: "main", textContent: "Open" }), end), element("pre", {}));
  });
  jobs.forEach((job, i) => {
    const card = $("jobs").children[i], [, chip, link, end] = card.firstChild.children, pre = card.querySelector("pre");
    const isRunning = job.code === null, state = isRunning ? (job.url || job.lines.length ? "running" : "starting") : [0, 130].includes(job.code) || job.code < 0 ? "done" : "failed";
    card.classList.toggle("over", !isRunning);
    chip.textContent = state;
    chip.className = `chip ${{ done: "finished", failed: "stopped" }[state] ?? ""}`;
    link.hidden = !(isRunning && job.url);
    if (job.url) link.href = address(job.url);
    const isMine = !job.owner || job.owner === you.name;
    end.hidden = !isRunning;
    end.textContent = isMine ? "End" : `Ask ${job.owner} to end it`;
    card.querySelector(".whose").textContent = [isMine ? "" : job.owner, job.why].filter(Boolean).map((text) => ` · ${text}`).join("");
    const text = job.lines.join("\n");
    if (pre.textContent !== text) {
      pre.textContent = text;
      pre.scrollTop = pre.scrollHeight;
    }
    showResult(card, job);
    if (isRunning && job.url && awaited?.action === job.action && job.number > awaited.after && (!job.owner || job.owner === you.name)) {
      awaited = null;
      location.assign(address(job.url));
    }
  });
}

// The picture of a comparison, and the booklet.
function showResult(card, { action, number, code }) {
  if (code !== 0 || card.querySelector(".result")) return;
  if (action === "compare") card.append(element("img", { className: "result", src: `${number}.png`, alt: "Learning curves" }));
  if (action === "booklet") card.append(element("a", { className: "result main", href: `${number}.pdf`, target: "_blank", textContent: "Open the booklet" }));
}

// A job's page, by the name under which this page was reached, told where to come back to.
function address(url) {
  const to = new URL(url);
  to.hostname = location.hostname;
  to.hash = `start=${location.port || 80}`;
  return to.href;
}

$("class").onclick = () => start("class", "runs");
$("compare").onclick = () => start("compare", [...chosen]);
$("check-start").onclick = () => start(`check ${$("check-hub").value}`, $("check-env").value);
cleanAddress();
connect({
  onText: (message) => {
    if (message.you) hear(message.you);
    if (!message.you && !message.status) return;
    status = message.status ?? status;
    show();
  },
  onChange: (reason) => {
    $("state").hidden = !reason;
    $("state").textContent = reason;
    $("state").className = "chip lost";
  },
});
