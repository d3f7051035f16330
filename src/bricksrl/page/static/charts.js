// Line charts on a canvas, drawn by hand: a title, a light grid, the last value.

const INK = "#1f2430", MUTED = "#6b7280", GRID = "#e5e7eb";

export class Chart {
  // points: dots and a moving mean, as of the learning curve; else lines, one for each column.
  constructor(parent, title, { points = false, unit = "step", range = null } = {}) {
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
    Object.assign(this, { points, unit, range, first: 0, rows: [], kept: 400, lines: [] });
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  // New rows of a series from number `first` on, as the server sends them.
  add({ first, rows, kept }) {
    if (kept) [this.kept, this.first, this.rows] = [kept, first, []];
    if (first !== this.first + this.rows.length) [this.first, this.rows] = [first, []];
    this.rows.push(...rows.map((row) => row.map((value) => value ?? NaN))); // a gap where there is no number
    const excess = this.rows.length - this.kept;
    if (excess > 0) {
      this.rows.splice(0, excess);
      this.first += excess;
    }
    this.figure.dataset.count = this.first + this.rows.length;
    this.draw();
  }

  draw() {
    const canvas = this.canvas, scale = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return;
    [canvas.width, canvas.height] = [Math.round(width * scale), Math.round(height * scale)];
    const pen = canvas.getContext("2d");
    pen.scale(scale, scale);
    pen.font = "11px system-ui, sans-serif";
    const values = this.rows.flat().filter(Number.isFinite);
    let [low, high] = this.range ?? [Math.min(...values, 0), Math.max(...values, 0)];
    if (!values.length && !this.range) [low, high] = [0, 1];
    if (high - low < 1e-9) [low, high] = [low - 0.5, high + 0.5];
    const left = 38, right = width - 8, top = 6, bottom = height - 16;
    const y = (value) => bottom - ((value - low) / (high - low)) * (bottom - top);
    const span = Math.max(this.rows.length - 1, this.points ? 1 : 20);
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
    if (this.rows.length > 1) pen.fillText(`${this.first + this.rows.length}`, right, height - 3);
    if (!this.rows.length) return;
    if (this.points) this.drawPoints(pen, x, y);
    else this.drawLines(pen, x, y);
    const last = this.rows[this.rows.length - 1];
    this.lastValue.textContent = last.length === 1 ? short(last[0]) : "";
  }

  drawPoints(pen, x, y) {
    pen.fillStyle = "#9fb8dc";
    this.rows.forEach(([value], i) => {
      pen.beginPath();
      pen.arc(x(i), y(value), 2.5, 0, 7);
      pen.fill();
    });
    pen.strokeStyle = "#0b5cad";
    pen.lineWidth = 2;
    line(pen, this.rows.map((_, i) => {
      const recent = this.rows.slice(Math.max(0, i - 4), i + 1);
      return [x(i), y(recent.reduce((sum, [value]) => sum + value, 0) / recent.length)];
    }));
  }

  drawLines(pen, x, y) {
    pen.lineWidth = 1.5;
    this.rows[0].forEach((_, column) => {
      pen.strokeStyle = this.rows[0].length > 1 ? `hsl(${(360 * column) / this.rows[0].length} 65% 42%)` : "#0b5cad";
      line(pen, this.rows.map((row, i) => [x(i), y(row[column])]));
    });
  }
}

export function short(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  return size >= 1000 || Number.isInteger(value) ? value.toFixed(0) : size >= 100 ? value.toFixed(0) : size >= 10 ? value.toFixed(1) : value.toFixed(2);
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
