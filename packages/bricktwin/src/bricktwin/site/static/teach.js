// Teaching: the robot tries, and the page draws what came of it; the best try is shown on the stage, over and over.

import { Chart } from "./chart.js";
import { make } from "./bench.js";

const TRIALS = 35; // of two and a half seconds each when it walks: a minute and a half of the robot's time
const TITLES = { walk: "Teach it to walk", stop: "Teach it to stop at the wall", follow: "Teach it to follow the line", upright: "Teach it to keep upright" };
const AIMS = {
  walk: "Each try takes two and a half seconds. What counts is how fast the robot gets ahead.",
  stop: "Each try takes four seconds. The robot should soon be 150 mm before the wall, and stay there: each moment there has 100 points, and fewer elsewhere.",
  follow: "Each try takes four seconds. What counts is how fast the robot gets ahead while its sensor sees the edge of the line: half line, half floor.",
  upright: "Each try takes five seconds, or until the robot falls. Each moment upright has points, and more of them near where it began.",
};

const ON_HUB = {
  walk: "The real robot walks up to a wall, which it measures by its ultrasonic sensor: put it 1.3 m before one that is higher than itself. Now and then you put it back.",
  stop: "The real robot measures the wall by its ultrasonic sensor: put it 60 cm before one. It drives back by itself.",
  upright: "Hold the real robot upright before each try, with a soft ground below it, and let go of it when its wheels turn.",
  follow: "Put the real robot with its color sensor on the left edge of a black line on a bright floor, along it. Where it loses the line, you put it back.",
};

export class Teach {
  // `on`: functions start(request), stop(), goOn(), show(frames), opened(isOpen), take(name, source).
  constructor(element, { button, on }) {
    this.element = element;
    this.button = button;
    this.on = on;
    this.find = (name) => element.querySelector(`[data-teach="${name}"]`);
    this.curve = new Chart(this.find("curve"));
    this.landscape = new Chart(this.find("landscape"));
    this.isLearning = false;
    this.wanted = null; // what begins as soon as Python is free
    button.onclick = () => this.open();
    this.find("close").onclick = () => this.close();
    this.find("learn").onclick = () => this.ask({ numbers: null, trials: TRIALS });
    this.find("halt").onclick = () => this.halt();
    this.find("again").onclick = () => this.forget();
    this.find("try").onclick = () => this.ask({ numbers: this.inputs.map((input) => Number(input.value)), trials: 1 });
    this.find("best").onclick = () => this.setSliders(this.best.numbers);
    this.find("export").onclick = () => this.export();
    this.find("target").onchange = () => this.change();
    this.find("go").onclick = () => {
      this.find("place").hidden = true;
      this.on.goOn();
    };
    this.seed = 1;
    this.offer(null);
  }

  // What the robot on the stage can learn; null for nothing.
  offer(lesson) {
    this.close();
    this.isStale = this.isLearning; // what still comes is of another robot
    this.lesson = lesson;
    this.button.hidden = !lesson;
    if (!lesson) return;
    this.button.textContent = this.find("title").textContent = TITLES[lesson.goal];
    this.inputs = lesson.numbers.map(({ name, low, high }) =>
      make("input", { type: "range", min: low, max: high, step: (high - low) / 200, value: (low + high) / 2, ariaLabel: name }));
    this.outputs = this.inputs.map(() => make("output", {}));
    this.find("aim").textContent = AIMS[lesson.goal];
    this.find("sliders").replaceChildren(...this.inputs.map((input, i) => make("label", { className: "slider" }, make("span", { textContent: lesson.numbers[i].name }), this.outputs[i], input)));
    this.inputs.forEach((input) => (input.oninput = () => {
      this.isByHand = true;
      this.showSliders();
    }));
    this.forget();
    this.meet(Boolean(this.isThere));
  }

  get isReal() {
    return this.find("target").value === "hub";
  }

  // A real hub has been connected, or is not there any more; while it learns, the page connects again.
  meet(isThere) {
    if (this.isLearning) return;
    this.isThere = isThere;
    // Not all that is taught here is taught to a real robot.
    isThere &&= !this.lesson || this.lesson.goal in ON_HUB;
    const where = this.find("where");
    if (where.hidden === !isThere) return;
    where.hidden = !isThere;
    this.find("target").value = isThere ? "hub" : "";
    this.change();
  }

  // On the real robot the search goes on with what the virtual one has learned, and the other way round.
  change() {
    if (!this.lesson) return;
    const state = this.state;
    this.forget();
    this.state = state;
    this.isElsewhere = Boolean(state);
    this.find("aim").textContent = (this.isReal ? ON_HUB : AIMS)[this.lesson.goal];
    this.say(state ? "It goes on with what it knows." : "It has not tried anything yet.");
  }

  get isOpen() {
    return !this.element.hidden;
  }

  open() {
    this.element.hidden = false;
    this.on.opened(true);
    if (this.trials.length) this.again();
    else if (!this.isReal) this.ask({ numbers: null, trials: TRIALS }); // a real robot does not move unasked
    this.draw();
  }

  close() {
    if (!this.isOpen) return;
    this.halt();
    this.element.hidden = true;
    this.on.opened(false);
  }

  // Begin from nothing; other numbers come first than the last time.
  forget() {
    this.halt();
    this.trials = [];
    this.frames = [];
    this.state = this.best = this.shown = null;
    this.isByHand = this.isElsewhere = false;
    this.seed += this.isOpen ? 1 : 0;
    this.setSliders(this.lesson.numbers.map(({ low, high }) => (low + high) / 2));
    this.say("It has not tried anything yet.");
    this.draw();
  }

  ask(request) {
    if (this.isLearning) return;
    this.wanted = { goal: this.lesson.goal, seed: this.seed, state: this.state, elsewhere: this.isElsewhere, isReal: this.isReal, ...request };
    this.isElsewhere = false;
    this.say(request.numbers ? "It tries your numbers …" : "It begins to try …");
    this.begin();
    this.draw();
  }

  // Python may be free now.
  begin() {
    if (!this.wanted || !this.on.start(this.wanted)) return;
    this.isMine = Boolean(this.wanted.numbers);
    this.wanted = null;
    this.isStale = false;
    this.isLearning = true;
    this.frames = [];
    this.draw();
  }

  halt() {
    this.wanted = null;
    if (this.isLearning) this.on.stop();
    else if (this.isOpen) this.draw();
  }

  // What has come of the worker, as a player takes it.
  add(events, frames) {
    if (this.isStale) return;
    if (frames.length) this.frames.push(frames);
    for (const event of events) {
      if (event.kind === "err" || event.kind === "lost") this.say(event.text);
      if (event.kind === "place") this.askForPlace(event);
      if (event.kind !== "trial") continue;
      this.take({ ...event, frames: this.frames, isMine: this.isMine });
      this.frames = [];
    }
  }

  take(trial) {
    this.state = trial.state;
    this.trials.push(trial);
    const isBest = trial.score !== null && !trial.fell && !(this.best?.score >= trial.score);
    if (isBest) {
      if (this.best) this.best.frames = null; // pictures of the best only
      this.best = trial;
      if (!this.isByHand) this.setSliders(trial.numbers);
    } else if (!trial.isMine) trial.frames = null;
    this.say(`Try ${this.trials.length}: ${this.outcome(trial)}${isBest && this.trials.length > 1 ? ", the best so far" : ""}.`);
    if (trial.isMine) this.judge(trial, isBest);
    if (trial.isMine || !this.shown) this.show(trial.frames ? trial : this.best);
    this.draw();
  }

  // The robot is where no try can begin.
  askForPlace({ distance_mm, wanted_mm, reflection_pct, pitch_deg }) {
    this.find("place").hidden = false;
    if (pitch_deg !== undefined) {
      this.find("distance").textContent = `It leans by ${pitch_deg} degrees. Hold it upright, and let go of it when its wheels turn.`;
      return;
    }
    if (reflection_pct !== undefined) {
      this.find("distance").textContent = `It sees no edge of a line, but ${reflection_pct} % of the light. Put it with its color sensor on the left edge of the line, along it.`;
      return;
    }
    const isBlind = distance_mm >= 1990, sees = isBlind ? "It sees no wall." : `It is ${(distance_mm / 1000).toFixed(2)} m before the wall.`;
    this.find("distance").textContent = `${sees} Put it ${(wanted_mm / 1000).toFixed(1)} m before one, facing it.`;
  }

  outcome({ score, fell }) {
    if (score === null) return "it was lost, and does not count";
    return fell ? "it fell over" : this.measure(score);
  }

  judge(trial, isBest) {
    const robots = Math.max(...this.trials.filter(({ isMine, score, fell }) => !isMine && !fell && score !== null).map(({ score }) => score));
    const word = isBest ? "You have beaten the robot!" : Number.isFinite(robots) ? `The robot's best: ${this.measure(robots)}.` : "";
    this.say(`Yours: ${this.outcome(trial)}. ${word}`);
  }

  measure(score) {
    return `${score.toFixed(0)} ${this.lesson.unit}`;
  }

  // The run has ended: all tries were made, or it was stopped.
  end(code) {
    this.isLearning = false;
    this.find("place").hidden = true;
    if (this.isStale) return;
    if (code === 130) this.say("Stopped. What it has learned stays.");
    else if (!code && !this.isMine && this.best) this.say(`It has learned: ${this.measure(this.best.score)}. Can you beat it?`);
    this.draw();
  }

  show(trial) {
    if (!trial?.frames?.length) return; // nobody films the real robot
    this.shown = trial;
    this.find("shown").textContent = trial.isMine ? `On the stage: yours, ${this.outcome(trial)}` : `On the stage: try ${this.trials.indexOf(trial) + 1}, ${this.outcome(trial)}`;
    this.on.show(trial.frames);
  }

  // What is on the stage has come to its end: the best follows.
  again() {
    this.show(this.best ?? this.shown);
  }

  setSliders(numbers) {
    this.inputs.forEach((input, i) => (input.value = numbers[i]));
    this.isByHand = false;
    this.showSliders();
  }

  showSliders() {
    this.inputs.forEach((input, i) => {
      const { unit, low, high } = this.lesson.numbers[i], value = Number(input.value), name = unit === "deg" ? "degrees" : unit;
      this.outputs[i].textContent = `${high - low < 20 ? value.toFixed(2) : Math.round(value)} ${name}`.trim();
    });
    this.drawLandscape();
  }

  export() {
    const { goal } = this.lesson;
    this.on.take(`${goal}.py`, `# It has learned to ${goal}: ${this.measure(this.best.score)} in its best try\n${this.best.source}`);
  }

  say(text) {
    this.find("status").textContent = text;
  }

  draw() {
    const isBusy = this.isLearning || Boolean(this.wanted);
    this.find("halt").disabled = !isBusy;
    for (const name of ["learn", "try"]) this.find(name).disabled = isBusy;
    this.find("again").disabled = isBusy || !this.trials.length;
    for (const name of ["best", "export"]) this.find(name).disabled = !this.best;
    this.find("learn").textContent = this.trials.length ? "Teach on" : "Teach";
    this.drawCurve();
    this.drawLandscape();
  }

  drawCurve() {
    let robot_s = 0, best = null;
    const points = [], line = [];
    for (const trial of this.trials) {
      robot_s += trial.seconds;
      if (trial.score === null) continue;
      if (!trial.fell && !(best >= trial.score)) best = trial.score;
      points.push({ ...this.point(trial), x: robot_s, y: trial.score });
      if (best !== null) line.push([robot_s, best]);
    }
    this.curve.draw({
      x: { title: "seconds of the robot", low: 0, high: Math.max(TRIALS * this.lesson.trial_s, robot_s) },
      y: { title: this.lesson.unit, low: Math.min(0, ...points.map(({ y }) => y)), high: Math.max(10, ...points.map(({ y }) => y)) },
      points, line,
    });
  }

  // The plane of the first two numbers.
  drawLandscape() {
    if (!this.trials) return;
    const [across, along] = this.lesson.numbers;
    const points = this.trials.filter(({ score }) => score !== null).map((trial) => ({ ...this.point(trial), x: trial.numbers[0], y: trial.numbers[1] }));
    const [x, y] = this.inputs.map((input) => Number(input.value));
    this.landscape.draw({ x: { title: across.name, ...across }, y: { title: along.name, ...along }, points, cross: [x, y] });
  }

  // A trial as a point: dark and blue for slow, bright and yellow for fast.
  point(trial) {
    const top = Math.max(1, this.best?.score ?? 1), share = Math.max(0, Math.min(1, trial.score / top));
    const kind = trial.fell ? "fell" : trial === this.best ? "best" : trial.isMine ? "mine" : "";
    return { share, kind, text: `${trial.isMine ? "yours" : `try ${this.trials.indexOf(trial) + 1}`}: ${this.outcome(trial)}` };
  }
}
