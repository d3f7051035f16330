// Player of a run: its record, and the clock by which it is shown. Where there is a way in, the hub waits for this clock; else
// the run is computed at once, and only shown in time.

const LEAD_MS = 40, LONGEST_LEAD_MS = 400, MAX_FRAMES = 30000, MAX_PANELS = 10000; // ten minutes
export const FAST = Infinity;

export class Player {
  // `on`: functions allow(ms), frame(row), event(event), time(shown_ms, latest_ms), caughtUp().
  constructor(on) {
    this.on = on;
    this.rate = 1;
    this.isPlaying = true;
    this.hub = 0;
    this.clear(8);
    this.lead_ms = LEAD_MS;
    this.last = performance.now();
    const tick = (now) => {
      this.tick(Math.min(now - this.last, 250));
      this.last = now;
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  // For a new run; `width`: numbers of a frame.
  clear(width) {
    this.width = width;
    this.frames = [];
    this.events = [];
    this.panels = new Map(); // by hub
    this.toldEvents = 0;
    this.shown_ms = this.clock_ms = this.latest_ms = 0;
    this.isRunning = false;
    this.isCaughtUp = true;
    this.lastRow = null;
    this.lastPanel = null;
  }

  begin() {
    this.isRunning = true;
    this.isPlaying = true;
    this.isCaughtUp = false;
    this.on.allow(this.rate === FAST ? FAST : LEAD_MS);
  }

  add(events, frames) {
    for (let i = 0; i + this.width <= frames.length; i += this.width) this.frames.push(frames.subarray(i, i + this.width));
    if (this.frames.length > MAX_FRAMES) this.frames.splice(0, this.frames.length - MAX_FRAMES);
    if (this.frames.length) this.latest_ms = Math.max(this.latest_ms, this.frames.at(-1)[0]);
    for (const event of events) {
      event.ms = Math.max(event.ms, this.events.at(-1)?.ms ?? 0);
      this.latest_ms = Math.max(this.latest_ms, event.ms);
      this.events.push(event);
      if (event.kind === "panel") this.keepPanel(event);
    }
  }

  keepPanel(event) {
    const hub = event.hub ?? 0, panels = this.panels.get(hub) ?? [];
    this.panels.set(hub, panels);
    panels.push(event);
    // A light that blinks for an hour fills memory else.
    if (panels.length > 2 * MAX_PANELS) panels.splice(0, panels.length - MAX_PANELS);
  }

  // Another hub's panel is shown.
  select(hub) {
    this.hub = hub;
    this.lastRow = this.lastPanel = null;
    this.on.panel(null);
  }

  // The run has ended. With `atOnce`, nothing is left to be waited for.
  end(atOnce) {
    this.isRunning = false;
    if (atOnce) this.clock_ms = this.latest_ms;
  }

  // The run was lost: what came of it is shown, and nobody is told of an end.
  abandon() {
    this.end(true);
    this.isCaughtUp = true;
  }

  seek(ms) {
    this.isPlaying = false;
    this.clock_ms = Math.max(this.frames[0]?.[0] ?? 0, Math.min(ms, this.latest_ms));
  }

  step(ms) {
    this.isPlaying = false;
    this.clock_ms += ms;
    if (this.isRunning) this.on.allow(this.clock_ms);
    else this.clock_ms = Math.min(this.clock_ms, this.latest_ms);
  }

  tick(passed_ms) {
    if (this.isPlaying && this.rate === FAST) {
      this.clock_ms = this.latest_ms;
      if (this.isRunning) this.on.allow(FAST);
    } else if (this.isPlaying) {
      // A hub that is slower than the clock is waited for; it may be ahead by a little more than a picture takes.
      this.lead_ms += 0.2 * (Math.min(Math.max(LEAD_MS, 1.5 * passed_ms), LONGEST_LEAD_MS) - this.lead_ms);
      const lead_ms = this.lead_ms * Math.max(1, this.rate);
      this.clock_ms = Math.min(this.clock_ms + passed_ms * this.rate, this.latest_ms + (this.isRunning ? lead_ms : 0));
      if (this.isRunning) this.on.allow(Math.round(this.clock_ms + lead_ms));
    }
    this.show(Math.min(this.clock_ms, this.latest_ms));
  }

  show(ms) {
    while (this.toldEvents < this.events.length && this.events[this.toldEvents].ms <= ms) this.on.event(this.events[this.toldEvents++]);
    // What has been told is not told again, but the panel of each moment is kept.
    if (this.toldEvents > 5000) this.events.splice(0, this.toldEvents), (this.toldEvents = 0);
    const row = this.frames[this.indexAt(ms)];
    if (row && row !== this.lastRow) this.on.frame((this.lastRow = row));
    const panel = last(this.panels.get(this.hub) ?? [], ms);
    if (panel && panel !== this.lastPanel) this.on.panel((this.lastPanel = panel));
    if (ms !== this.shown_ms || !this.isCaughtUp) this.on.time((this.shown_ms = ms), this.latest_ms);
    const isCaughtUp = !this.isRunning && ms >= this.latest_ms && this.toldEvents === this.events.length;
    if (isCaughtUp && !this.isCaughtUp) {
      this.isCaughtUp = true;
      this.on.caughtUp();
    }
  }

  indexAt(ms) {
    let [low, high] = [0, this.frames.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.frames[middle][0] <= ms) low = middle + 1;
      else high = middle;
    }
    return Math.max(0, low - 1);
  }
}

function last(events, ms) {
  let [low, high] = [0, events.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (events[middle].ms <= ms) low = middle + 1;
    else high = middle;
  }
  return events[low - 1];
}
