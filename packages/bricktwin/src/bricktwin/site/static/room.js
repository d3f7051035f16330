// Room of several hubs: each has a worker of its own, whose programs tell one another what they do (tab/room.py). The page has one
// clock and one record for all of them, and shows the panel of the hub that is selected.

import { make } from "./bench.js";
import { Hub } from "./hub.js";
import { Mailbox } from "./mailbox.js";
import { COLOURS } from "./together.js";

const BENCH = "bench", ROW = 8, STEP_MS = 5, REFUSED_CODE = 2, MOST = 4, RING_BYTES = 1 << 20;
const ALONE = "This robot is alone: it stands on a fixed base, has no Bluetooth, or a hand holds it. Remove the other hubs first.";

export class Room {
  // `hub`: the first one. `programs`: of the user. `together`: together.json. `on`: ready(), selected(), changed(), happened(events,
  // frames), ended(code), failed(text), note(text).
  constructor(element, { hub, programs, together, on }) {
    Object.assign(this, { element, programs, together, on });
    this.hubs = [hub];
    this.isRunning = false;
    this.devices = []; // on the bench of each hub, as the page has been told
    // What was kept by an address that gives memory to share may be opened at one that does not.
    if (!hub.hasWayIn) programs.hubs = [];
    this.seats.slice(1).forEach(() => this.addHub());
    this.show();
  }

  // Program and robot of each hub; empty for a hub alone.
  get seats() {
    return this.programs.hubs;
  }

  get isShared() {
    return this.seats.length > 1;
  }

  get selected() {
    return this.isShared ? this.programs.hub : 0;
  }

  get isReady() {
    return this.hubs.every((hub) => hub.isReady);
  }

  // Robots that share a world: the files of each hub's robot, the world, and all worlds that there are; null for benches.
  get world() {
    if (!this.isShared || !this.seats.every(({ robot }) => this.canShare(robot))) return null;
    const { robots, worlds } = this.together, fitting = worlds.filter(({ most }) => most >= this.seats.length);
    const world = fitting.find(({ name }) => name === this.programs.world) ?? fitting[0];
    return { robots: this.seats.map(({ robot }) => robots[robot]), world, worlds: fitting };
  }

  canShare(robot) {
    return robot in this.together.robots;
  }

  // ---------------------------------------------------------------- hubs

  add() {
    if (!this.hubs[0].hasWayIn) return this.on.note("Several hubs need memory that they share, and this browser, or the address (it needs https), gives none.");
    const { programs } = this;
    if (!this.isShared) programs.hubs = [{ program: programs.current, robot: programs.robot }];
    const { robot } = this.seats[0], isAlone = robot !== BENCH && !this.canShare(robot);
    if (isAlone) this.seats.forEach((seat) => (seat.robot = BENCH));
    this.seats.push({ program: programs.current, robot: isAlone ? BENCH : robot });
    this.addHub();
    this.select(this.seats.length - 1);
    this.on.changed();
    if (isAlone) this.on.note("This robot is alone in its world, so that each hub has a bench now.");
  }

  // Programs, on a hub each; with robots of that name if these share a world.
  open(names, robot, world) {
    this.seat(names, robot, world);
    this.select(0);
    this.on.changed();
  }

  seat(names, robot, world) {
    const given = this.canShare(robot) ? robot : BENCH;
    Object.assign(this.programs, { hubs: names.map((program) => ({ program, robot: given })), hub: 0, current: names[0], robot: given, world });
    while (this.hubs.length < names.length) this.addHub();
    while (this.hubs.length > names.length) this.hubs.pop().leave();
    this.show();
  }

  addHub() {
    const number = this.hubs.length;
    this.hubs.push(new Hub({
      ready: () => this.on.ready(),
      happened: (events, frames) => this.take(number, events, frames),
      ended: (code) => this.end(number, code),
      failed: (text, wasReady) => this.on.failed(text, wasReady),
      ask() {},
    }, Boolean(this.world)));
  }

  remove() {
    this.seats.splice(this.selected, 1);
    // The worker of the last one goes: workers are of no program in particular.
    this.hubs.pop().leave();
    const [{ program, robot }] = this.seats;
    Object.assign(this.programs, { current: program, robot, hub: 0 });
    if (!this.isShared) this.programs.hubs = [];
    this.on.changed();
    this.select(0);
  }

  // Another hub is looked at: its program, its panel.
  select(number) {
    const { programs } = this, seat = this.seats[number];
    if (seat) Object.assign(programs, { hub: number, current: seat.program, robot: seat.robot });
    programs.keep();
    this.show();
    this.on.selected();
  }

  // The program of the selected hub is another one, or programs are gone.
  keepUp() {
    const { programs } = this;
    if (this.isShared) this.seats[this.selected].program = programs.current;
    for (const seat of this.seats) if (!(seat.program in programs.files)) seat.program = programs.current;
    programs.keep();
    this.show();
  }

  // The selected hub gets another robot, and all of them another world, if one is named: all are on benches, or all robots share a world.
  // Returns what could not be done.
  choose(robot, world) {
    const seat = this.seats[this.selected];
    if (robot !== BENCH && !this.canShare(robot)) return ALONE;
    seat.robot = robot;
    // Who has a bench gets the same robot, and nobody has one if this hub gets a bench.
    for (const one of this.seats) if (robot === BENCH || one.robot === BENCH) one.robot = robot;
    this.programs.robot = robot;
    const wanted = world || this.programs.world;
    this.programs.world = wanted;
    this.programs.world = this.world?.world.name ?? "";
    this.show();
    const isOther = this.world && wanted && wanted !== this.programs.world;
    return isOther ? `There is no ${wanted.replaceAll("-", " ")} for ${this.seats.length} robots: it has no room for them, or is made for one robot alone.` : "";
  }

  show() {
    const isWorld = Boolean(this.world);
    const tabs = this.seats.map(({ program }, number) => {
      const dot = make("i", { className: "dot", hidden: !isWorld });
      if (isWorld) dot.style.background = `rgb(${COLOURS[number].map((share) => Math.round(255 * share))})`;
      const tab = make("button", { type: "button", role: "tab", onclick: () => this.select(number) }, dot, `Hub ${number + 1}: ${program}`);
      tab.setAttribute("aria-selected", number === this.selected);
      return tab;
    });
    const add = make("button", { type: "button", className: "small", id: "add-hub", textContent: "+ Another hub", title: "A hub in the same room, with a program of its own", onclick: () => this.add() });
    const remove = make("button", { type: "button", className: "small", id: "remove-hub", textContent: "Remove this hub", onclick: () => this.remove() });
    for (const button of [add, remove]) button.disabled = this.isRunning;
    add.hidden = this.seats.length >= MOST;
    remove.hidden = !this.isShared;
    this.element.replaceChildren(...(tabs.length ? [make("div", { role: "tablist", ariaLabel: "Hubs of the room", className: "row" }, ...tabs)] : []), add, remove);
  }

  // ---------------------------------------------------------------- a run

  // Numbers of a frame of all hubs: that of the first one with the poses, then those of the others.
  widthOf(poses) {
    return ROW + poses + (ROW - 1) * Math.max(0, this.seats.length - 1);
  }

  // Frame of the selected hub alone.
  rowOf(row, poses) {
    if (this.selected === 0) return row.subarray(0, ROW);
    const start = ROW + poses + (ROW - 1) * (this.selected - 1);
    return Float32Array.of(row[0], ...row.subarray(start, start + ROW - 1));
  }

  // `readings`: of each hub's bench.
  run({ readings, ...request }, poses) {
    const count = this.seats.length, programs = this.seats.map(({ program }) => program);
    const boxes = programs.map(() => programs.map(() => Mailbox.create(RING_BYTES).memory));
    this.boxes = boxes;
    this.poses = poses;
    this.codes = Array(count).fill(null);
    this.told_ms = Array(count).fill(-1);
    this.events = [];
    this.rows = programs.map(() => []);
    this.last = programs.map(() => new Float32Array(ROW).fill(NaN));
    this.lastPoses = new Float32Array(poses);
    this.isRunning = true;
    programs.forEach((name, number) => {
      const told = boxes[number].filter((_, other) => other !== number), heard = boxes.map((row) => row[number]);
      this.hubs[number].run({ ...request, name, readings: readings[number], seat: { number, programs }, boxes: { told, heard } });
    });
    this.show();
  }

  take(number, events, frames) {
    if (!this.isRunning) return;
    const width = ROW + this.poses;
    for (const event of events) this.events.push({ ...event, hub: number });
    for (let i = 0; i + width <= frames.length; i += width) this.rows[number].push(frames.subarray(i, i + width));
    this.told_ms[number] = this.rows[number].at(-1)?.[0] ?? this.told_ms[number];
    this.release();
  }

  end(number, code) {
    if (!this.isRunning) return;
    this.codes[number] = code;
    this.told_ms[number] = Infinity;
    // A worker that was ended reads no more, and nobody has to wait for it.
    for (const row of this.boxes) new Mailbox(row[number]).close();
    this.release();
    if (this.codes.every((one) => one !== null)) {
      this.isRunning = false;
      this.show();
      this.on.ended(this.codes.find((one) => one) ?? 0);
    } else if (code === REFUSED_CODE) this.stop();
  }

  // What all hubs have come to goes to the page, in the order of a terminal: by control loops, and in each by hubs.
  release() {
    const until_ms = Math.min(...this.told_ms), step = (ms) => Math.floor(ms / STEP_MS);
    const isOver = ({ ms }) => step(ms) < step(until_ms);
    const events = this.events.filter(isOver).sort((one, other) => step(one.ms) - step(other.ms) || one.hub - other.hub);
    this.events = this.events.filter((event) => !isOver(event));
    const times = [...new Set(this.rows.flat().map((row) => row[0]))].filter((ms) => ms <= until_ms).sort((one, other) => one - other);
    const width = this.widthOf(this.poses), frames = new Float32Array(width * times.length);
    times.forEach((ms, i) => frames.set(this.frameAt(ms), width * i));
    if (events.length || times.length) this.on.happened(events, frames);
  }

  frameAt(ms) {
    const frame = new Float32Array(this.widthOf(this.poses));
    let isPosed = false;
    this.rows.forEach((rows, number) => {
      while (rows.length && rows[0][0] <= ms) this.last[number] = rows.shift();
      const row = this.last[number];
      // Each hub that still runs has the poses of all robots.
      if (row[0] === ms && !isPosed) {
        this.lastPoses = row.subarray(ROW);
        isPosed = true;
      }
      if (number === 0) frame.set(row.subarray(0, ROW));
      else frame.set(row.subarray(1, ROW), ROW + this.poses + (ROW - 1) * (number - 1));
    });
    frame[0] = ms;
    frame.set(this.lastPoses, ROW);
    return frame;
  }

  // ---------------------------------------------------------------- what the page says; of a hub alone, too

  allow(ms) {
    for (const hub of this.hubs) hub.allow(ms);
  }

  // A worker is lost, and with it the run.
  abandon() {
    if (!this.isRunning) return;
    this.isRunning = false;
    this.show();
    this.stop();
  }

  stop() {
    for (const hub of this.hubs) hub.stop();
  }

  // To the selected hub; what pulls robots, to any that has them.
  send(message) {
    const isPull = message.kind === "pull" || message.kind === "let go";
    const hub = isPull ? this.hubs.find((one) => one.worker.isRunning) : this.hubs[this.selected];
    hub?.send(message);
  }
}
