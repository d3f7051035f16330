// The page: what belongs together is wired up here.

import { Bench } from "./bench.js";
import { Board } from "./board.js";
import { Hub } from "./hub.js";
import { isolate, keepForOffline } from "./isolation.js";
import { readPicture, TABLE_MM } from "./picture.js";
import { FAST, Player } from "./player.js";
import { errorsOf, Printed } from "./printed.js";
import { exampleOf, linkOf, Programs, programOf, saveFile } from "./programs.js";
import { RealHub } from "./real_hub.js";
import { RealKit } from "./real_kit.js";
import { Room } from "./room.js";
import { Stage } from "./stage.js";
import { Teach } from "./teach.js";

const ROW = 8; // numbers of a frame before the poses of the robot's bodies
const OFFLINE_AFTER_MS = 5000; // until then what the visitor sees comes first
const byId = (id) => document.getElementById(id);
const json = async (name) => (await fetch(name)).json();

async function begin() {
  const state = new State();
  const programs = new Programs();
  let wanted = null; // a run that waits for Python
  let errors = []; // what each hub says about an error, as far as it has come
  let room = null;
  let teach = null; // once the page is there
  let real = null;
  let kit = null;

  const hub = new Hub({
    ready() {
      // What came of the last run stays: Python starts again after a stop that came late, too.
      if (state.name === "starting" || state.name === "failed") state.set("ready");
      if (wanted) run(...wanted);
      teach?.begin();
      setTimeout(keepForOffline, OFFLINE_AFTER_MS);
    },
    ask: (operation) => (kit.isRunning ? kit : real).ask(operation),
    happened(events, frames) {
      // Between two runs, only the real hub is heard.
      if (room?.isRunning) room.take(0, events, frames);
      else if (kit?.isRunning) kit.add(events);
      else if (real?.doing || !state.isBusy) real?.add(events);
      else (teach.isLearning ? teach : player).add(events, frames);
    },
    ended(code) {
      if (room?.isRunning) return void room.end(0, code);
      const done = kit?.end() ? "kit" : real?.end(code);
      if (done && done !== "teach") {
        state.code = code;
        finish();
        return;
      }
      if (teach.isLearning) {
        teach.end(code);
        state.set(code === 130 ? "stopped" : "finished");
        return;
      }
      endRun(code);
    },
    failed: (text, wasReady) => fail(text, wasReady),
  }, programs.robot !== "bench");

  // The program, or those of all hubs, have ended.
  function endRun(code) {
    player.end(state.isStopping || player.rate === FAST);
    state.code = code;
  }

  function fail(text, wasReady) {
    room?.abandon();
    if (teach?.isLearning) teach.end(1);
    player.abandon();
    kit?.end();
    state.set("failed");
    real?.restart();
    note(wasReady
      ? `The program was too much for this browser (${text}). Python starts again; nothing is lost.`
      : `Python could not start here (${text}). Load the page again, or try another browser: Chrome, Edge, Firefox 114 or Safari 16.4, or newer.`);
  }
  const [robots, examples, together] = await Promise.all(["robots.json", "programs.json", "together.json"].map(json));
  const stage = new Stage({
    robot: byId("robot"), world: byId("world"), view: byId("view"), canvas: byId("scene"), metres: byId("metres"),
    follow: byId("follow"), home: byId("home"), pull: byId("pull"),
  }, { robots, onPull: (message) => room.send(message), onChoice: chooseRobot, onPicture: () => byId("picture").showModal() });
  // The robot is there first: it is looked at while Python and the editor come.
  const isNew = !programs.current, linked = exampleOf(location.hash, examples), first = linked ?? examples[0];
  if (isNew || linked) Object.assign(programs, { robot: first.robot, world: first.world });
  // Who follows a link sees what it is for, on a hub alone.
  if (isNew || location.hash) programs.hubs = [];
  const partner = linked && hub.hasWayIn && partnerOf(linked);
  room = new Room(byId("hubs"), {
    hub, programs, together,
    on: {
      note,
      ready: () => wanted && run(),
      happened: (events, frames) => player.add(events, frames),
      ended: endRun,
      failed: fail,
      changed: () => chooseRobot(programs.robot, programs.world),
      selected() {
        player.select(room.selected);
        bench.select(room.selected);
        stage.robot.value = programs.robot;
        showProgram();
        bench.tell(room.devices[room.selected] ?? {});
        showErrors();
      },
    },
  });
  if (partner) room.seat(addPair(linked, partner), linked.robot, linked.world);
  const shown = room.isShared ? stage.chooseTogether(room.world, programs.robot) : stage.choose(programs.robot, programs.world);
  const [names, devices, { Editor }] = await Promise.all([json("pybricks.json"), json("devices.json"), import("./editor.js")]);
  await shown;

  const bench = new Bench(byId("bench"), { devices, onReading: (reading) => room.send({ kind: "reading", reading }) });
  const board = new Board(byId("hub"), { hubs: devices.hubs, onButton: (message) => room.send(message) });
  const printed = new Printed(byId("console"));
  const player = new Player({
    allow: (ms) => room.allow(ms),
    frame(row) {
      const own = room.rowOf(row, stage.width);
      bench.turn(own);
      stage.frame(row.subarray(ROW, ROW + stage.width));
      board.turn(own);
    },
    panel: (panel) => board.show(panel),
    time: showTime,
    caughtUp: () => (teach.isOpen && !state.isRunning ? teach.again() : finish()),
    event: show,
  });

  function show(event) {
    if (event.kind === "out") printed.out(event.text);
    else if (event.kind === "devices") tellDevices(event);
    else if (event.kind === "file") offerFile(event);
    else if (event.kind === "err" || event.kind === "note") {
      printed.append(event.text, event.kind);
      const number = event.hub ?? 0;
      if (event.kind === "err") errors[number] = (errors[number] ?? "") + event.text;
    }
  }

  // What a hub's program has on its bench.
  function tellDevices({ hub: number = 0, devices }) {
    room.devices[number] = devices;
    if (number === room.selected) bench.tell(devices);
  }

  const editor = new Editor(byId("editor"), { names, onChange: edited, onRun: () => run() });

  function edited(source) {
    if (!programs.write(source)) note("This browser does not keep your programs; save them as files.");
    editor.show([]);
    say("");
    kit?.offer(source);
    bench.take(source);
    board.take(source);
  }

  function showProgram() {
    room.keepUp();
    byId("programs").replaceChildren(...Object.keys(programs.files).map((name) => new Option(name, name, false, name === programs.current)));
    editor.load(programs.source);
    kit?.offer(programs.source);
    bench.take(programs.source);
    board.take(programs.source);
    say("");
    note("");
    byId("more").open = false;
  }

  function clearOutput() {
    errors = [];
    room.devices = [];
    note("");
    say("");
    editor.show([]);
    printed.clear();
    byId("files").replaceChildren();
    byId("save-output").hidden = true;
  }

  const toRun = () => ({ files: programs.files, name: programs.current, stdin: byId("stdin").value });

  function run() {
    if (state.isBusy) return;
    note("");
    if (!room.isReady) {
      wanted = [];
      state.set("starting");
      return;
    }
    wanted = null;
    clearOutput();
    board.sound.allow();
    player.clear(room.widthOf(stage.width));
    state.set("running");
    if (room.isShared) room.run({ robot: stage.file, picture: stage.picture, readings: room.seats.map((_, number) => bench.settingsOf(number)), ...toRun() }, stage.width);
    else hub.run({ robot: stage.file, picture: stage.picture, readings: bench.settings, ...toRun() });
    player.begin();
    setPaused(false);
  }

  // The robot tries by itself; false while another run goes on.
  function startTeaching({ isReal, ...request }) {
    if (isReal) return real.begin("teach", request);
    if (state.isBusy || !hub.isReady) return false;
    state.set("learning");
    hub.run({ robot: stage.file, picture: stage.picture, ...request });
    return true;
  }

  // Something on the real hub; false while another run goes on.
  function startOnHub(request) {
    if (state.isBusy || !hub.isReady) return false;
    state.set(request.hub === "teach" ? "learning" : request.hub === "run" ? "on the hub" : "connecting");
    hub.run({ robot: stage.file, ...request });
    return true;
  }

  // A record of frames on the stage, in real time.
  function showFrames(pieces) {
    player.clear(ROW + stage.width);
    for (const frames of pieces) player.add([], frames);
    player.begin();
    player.end(false);
    player.isPlaying = true;
  }

  async function chooseRobot(robot, world, picture = null) {
    stop();
    // The program that runs is told of its end first, and seen to have ended.
    if (state.isRunning) await state.ended();
    teach.offer(null);
    const refused = room.isShared ? room.choose(robot, world) : "";
    if (!room.isShared) Object.assign(programs, { robot, world });
    note(refused);
    programs.keep();
    player.clear(ROW);
    try {
      if (room.isShared) await stage.chooseTogether(room.world, programs.robot, picture);
      else await stage.choose(robot, world, picture);
      teach.offer(stage.lesson);
    } catch (error) {
      note(`This robot could not be fetched (${error.message}). Is there a network?`);
    }
  }

  function stop() {
    wanted = null;
    if (kit?.isRunning) return void kit.stop();
    if (real?.doing) return void real.stop();
    if (player.isRunning) {
      state.isStopping = true;
      room.stop();
    } else player.end(true);
    player.isPlaying = true;
  }

  // The run has ended, and has been shown to its end.
  function finish() {
    board.show(null);
    state.set(state.isStopping || state.code === 130 ? "stopped" : state.code ? "error" : "finished");
    byId("save-output").hidden = !printed.text;
    showErrors();
    teach.begin();
  }

  // Errors of the program that is shown; of several hubs' output each line begins with a mark.
  function showErrors() {
    const text = errors[room.selected] ?? "", own = room.isShared ? text.replace(/^.*?: /gm, "") : text;
    const found = errorsOf(own, programs.current);
    editor.show(found);
    if (found.length) say(`Line ${found[0].line}: ${found[0].message}`);
    else if (state.code && state.code !== 130) say(errors.flat().join("").trim().split("\n").at(-1) ?? "");
  }

  function offerFile({ name, text }) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = `Save ${name}`;
    button.onclick = () => saveFile(name, Uint8Array.from(text, (byte) => byte.charCodeAt(0)));
    byId("files").append(button);
  }

  function showTime(ms, latest_ms) {
    byId("clock").textContent = `${(ms / 1000).toFixed(1)} s`;
    const scrub = byId("scrub");
    scrub.max = latest_ms;
    if (document.activeElement !== scrub || player.isPlaying) scrub.value = ms;
  }

  function setPaused(isPaused) {
    player.isPlaying = !isPaused;
    byId("pause").setAttribute("aria-pressed", isPaused);
    byId("pause").textContent = isPaused ? "▶" : "❚❚";
    byId("pause").title = isPaused ? "Let time go on" : "Pause time";
    if (state.isRunning) state.set(isPaused ? "paused" : "running");
  }

  // What another hub runs beside an example.
  function partnerOf({ partner }) {
    return examples.find(({ name }) => name === partner) ?? null;
  }

  // Keep the programs of two hubs; returns their names.
  function addPair(...pair) {
    return pair.map((example) => {
      addExample(example);
      return programs.current;
    });
  }

  // Keep an example, with the files of its devices; one that is there already may have been changed.
  function addExample({ name, source, files }) {
    for (const [file, text] of Object.entries(files)) if (!(file in programs.files)) programs.add(file, text);
    programs.add(name, source);
  }

  // An example brings the robot that it is for.
  function takeExample(example) {
    const { robot, world } = example, other = hub.hasWayIn && partnerOf(example);
    if (other) return void room.open(addPair(example, other), robot, world);
    addExample(example);
    showProgram();
    if (robots.some((one) => one.name === robot) || robot === "bench") chooseRobot(robot, world ?? "");
  }

  byId("run").onclick = run;
  byId("stop").onclick = stop;
  byId("pause").onclick = () => {
    // A run that is over is shown again from its beginning.
    if (player.isCaughtUp && player.clock_ms >= player.latest_ms) player.seek(0);
    setPaused(player.isPlaying);
  };
  byId("step").onclick = () => {
    setPaused(true);
    player.step(100);
  };
  byId("scrub").oninput = () => {
    setPaused(true);
    player.seek(Number(byId("scrub").value));
  };
  byId("rate").onchange = () => (player.rate = byId("rate").value === "fast" ? FAST : Number(byId("rate").value));
  byId("picture").onclose = async () => {
    const [file] = byId("picture-file").files;
    if (byId("picture").returnValue !== "take" || !file) return;
    byId("picture").returnValue = "";
    const size_mm = byId("picture-size").value === "table" ? TABLE_MM : [Number(byId("picture-width").value)];
    try {
      const picture = await readPicture(file, size_mm);
      chooseRobot(stage.robot.value, stage.worldFor(picture.size_mm), picture);
      note("The robot stands on your picture. It is kept until this page is closed.");
    } catch (error) {
      note(error.message);
    }
  };
  byId("picture-size").onchange = () => (byId("picture-width").parentElement.hidden = byId("picture-size").value === "table");
  byId("mute").onchange = () => (board.sound.isMuted = byId("mute").checked);
  byId("programs").onchange = () => {
    programs.current = byId("programs").value;
    programs.keep();
    showProgram();
  };
  byId("examples").append(...examples.map(({ title }, i) => new Option(title, i)));
  byId("examples").onchange = () => {
    const example = examples[byId("examples").value];
    byId("examples").value = "";
    if (!example) return;
    takeExample(example);
  };
  byId("new").onclick = () => {
    programs.add("main.py", "from pybricks.hubs import PrimeHub\nfrom pybricks.tools import wait\n\nhub = PrimeHub()\n\nhub.display.char(\"A\")\nwait(2000)\n");
    showProgram();
  };
  byId("rename").onclick = () => {
    const name = prompt("Name of the program", programs.current);
    if (name) programs.rename(name);
    showProgram();
  };
  byId("remove").onclick = () => {
    if (!confirm(`Delete ${programs.current}?`)) return;
    programs.remove();
    if (!programs.current) programs.add(examples[0].name, examples[0].source);
    showProgram();
  };
  byId("open").onclick = () => byId("file").click();
  byId("file").onchange = async () => {
    for (const file of byId("file").files) programs.add(file.name, await file.text());
    byId("file").value = "";
    showProgram();
  };
  byId("save").onclick = () => saveFile(programs.current, programs.source);
  byId("save-output").onclick = () => saveFile(programs.current.replace(/\.py$/, ".txt"), printed.text);
  byId("share").onclick = async () => {
    const link = await linkOf({ name: programs.current, source: programs.source, robot: programs.robot, world: programs.world });
    byId("more").open = false;
    try {
      await navigator.clipboard.writeText(link);
      note("The link is copied. Whoever opens it gets this program.");
    } catch {
      note(`The link: ${link}`);
    }
  };
  state.onChange = (name) => {
    byId("run").disabled = state.isBusy;
    byId("stop").disabled = !state.isBusy && !wanted;
  };

  real = new RealHub(byId("real"), {
    buttons: { bluetooth: byId("connect"), cable: byId("connect-cable") }, names: await json("links.json"), hub,
    on: {
      note,
      start: startOnHub,
      run() {
        if (state.isBusy || !hub.isReady) return;
        clearOutput();
        real.begin("run", toRun());
      },
      event: (event) => (teach.isLearning ? teach.add([event], new Float32Array()) : show(event)),
      changed: () => teach?.meet(real?.isConnected),
    },
  });
  kit = new RealKit(byId("kit"), {
    button: byId("run-on-kit"), hub,
    on: {
      note,
      show,
      start() {
        if (state.isBusy || !hub.isReady) return false;
        if (real.isConnected) return void note("Disconnect the hub first.");
        clearOutput();
        state.set("on the devices");
        hub.run({ hub: "kit", ...toRun() });
        return true;
      },
    },
  });
  teach = new Teach(byId("teach"), {
    button: byId("teach-it"),
    on: {
      start: startTeaching,
      stop: () => (real.doing ? real.stop() : hub.stop()),
      goOn: () => real.goOn(),
      show: showFrames,
      opened(isOpen) {
        document.body.classList.toggle("teaching", isOpen);
        stop();
      },
      take(name, source) {
        teach.close();
        programs.add(name, source);
        showProgram();
        note("This program acts by the best numbers. Press Run; Pybricks Code and `brickhub run` run it, too.");
      },
    },
  });
  teach.offer(stage.lesson);

  const shared = await programOf(location.hash);
  if (shared) {
    programs.add(shared.name ?? "shared.py", shared.source);
    history.replaceState(null, "", location.pathname + location.search);
    if (shared.robot) chooseRobot(shared.robot, shared.world ?? "");
  } else if ((isNew || linked) && !partner) addExample(first);
  showProgram();
  if (!hub.hasWayIn) note.standing = "This browser, or the address (it needs https), gives no way into a running program: sliders and buttons act from the next run on.";
  note(shared ? "This program came with the link. Look at it, then press Run." : "");
  // Who comes for the first time, or to an example, sees what happens here; what somebody else has sent is not run unasked.
  if ((isNew && !shared) || linked) run();
  // Tests look whether the page is there.
  document.body.dataset.page = "there";
}

// What is always so is said whenever there is nothing else to say.
function note(text) {
  text ||= note.standing ?? "";
  byId("note").textContent = text;
  byId("note").hidden = !text;
}

function say(text) {
  byId("error").textContent = text;
  byId("error").hidden = !text;
}

// What the page does now, and its word for it.
class State {
  constructor() {
    this.name = "starting";
    this.code = 0;
    this.isStopping = false;
    this.onChange = () => {};
    this.waiting = []; // for the end of a program
  }

  // Resolves once no program runs.
  ended() {
    return new Promise((resolve) => (this.isRunning ? this.waiting.push(resolve) : resolve()));
  }

  get isBusy() {
    return this.isRunning || ["learning", "on the hub", "on the devices", "connecting"].includes(this.name);
  }

  get isRunning() {
    return this.name === "running" || this.name === "paused";
  }

  set(name) {
    if (name === "running" && this.name !== "paused") this.isStopping = false;
    this.name = name;
    byId("state").textContent = name;
    byId("state").className = `chip ${name}`;
    this.onChange(name);
    if (!this.isRunning) for (const resolve of this.waiting.splice(0)) resolve();
  }
}

if (await isolate()) await begin();
