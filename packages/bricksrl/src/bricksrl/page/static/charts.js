// Line charts on a canvas, drawn by hand: a title, a light grid, the last value.

const MUTED = "#6b7280", GRID = "#e5e7eb", BLUE = "#0b5cad";

export class Chart {
  // points: dots and a moving mean, as of the learning curve; else a line.
  constructor(parent, title, { points, unit }) {
    this.figure = document.createElement("figure");
    this.figure.className = "chart";
    const caption = document.createElement("figcaption"), name = document.createElement("span");
    this.lastValue = document.createElement("output");
    name.textContent = title;
    caption.append(name, this.lastValue);
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", title);
    this.figure.append(caption, this.canvas);
    parent.append(this.figure);
    Object.assign(this, { points, unit, first: 0, values: [], kept: 400 });
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  // New values from number `first` on; `kept` of them are kept.
  add({ first, values, kept = this.kept }) {
    if (first !== this.first + this.values.length) [this.first, this.values] = [first, []];
    this.kept = kept;
    this.values.push(...values.map((value) => value ?? NaN)); // a gap where there is no number
    const excess = this.values.length - this.kept;
    if (excess > 0) {
      this.values.splice(0, excess);
      this.first += excess;
    }
    this.figure.dataset.count = this.first + this.values.length;
    this.draw();
  }

  draw() {
    const canvas = this.canvas, scale = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return;
    [canvas.width, canvas.height] = [Math.round(width * scale), Math.round(height * scale)];
    const pen = canvas.getContext("2d");
    pen.scale(scale, scale);
    pen.font = "11px system-ui, sans-serif";
    const numbers = this.values.filter(Number.isFinite);
    let [low, high] = numbers.length ? [Math.min(...numbers, 0), Math.max(...numbers, 0)] : [0, 1];
    if (high - low < 1e-9) [low, high] = [low - 0.5, high + 0.5];
    const left = 38, right = width - 8, top = 6, bottom = height - 16;
    const y = (value) => bottom - ((value - low) / (high - low)) * (bottom - top);
    const span = Math.max(this.values.length - 1, this.points ? 1 : 20);
    const x = (i) => left + (i / span) * (right - left);
    pen.fillStyle = MUTED;
    pen.lineWidth = 1;
    for (const tick of ticks(low, high, Math.max(2, Math.floor((bottom - top) / 28)))) {
      pen.strokeStyle = GRID;
      line(pen, [[left, Math.round(y(tick)) + 0.5], [right, Math.round(y(tick)) + 0.5]]);
      pen.textAlign = "right";
      pen.textBaseline = "middle";
      pen.fillText(short(tick), left - 5, y(tick));
    }
    pen.textBaseline = "alphabetic";
    pen.textAlign = "left";
    pen.fillText(`${this.unit} ${this.first + 1}`, left, height - 3);
    pen.textAlign = "right";
    if (this.values.length > 1) pen.fillText(`${this.first + this.values.length}`, right, height - 3);
    if (!this.values.length) return;
    if (this.points) this.drawPoints(pen, x, y);
    pen.strokeStyle = BLUE;
    pen.lineWidth = this.points ? 2 : 1.5;
    line(pen, (this.points ? this.means() : this.values).map((value, i) => [x(i), y(value)]));
    this.lastValue.textContent = short(this.values.at(-1));
  }

  drawPoints(pen, x, y) {
    pen.fillStyle = "#9fb8dc";
    this.values.forEach((value, i) => {
      pen.beginPath();
      pen.arc(x(i), y(value), 2.5, 0, 7);
      pen.fill();
    });
  }

  // Mean of the last five values at each of them.
  means() {
    return this.values.map((_, i) => {
      const recent = this.values.slice(Math.max(0, i - 4), i + 1);
      return recent.reduce((sum, value) => sum + value, 0) / recent.length;
    });
  }
}

export function short(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  const text = value.toFixed(size >= 100 || Number.isInteger(value) ? 0 : size >= 10 ? 1 : 2);
  return text.replace(/^-(?=[0.]*$)/, ""); // no "-0.00"
}

function line(pen, points) {
  pen.beginPath();
  points.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.stroke();
}

function ticks(low, high, count) {
  const rough = (high - low) / count, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((size) => size >= rough);
  const values = [];
  for (let value = Math.ceil(low / step) * step; value <= high + step * 1e-6; value += step) values.push(Math.abs(value) < step * 1e-6 ? 0 : value);
  return values;
}
