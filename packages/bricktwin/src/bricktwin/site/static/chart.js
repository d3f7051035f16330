// Chart of points in a plane, with a line, in SVG.

const SPACE = "http://www.w3.org/2000/svg", WIDTH = 320, HEIGHT = 200, LEFT = 40, RIGHT = 10, TOP = 8, BOTTOM = 34;

export class Chart {
  constructor(svg) {
    this.svg = svg;
    svg.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
  }

  // `x`, `y`: title, low, high. `points`: x, y, share (0 to 1, its colour), kind, text. `line`: of [x, y]. `cross`: [x, y].
  draw({ x, y, points, line = [], cross = null }) {
    const across = (value) => LEFT + ((WIDTH - LEFT - RIGHT) * (value - x.low)) / (x.high - x.low);
    const along = (value) => HEIGHT - BOTTOM - ((HEIGHT - TOP - BOTTOM) * (value - y.low)) / (y.high - y.low);
    const drawn = [shape("rect", { class: "plane", x: LEFT, y: TOP, width: WIDTH - LEFT - RIGHT, height: HEIGHT - TOP - BOTTOM })];
    for (const value of ticks(x)) drawn.push(label(across(value), HEIGHT - BOTTOM + 13, value, "middle"));
    for (const value of ticks(y)) {
      drawn.push(shape("path", { class: "grid", d: `M${LEFT} ${along(value)}H${WIDTH - RIGHT}` }), label(LEFT - 4, along(value) + 4, value, "end"));
    }
    drawn.push(label((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 4, x.title, "middle"));
    const title = label(0, 0, y.title, "middle");
    title.setAttribute("transform", `translate(9 ${(TOP + HEIGHT - BOTTOM) / 2}) rotate(-90)`);
    drawn.push(title);
    if (line.length) drawn.push(shape("path", { class: "line", d: `M${line.map(([a, b]) => `${across(a)} ${along(b)}`).join("L")}` }));
    for (const point of points) {
      const dot = shape("circle", { class: `dot ${point.kind}`, cx: across(point.x), cy: along(point.y), r: point.kind ? 5.5 : 4, fill: colour(point.share) });
      dot.append(shape("title", {}, point.text));
      drawn.push(dot);
    }
    if (cross) drawn.push(shape("path", { class: "cross", d: `M${across(cross[0]) - 8} ${along(cross[1])}h16m-8 -8v16` }));
    this.svg.replaceChildren(...drawn);
  }
}

function shape(tag, attributes, text = "") {
  const element = document.createElementNS(SPACE, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.textContent = text;
  return element;
}

function label(x, y, text, anchor) {
  return shape("text", { x, y, "text-anchor": anchor }, text);
}

// A few round numbers in a range.
function ticks({ low, high }) {
  const rough = (high - low) / 4, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5, 10].find((factor) => factor * power >= rough) ?? 10);
  const found = [];
  for (let place = Math.ceil(low / step); place * step <= high; place++) found.push(Number((place * step).toFixed(6)));
  return found;
}

function colour(share) {
  return `hsl(${240 - 190 * share} ${60 + 30 * share}% ${32 + 20 * share}%)`;
}
