// 3D scene in WebGL 2: meshes of bodies, a floor with marks of metres, a sun with shadows, a camera that orbits and follows.
// Column-major matrices, metres, z up. Draws only on request.

const VERTEX = `#version 300 es
layout(location = 0) in vec3 point;
layout(location = 1) in vec3 normal;
uniform mat4 view, model, sun;
out vec3 world, facing;
out vec4 lit;
void main() {
  vec4 at = model * vec4(point, 1.0);
  world = at.xyz;
  facing = mat3(model) * normal;
  lit = sun * at;
  gl_Position = view * at;
}`;

const LIGHT = `
uniform highp sampler2DShadow shadows;
uniform vec3 eye, sunward;
in vec3 world, facing;
in vec4 lit;
out vec4 colour;
float sunshine() {
  vec3 at = lit.xyz / lit.w * 0.5 + 0.5;
  if (any(lessThan(at, vec3(0.0))) || any(greaterThan(at, vec3(1.0)))) return 1.0;
  float sum = 0.0;
  for (int i = 0; i < 4; i++) {
    vec2 off = (vec2(i & 1, i >> 1) - 0.5) / 900.0;
    sum += texture(shadows, vec3(at.xy + off, at.z - 0.0015));
  }
  return sum * 0.25;
}`;

const SOLID = `#version 300 es
precision highp float;
uniform vec4 tint;
uniform int pattern;
${LIGHT}
void main() {
  vec3 n = normalize(facing), base = tint.rgb;
  if (pattern == 1 && abs(n.x) > 0.5) {
    float course = floor(world.z / 0.032);
    vec2 at = vec2(world.y / 0.064 + 0.5 * mod(course, 2.0), world.z / 0.032);
    vec2 near = abs(fract(at) - 0.5), width = fwidth(at);
    float joint = max(smoothstep(0.46 - width.x, 0.47 + width.x, near.x), smoothstep(0.42 - width.y, 0.45 + width.y, near.y));
    base *= mix(1.0, 0.72, joint * clamp(0.35 / max(width.x, width.y), 0.0, 1.0));
  }
  float sun = max(dot(n, sunward), 0.0) * sunshine();
  vec3 towards = normalize(eye - world);
  float shine = pow(max(dot(n, normalize(sunward + towards)), 0.0), 40.0) * sun;
  vec3 ambient = mix(vec3(0.42, 0.41, 0.40), vec3(0.60, 0.62, 0.66), n.z * 0.5 + 0.5);
  colour = vec4(base * (ambient + 0.62 * sun) + 0.16 * shine, tint.a);
}`;

const FLOOR = `#version 300 es
precision highp float;
uniform vec3 sky;
${LIGHT}
float lines(vec2 at, float half_width) {
  vec2 width = fwidth(at), near = abs(fract(at - 0.5) - 0.5);
  vec2 line = 1.0 - smoothstep(vec2(half_width), vec2(half_width) + 1.5 * width, near);
  return max(line.x, line.y) * clamp(0.4 / max(width.x, width.y), 0.0, 1.0);
}
void main() {
  vec3 base = vec3(0.88, 0.89, 0.905);
  base = mix(base, vec3(0.78, 0.80, 0.83), 0.7 * lines(world.xy * 10.0, 0.006));
  base = mix(base, vec3(0.50, 0.54, 0.60), 0.8 * lines(world.xy, 0.0022));
  base *= 0.80 + 0.20 * sunshine();
  float far = smoothstep(1.5, 7.0, distance(world.xy, eye.xy));
  colour = vec4(mix(base, sky, far), 1.0);
}`;

const DEPTH = `#version 300 es
precision highp float;
void main() {}`;

const SKY = [0.935, 0.945, 0.96];
const SUNWARD = normalised([-0.32, -0.42, 0.85]);
const ANGLE = 0.65;
const SHADOW_PX = 1024;
const SLOW_MS = 40;
const STILL_MS = 400;
// What is nowhere further from the floor lies on it: tape, a mat, a mark.
const FLAT_M = 0.003;

export class Scene3D {
  constructor(canvas, labels) {
    this.canvas = canvas;
    this.labels = labels;
    this.gl = canvas.getContext("webgl2", { antialias: true, alpha: false, stencil: true, powerPreference: "low-power" });
    if (!this.gl) throw new Error("this browser has no WebGL 2");
    this.bodies = [];
    this.poses = null;
    this.follows = true;
    this.view = { target: [0, 0, 0.05], distance_m: 0.6, yaw_deg: -55, pitch_deg: 25, follow: null, ratio: 10 / 9 };
    this.moved = [0, 0];
    this.floor = 0;
    this.frames = 0;
    this.isRequested = this.isBusy = false;
    this.resolution = 1;
    this.makePrograms();
    this.listen();
    new ResizeObserver(() => this.requestDraw()).observe(canvas);
  }

  makePrograms() {
    const gl = this.gl;
    this.solid = program(gl, VERTEX, SOLID);
    this.ground = program(gl, VERTEX, FLOOR);
    this.depth = program(gl, VERTEX, DEPTH);
    this.shadowMap = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.shadowMap);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, SHADOW_PX, SHADOW_PX);
    for (const [name, value] of [
      [gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE],
      [gl.TEXTURE_MIN_FILTER, gl.LINEAR],
      [gl.TEXTURE_MAG_FILTER, gl.LINEAR],
      [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE],
      [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE],
    ]) gl.texParameteri(gl.TEXTURE_2D, name, value);
    this.shadowBuffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowBuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, this.shadowMap, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    const up = [0, 0, 127, 0];
    this.square = mesh(gl, new Float32Array([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0]), new Int8Array([...up, ...up, ...up, ...up]),
      new Uint32Array([0, 1, 2, 0, 2, 3]));
  }

  // A scene file: length of the header, header, arrays (see scene.py).
  load(buffer) {
    const gl = this.gl, length = new DataView(buffer).getUint32(0, true), start = 4 + length;
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    for (const old of this.meshes ?? []) old.free();
    this.meshes = header.meshes.map(({ points, normals, faces, vertices, triangles }) => mesh(gl,
      new Float32Array(buffer, start + points, 3 * vertices),
      new Int8Array(buffer, start + normals, 4 * vertices),
      new Uint32Array(buffer, start + faces, 3 * triangles)));
    this.bodies = header.bodies.map((body) => ({
      isMovable: body.name !== "world" && !body.name.startsWith("goal "),
      shapes: body.shapes.map((shape) => ({
        mesh: this.meshes[shape.mesh],
        colour: shape.colour,
        pattern: shape.pattern === "bricks" ? 1 : 0,
        transform: rigid(shape.position, shape.wxyz),
      })),
    }));
    this.floor = header.floor;
    this.poses = null;
    if (JSON.stringify(header.view) !== this.initialView) {
      this.initialView = JSON.stringify(header.view);
      this.home();
    }
  }

  home() {
    this.view = JSON.parse(this.initialView ?? JSON.stringify(this.view));
    this.moved = [0, 0];
    this.requestDraw();
  }

  setPoses(poses) {
    const isNew = !this.poses || poses.some((value, i) => value !== this.poses[i]);
    this.poses = poses;
    if (isNew) this.requestDraw();
  }

  // Draw soon, but not before the previous picture is done; slow drawing takes at most half of the time.
  requestDraw() {
    this.isRequested = true;
    clearTimeout(this.sharpening);
    this.sharpening = setTimeout(() => this.sharpen(), STILL_MS);
    if (this.isBusy) return;
    this.isBusy = true;
    requestAnimationFrame(() => {
      this.isRequested = false;
      const start_ms = performance.now();
      this.draw();
      const fence = this.gl.fenceSync(this.gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
      this.gl.flush();
      const poll = () => {
        if (fence && this.gl.getSyncParameter(fence, this.gl.SYNC_STATUS) !== this.gl.SIGNALED && !this.gl.isContextLost()) {
          setTimeout(poll, 4);
          return;
        }
        this.gl.deleteSync(fence);
        const duration_ms = performance.now() - start_ms;
        this.adaptResolution(duration_ms);
        setTimeout(() => {
          this.isBusy = false;
          if (this.isRequested) this.requestDraw();
        }, duration_ms > SLOW_MS ? duration_ms : 0);
      };
      setTimeout(poll, 0);
    });
  }

  // Draw what does not move with all pixels, however long that takes.
  sharpen() {
    if (this.isBusy) this.sharpening = setTimeout(() => this.sharpen(), STILL_MS);
    else if (this.resolution < 1) this.draw(1);
  }

  // Fewer pixels while drawing is slow, more again when it is fast.
  adaptResolution(duration_ms) {
    const mean_ms = this.mean_ms = 0.8 * (this.mean_ms ?? duration_ms) + 0.2 * duration_ms;
    this.canvas.dataset.took = mean_ms.toFixed(0);
    if (mean_ms > 2 * SLOW_MS) this.resolution = Math.max(0.35, this.resolution * Math.max(0.6, Math.sqrt((2 * SLOW_MS) / mean_ms)));
    else if (mean_ms < SLOW_MS / 2) this.resolution = Math.min(1, this.resolution * 1.02);
  }

  draw(resolution = this.resolution) {
    const gl = this.gl, canvas = this.canvas, scale = resolution * Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.round(canvas.clientWidth * scale), height = Math.round(canvas.clientHeight * scale);
    // Poses may come before the scene: an empty floor would say that the robot is gone.
    if (!width || !height || !this.poses || !this.bodies.length || gl.isContextLost()) return;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    this.frames += 1;
    canvas.dataset.frames = this.frames;
    const target = this.target(), eye = this.eye(target);
    const view = this.camera(target);
    const reach = Math.max(0.45, Math.min(1.2, this.view.distance_m));
    const sunEye = target.map((value, i) => value + 3 * SUNWARD[i]);
    const sun = multiply(orthographic(reach, 1.0, 5.0), lookAt(sunEye, target));
    const { opaque, transparent, flat } = this.sortedShapes();
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.CULL_FACE);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadowBuffer);
    gl.viewport(0, 0, SHADOW_PX, SHADOW_PX);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.depth.id);
    gl.uniformMatrix4fv(this.depth.uniform("view"), false, sun);
    for (const { shape, model } of opaque) {
      gl.uniformMatrix4fv(this.depth.uniform("model"), false, model);
      shape.mesh.draw();
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    gl.clearColor(...SKY, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    this.useProgram(this.solid, view, sun, eye);
    for (const placed of opaque) this.drawShape(placed);
    if (this.floor !== null) this.drawFloor(view, sun, eye, target, flat);
    if (transparent.length) {
      this.useProgram(this.solid, view, sun, eye);
      gl.colorMask(false, false, false, false); // first the depths: only what is in front is then blended
      for (const placed of transparent) this.drawShape(placed);
      gl.colorMask(true, true, true, true);
      gl.depthFunc(gl.LEQUAL);
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
      for (const placed of transparent) this.drawShape(placed);
      gl.disable(gl.BLEND);
      gl.depthFunc(gl.LESS);
    }
    this.writeMetres(view, target);
  }

  useProgram(program, view, sun, eye) {
    const gl = this.gl;
    gl.useProgram(program.id);
    gl.uniformMatrix4fv(program.uniform("view"), false, view);
    gl.uniformMatrix4fv(program.uniform("sun"), false, sun);
    gl.uniform3fv(program.uniform("eye"), eye);
    gl.uniform3fv(program.uniform("sunward"), SUNWARD);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.shadowMap);
    gl.uniform1i(program.uniform("shadows"), 0);
  }

  drawShape({ shape, model }) {
    const gl = this.gl;
    gl.uniformMatrix4fv(this.solid.uniform("model"), false, model);
    gl.uniform4fv(this.solid.uniform("tint"), shape.colour);
    gl.uniform1i(this.solid.uniform("pattern"), shape.pattern);
    shape.mesh.draw();
  }

  // The floor, and what lies on it, painted in layers where the floor is seen: between layers that are a hair apart, depths of a
  // graphics card, or of a processor in place of one, say nothing.
  drawFloor(view, sun, eye, target, flat) {
    const gl = this.gl, size = 12;
    gl.enable(gl.STENCIL_TEST);
    gl.stencilFunc(gl.ALWAYS, 1, 1);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.REPLACE);
    this.useProgram(this.ground, view, sun, eye);
    gl.uniform3fv(this.ground.uniform("sky"), SKY);
    gl.uniformMatrix4fv(this.ground.uniform("model"), false,
      new Float32Array([size, 0, 0, 0, 0, size, 0, 0, 0, 0, 1, 0, target[0], target[1], this.floor, 1]));
    this.square.draw();
    gl.stencilFunc(gl.EQUAL, 1, 1);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.KEEP);
    gl.disable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    this.useProgram(this.solid, view, sun, eye);
    for (const placed of flat) this.drawShape(placed);
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.STENCIL_TEST);
  }

  // Shapes by how they are drawn; the flat ones lie on the floor, the lowest first.
  sortedShapes() {
    const sorted = { opaque: [], transparent: [], flat: [] };
    for (const placed of this.placedShapes()) {
      placed.top_m = this.floor === null ? Infinity : topOf(placed, this.floor);
      const kind = placed.top_m < FLAT_M ? "flat" : placed.shape.colour[3] < 1 ? "transparent" : "opaque";
      sorted[kind].push(placed);
    }
    sorted.flat.sort((a, b) => a.top_m - b.top_m);
    return sorted;
  }

  // Each shape with its matrix in the world; a body whose x is not a number is hidden.
  placedShapes() {
    const shapes = [];
    this.bodies.forEach((body, i) => {
      const pose = this.poses.subarray(7 * i, 7 * i + 7);
      if (pose.length < 7 || Number.isNaN(pose[0])) return;
      const frame = rigid(pose, pose.subarray(3));
      for (const shape of body.shapes) shapes.push({ shape, model: multiply(frame, shape.transform) });
    });
    return shapes;
  }

  target() {
    const { follow, target } = this.view;
    if (follow === null || !this.poses || !this.follows) return [target[0] + this.moved[0], target[1] + this.moved[1], target[2]];
    const position = this.poses.subarray(7 * follow, 7 * follow + 2);
    if (position.length === 2 && !Number.isNaN(position[0])) this.moved = [position[0], position[1]];
    return [target[0] + this.moved[0], target[1] + this.moved[1], target[2]];
  }

  eye(target) {
    const yaw = (this.view.yaw_deg * Math.PI) / 180, pitch = (this.view.pitch_deg * Math.PI) / 180, distance_m = this.view.distance_m;
    return [
      target[0] + distance_m * Math.cos(pitch) * Math.cos(yaw),
      target[1] + distance_m * Math.cos(pitch) * Math.sin(yaw),
      target[2] + distance_m * Math.sin(pitch),
    ];
  }

  // Marks on the floor, a label at each whole metre near the robot.
  writeMetres(view, target) {
    const marks = [];
    if (this.floor !== null) {
      for (let x = Math.round(target[0]) - 2; x <= Math.round(target[0]) + 2; x++) marks.push([[x, Math.round(target[1])], `${x} m`]);
    }
    while (this.labels.childElementCount < marks.length) this.labels.append(document.createElement("span"));
    [...this.labels.children].forEach((label, i) => {
      const point = marks[i] && project(view, [...marks[i][0], this.floor]);
      const isBelow = marks[i] && distance(marks[i][0], target) < 0.3; // the robot stands there
      label.hidden = !point || isBelow || Math.abs(point[0]) > 1 || Math.abs(point[1]) > 1;
      if (label.hidden) return;
      label.textContent = marks[i][1];
      label.style.left = `${(point[0] * 0.5 + 0.5) * 100}%`;
      label.style.top = `${(0.5 - point[1] * 0.5) * 100}%`;
    });
  }

  // Number of the body near a point of the canvas (px), or else of that which is seen there, such as a wall; -1 if there is none.
  bodyAt(x, y) {
    const near_px = 0.07 * this.pixelsPerMetre(this.target());
    let [best, nearest_px] = [-1, Math.max(22, near_px)];
    const [eye, ray] = this.sight(x, y);
    let [seen, nearest_m] = [-1, Infinity];
    this.bodies.forEach(({ isMovable, shapes }, i) => {
      if (!isMovable || !this.poses) return;
      const at = this.pixelOf(i), away_px = at ? Math.hypot(at[0] - x, at[1] - y) : Infinity;
      if (away_px < nearest_px) [best, nearest_px] = [i, away_px];
      const pose = this.poses.subarray(7 * i, 7 * i + 7), frame = rigid(pose, pose.subarray(3));
      for (const { mesh, transform } of shapes) {
        const way_m = wayTo(mesh.box, multiply(frame, transform), eye, ray);
        if (way_m < nearest_m) [seen, nearest_m] = [i, way_m];
      }
    });
    return best < 0 ? seen : best;
  }

  // Place of a body on the canvas, px.
  pixelOf(body) {
    const point = this.poses.subarray(7 * body, 7 * body + 3);
    if (Number.isNaN(point[0])) return null;
    const at = project(this.camera(this.target()), point), { clientWidth, clientHeight } = this.canvas;
    return at && [(at[0] * 0.5 + 0.5) * clientWidth, (0.5 - at[1] * 0.5) * clientHeight];
  }

  pixelsPerMetre(point) {
    const view = this.camera(this.target()), [x, y, z] = point, at = project(view, point), above = project(view, [x, y, z + 0.01]);
    return at && above ? (Math.hypot(at[0] - above[0], at[1] - above[1]) * this.canvas.clientHeight) / 0.02 : 0;
  }

  // Eye (m) and direction of the line of sight through a point of the canvas (px).
  sight(x, y) {
    const target = this.target(), eye = this.eye(target), { clientWidth, clientHeight } = this.canvas, ratio = clientWidth / clientHeight;
    const back = normalised(eye.map((value, i) => value - target[i])), right = normalised(cross([0, 0, 1], back)), up = cross(back, right);
    const f = focal(ANGLE, ratio, this.view.ratio), across = ((2 * x) / clientWidth - 1) * (ratio / f), down = (1 - (2 * y) / clientHeight) / f;
    return [eye, back.map((value, i) => across * right[i] + down * up[i] - value)];
  }

  // Point in a plane above the floor (m) at a point of the canvas (px).
  floorPoint(x, y, height_m) {
    const [eye, ray] = this.sight(x, y), way = (height_m - eye[2]) / Math.min(ray[2], -0.05); // not beyond the horizon
    return [eye[0] + way * ray[0], eye[1] + way * ray[1]];
  }

  camera(target) {
    const { clientWidth, clientHeight } = this.canvas;
    return multiply(perspective(ANGLE, clientWidth / clientHeight, this.view.ratio, this.view.distance_m / 60, 40), lookAt(this.eye(target), target));
  }

  // What moves is pulled where `onPull` is set, with a body's number and a point, or null when it is let go.
  pull(body, x, y) {
    this.onPull(body, this.floorPoint(x, y, this.poses[7 * body + 2]), this.pixelOf(body), [x, y]);
  }

  // One finger or the left button pulls what moves, or turns, two fingers or another button move, wheel and pinch zoom, a double click resets the view.
  listen() {
    const canvas = this.canvas, pointers = new Map();
    let held = -1;
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("dblclick", () => this.home());
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(event.deltaY * 0.001));
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
      held = this.onPull && event.button === 0 && pointers.size === 1 ? this.bodyAt(event.offsetX, event.offsetY) : -1;
      if (held >= 0) this.pull(held, event.offsetX, event.offsetY);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => {
        pointers.delete(event.pointerId);
        if (held >= 0) this.onPull(-1);
        held = -1;
      });
    }
    canvas.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      if (held >= 0) return this.pull(held, event.offsetX, event.offsetY);
      const now = [event.clientX, event.clientY], change = [now[0] - before[0], now[1] - before[1]];
      if (pointers.size === 2) {
        const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
        this.zoom(distance(before, other) / Math.max(1, distance(now, other)));
        this.pan(change[0] / 2, change[1] / 2);
      } else if (event.buttons > 1 || event.shiftKey) this.pan(...change);
      else this.turn(...change);
      pointers.set(event.pointerId, now);
    });
  }

  turn(x, y) {
    this.view.yaw_deg -= 0.4 * x;
    this.view.pitch_deg = Math.max(-5, Math.min(89, this.view.pitch_deg + 0.3 * y));
    this.requestDraw();
  }

  zoom(factor) {
    this.view.distance_m = Math.max(0.15, Math.min(8, this.view.distance_m * factor));
    this.requestDraw();
  }

  pan(x, y) {
    const yaw = (this.view.yaw_deg * Math.PI) / 180, step = (ANGLE * this.view.distance_m) / this.canvas.clientHeight;
    this.view.target[0] += step * (Math.sin(yaw) * x - Math.cos(yaw) * y);
    this.view.target[1] += step * (-Math.cos(yaw) * x - Math.sin(yaw) * y);
    this.requestDraw();
  }
}

function program(gl, vertex, fragment) {
  const id = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(id, shader);
  }
  gl.linkProgram(id);
  if (!gl.getProgramParameter(id, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(id));
  const locations = new Map();
  const uniform = (name) => {
    if (!locations.has(name)) locations.set(name, gl.getUniformLocation(id, name));
    return locations.get(name);
  };
  return { id, uniform };
}

function mesh(gl, points, normals, faces) {
  const array = gl.createVertexArray(), buffers = [points, normals, faces].map(() => gl.createBuffer());
  gl.bindVertexArray(array);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffers[0]);
  gl.bufferData(gl.ARRAY_BUFFER, points, gl.STATIC_DRAW);
  gl.enableVertexAttribArray(0);
  gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffers[1]);
  gl.bufferData(gl.ARRAY_BUFFER, normals, gl.STATIC_DRAW);
  gl.enableVertexAttribArray(1);
  gl.vertexAttribPointer(1, 3, gl.BYTE, true, 4, 0);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers[2]);
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
  gl.bindVertexArray(null);
  return {
    box: box(points),
    draw() {
      gl.bindVertexArray(array);
      gl.drawElements(gl.TRIANGLES, faces.length, gl.UNSIGNED_INT, 0);
    },
    free() {
      gl.deleteVertexArray(array);
      buffers.forEach((buffer) => gl.deleteBuffer(buffer));
    },
  };
}

// Smallest and largest coordinates of points.
function box(points) {
  const low = [Infinity, Infinity, Infinity], high = low.map((value) => -value);
  points.forEach((value, i) => {
    low[i % 3] = Math.min(low[i % 3], value);
    high[i % 3] = Math.max(high[i % 3], value);
  });
  return { low, high };
}

// Height of the upper side of a placed shape above the floor, infinite if it lies further above or below.
function topOf({ shape, model }, floor) {
  const { low, high } = shape.mesh.box;
  let [bottom, top] = [model[14] - floor, model[14] - floor];
  for (let axis = 0; axis < 3; axis++) {
    const rise = model[4 * axis + 2];
    bottom += Math.min(rise * low[axis], rise * high[axis]);
    top += Math.max(rise * low[axis], rise * high[axis]);
  }
  return bottom > -FLAT_M && top < FLAT_M ? top : Infinity;
}

// Way along a ray to a box in a frame, infinite if it misses: the ray is between both sides of each axis at once.
function wayTo({ low, high }, frame, eye, ray) {
  let [from, to] = [0, Infinity];
  for (let axis = 0; axis < 3; axis++) {
    const along = (v) => frame[4 * axis] * v[0] + frame[4 * axis + 1] * v[1] + frame[4 * axis + 2] * v[2];
    const start = along(eye.map((value, i) => value - frame[12 + i])), speed = along(ray) || 1e-9;
    const sides = [(low[axis] - start) / speed, (high[axis] - start) / speed];
    [from, to] = [Math.max(from, Math.min(...sides)), Math.min(to, Math.max(...sides))];
  }
  return from < to ? from : Infinity;
}

function rigid([x, y, z], [w, a, b, c]) {
  return new Float32Array([
    1 - 2 * (b * b + c * c), 2 * (a * b + w * c), 2 * (a * c - w * b), 0,
    2 * (a * b - w * c), 1 - 2 * (a * a + c * c), 2 * (b * c + w * a), 0,
    2 * (a * c + w * b), 2 * (b * c - w * a), 1 - 2 * (a * a + b * b), 0,
    x, y, z, 1,
  ]);
}

function multiply(first, second) {
  const out = new Float32Array(16);
  for (let column = 0; column < 4; column++) {
    for (let row = 0; row < 4; row++) {
      let sum = 0;
      for (let i = 0; i < 4; i++) sum += first[4 * i + row] * second[4 * column + i];
      out[4 * column + row] = sum;
    }
  }
  return out;
}

// On a narrow screen the angle is that of its width, so that a phone shows as much as a wide screen.
function focal(angle, ratio, seenRatio) {
  return (1 / Math.tan(angle / 2)) * Math.min(1, ratio / seenRatio);
}

function perspective(angle, ratio, seenRatio, near, far) {
  const f = focal(angle, ratio, seenRatio);
  return new Float32Array([f / ratio, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0]);
}

function orthographic(half, near, far) {
  return new Float32Array([1 / half, 0, 0, 0, 0, 1 / half, 0, 0, 0, 0, 2 / (near - far), 0, 0, 0, (far + near) / (near - far), 1]);
}

function lookAt(eye, target) {
  const back = normalised(eye.map((value, i) => value - target[i]));
  const right = normalised(cross(Math.abs(back[2]) > 0.9999 ? [0, 1, 0] : [0, 0, 1], back)), up = cross(back, right);
  const shift = (axis) => -(axis[0] * eye[0] + axis[1] * eye[1] + axis[2] * eye[2]);
  return new Float32Array([right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0, shift(right), shift(up), shift(back), 1]);
}

function project(view, [x, y, z]) {
  const component = (row) => view[row] * x + view[4 + row] * y + view[8 + row] * z + view[12 + row], w = component(3);
  return w > 0 ? [component(0) / w, component(1) / w] : null;
}

function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

function normalised(v) {
  const length = Math.hypot(...v);
  return v.map((value) => value / length);
}

function distance(a, b) {
  return Math.hypot(a[0] - b[0], a[1] - b[1]);
}
